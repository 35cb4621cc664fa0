#version 460
#include "shared/prelude.glsl"

// Second half of a pass of a stable radix sort: every key and value to its place.
//
// One invocation per chunk, as in sort_count; it walks its keys in order, so equal digits stay in order.
// The table's entries are the places to write next, counted up as they are used.

layout(constant_id = 0) const uint WORKGROUP = 8;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) readonly buffer Keys { uint keys[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Values { uint values[]; };
layout(set = 0, binding = 3, scalar) buffer Table { uint table[]; };
layout(set = 0, binding = 4, scalar) writeonly buffer KeysOut { uint keys_out[]; };
layout(set = 0, binding = 5, scalar) writeonly buffer ValuesOut { uint values_out[]; };

layout(push_constant, scalar) uniform Push {
    uint count_slot;  // where in `counts` the number of keys stands
    uint chunk;       // keys per chunk
    uint shift;       // lowest bit of the digit
    uint digit_count; // a power of two
} push;

// Where this invocation's next place of a digit stands.
uint chunk;
uint chunk_count;
uint shift;
uint mask;

// The same places, as long as there is room, as in sort_count.
const uint NEAR_ENTRIES = 2048;
shared uint near[NEAR_ENTRIES];

void put(uint place, uint key, uint value) {
    keys_out[place] = key;
    values_out[place] = value;
}

void move(uint key, uint value) {
    uint slot = ((key >> shift) & mask) * chunk_count + chunk;
    uint place = table[slot];
    table[slot] = place + 1;
    put(place, key, value);
}

void move_near(uint key, uint value) {
    uint slot = ((key >> shift) & mask) * WORKGROUP + gl_LocalInvocationID.x;
    uint place = near[slot];
    near[slot] = place + 1;
    put(place, key, value);
}

void main() {
    chunk = global_index();
    uint count = counts[push.count_slot];
    uint begin = chunk * push.chunk;
    if (begin >= count) return;
    uint end = min(begin + push.chunk, count);
    chunk_count = (count + push.chunk - 1) / push.chunk;
    shift = push.shift;
    mask = push.digit_count - 1;
    // Four a turn, as in sort_count.
    uint quads = begin + (end - begin) / 4 * 4;
    uint i = begin;
    if (push.digit_count * WORKGROUP <= NEAR_ENTRIES) {
        uint digit = 0;
        do {
            near[digit * WORKGROUP + gl_LocalInvocationID.x] = table[digit * chunk_count + chunk];
        } while (++digit < push.digit_count);
        if (quads > begin) {
            do {
                uvec4 key = uvec4(keys[i], keys[i + 1], keys[i + 2], keys[i + 3]);
                uvec4 value = uvec4(values[i], values[i + 1], values[i + 2], values[i + 3]);
                [[unroll]] for (uint k = 0; k < 4; ++k) move_near(key[k], value[k]);
                i += 4;
            } while (i < quads);
        }
        for (; i < end; ++i) move_near(keys[i], values[i]);
    } else {
        if (quads > begin) {
            do {
                uvec4 key = uvec4(keys[i], keys[i + 1], keys[i + 2], keys[i + 3]);
                uvec4 value = uvec4(values[i], values[i + 1], values[i + 2], values[i + 3]);
                [[unroll]] for (uint k = 0; k < 4; ++k) move(key[k], value[k]);
                i += 4;
            } while (i < quads);
        }
        for (; i < end; ++i) move(keys[i], values[i]);
    }
}
