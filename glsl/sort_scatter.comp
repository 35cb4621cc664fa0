#version 460
#include "shared/prelude.glsl"
#include "shared/chunk.glsl"

// Second half of a pass of a stable radix sort: moves every key and value to its place.
//
// One invocation per chunk, as in sort_count; it walks its keys in order, so equal digits stay in order. The table's
// entries are the next places to write, incremented on use.

layout(constant_id = 0) const uint WORKGROUP = 8;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) readonly buffer Keys { uint keys[]; };
layout(set = 0, binding = 1, scalar) readonly buffer KeysByFour { uvec4 keys_by_four[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Values { uint values[]; };
layout(set = 0, binding = 2, scalar) readonly buffer ValuesByFour { uvec4 values_by_four[]; };
layout(set = 0, binding = 3, scalar) buffer Table { uint table[]; };
layout(set = 0, binding = 4, scalar) writeonly buffer KeysOut { uint keys_out[]; };
layout(set = 0, binding = 5, scalar) writeonly buffer ValuesOut { uint values_out[]; };

layout(push_constant, scalar) uniform Push {
    uint count_slot;  // slot in `counts` of the number of keys
    uint chunk_slot;  // slot in `counts` of the number of chunks
    uint shift;       // lowest bit of the digit
    uint digit_count; // a power of two
} push;

// Index of this invocation's column in the table.
uint chunk;
uint chunk_count;
uint shift;
uint mask;

// The same places in an array for digits up to SORT_DIGITS_NEAR, as in sort_count.
uint near[SORT_DIGITS_NEAR];

uint place_near(uint key) {
    uint digit = (key >> shift) & mask;
    uint place = near[digit];
    near[digit] = place + 1;
    return place;
}

uint place_of(uint key) {
    uint slot = ((key >> shift) & mask) * chunk_count + chunk;
    uint place = table[slot];
    table[slot] = place + 1;
    return place;
}

void put(uint place, uint key, uint value) {
    keys_out[place] = key;
    values_out[place] = value;
}

void main() {
    chunk = global_index();
    uint count = counts[push.count_slot];
    chunk_count = counts[push.chunk_slot];
    if (chunk >= chunk_count) return;
    uint size = keys_per_chunk(count, chunk_count);
    uint begin = min(chunk * size, count);
    uint end = min(begin + size, count);
    shift = push.shift;
    mask = push.digit_count - 1;
    // Four per iteration, as in sort_count.
    uint quads = begin + (end - begin) / 4 * 4;
    uint i = begin;
    if (push.digit_count <= SORT_DIGITS_NEAR) {
        uint digit = 0;
        uint slot = chunk;
        do {
            near[digit] = table[slot];
            slot += chunk_count;
        } while (++digit < push.digit_count);
        if (quads > begin) {
            do {
                uvec4 key = keys_by_four[i / 4];
                uvec4 value = values_by_four[i / 4];
                uvec4 place;
                [[unroll]] for (uint k = 0; k < 4; ++k) place[k] = place_near(key[k]);
                [[unroll]] for (uint k = 0; k < 4; ++k) put(place[k], key[k], value[k]);
                i += 4;
            } while (i < quads);
        }
        for (; i < end; ++i) put(place_near(keys[i]), keys[i], values[i]);
    } else {
        if (quads > begin) {
            do {
                uvec4 key = keys_by_four[i / 4];
                uvec4 value = values_by_four[i / 4];
                [[unroll]] for (uint k = 0; k < 4; ++k) put(place_of(key[k]), key[k], value[k]);
                i += 4;
            } while (i < quads);
        }
        for (; i < end; ++i) put(place_of(keys[i]), keys[i], values[i]);
    }
}
