#version 460
#include "shared/prelude.glsl"
#include "shared/chunk.glsl"

// First half of a pass of a stable radix sort: histogram of digits of each chunk of keys.
//
// One invocation per chunk of consecutive keys, with a table of its own: no atomics, no subgroup operations. Tables are
// interleaved in memory, [digit][chunk], so that one prefix sum over all of it yields the output offset of every digit
// of every chunk.

layout(constant_id = 0) const uint WORKGROUP = 8;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) readonly buffer Keys { uint keys[]; };
layout(set = 0, binding = 1, scalar) readonly buffer KeysByFour { uvec4 keys_by_four[]; };
layout(set = 0, binding = 2, scalar) buffer Table { uint table[]; };

layout(push_constant, scalar) uniform Push {
    uint count_slot;  // slot in `counts` of the number of keys
    uint chunk_slot;  // slot of the number of chunks; a chunk with its table is under the driver's loop limit
    uint shift;       // lowest bit of the digit
    uint digit_count; // a power of two
} push;

// Index of this invocation's column in the table.
uint chunk;
uint chunk_count;
uint shift;
uint mask;

// The same counts in an array, for digits up to SORT_DIGITS_NEAR: a software device keeps an array of one invocation
// beside those of its lanes, and reaches it at half the price of shared memory. Compile time grows with the array.
uint near[SORT_DIGITS_NEAR];

void count_key_near(uint key) {
    near[(key >> shift) & mask] += 1;
}

void count_key(uint key) {
    table[((key >> shift) & mask) * chunk_count + chunk] += 1;
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
    // Four keys per iteration and load, and tested at the end: an iteration costs a software device as much as a load,
    // a load of four numbers half of four loads, and a loop tested at its beginning one more body without active lanes.
    uint quads = begin + (end - begin) / 4 * 4;
    uint i = quads;
    uint slot = chunk;
    if (push.digit_count <= SORT_DIGITS_NEAR) {
        uint digit = 0;
        do {
            near[digit] = 0;
        } while (++digit < push.digit_count);
        for (; i < end; ++i) count_key_near(keys[i]);
        if (quads > begin) {
            i = begin;
            do {
                uvec4 key = keys_by_four[i / 4];
                [[unroll]] for (uint k = 0; k < 4; ++k) count_key_near(key[k]);
                i += 4;
            } while (i < quads);
        }
        digit = 0;
        do {
            table[slot] = near[digit];
            slot += chunk_count;
        } while (++digit < push.digit_count);
    } else {
        do {
            table[slot] = 0;
            slot += chunk_count;
        } while (slot < push.digit_count * chunk_count);
        for (; i < end; ++i) count_key(keys[i]);
        if (quads > begin) {
            i = begin;
            do {
                uvec4 key = keys_by_four[i / 4];
                [[unroll]] for (uint k = 0; k < 4; ++k) count_key(key[k]);
                i += 4;
            } while (i < quads);
        }
    }
}
