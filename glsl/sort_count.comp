#version 460
#include "shared/prelude.glsl"

// First half of a pass of a stable radix sort: how often each digit occurs in each chunk of keys.
//
// One invocation per chunk of consecutive keys, with a table of its own in memory: no atomics, no
// subgroup operations. Tables are interleaved, [digit][chunk], so that one prefix sum over all of it
// gives every chunk the place of its first key of every digit.

layout(constant_id = 0) const uint WORKGROUP = 8;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) readonly buffer Keys { uint keys[]; };
layout(set = 0, binding = 2, scalar) buffer Table { uint table[]; };

layout(push_constant, scalar) uniform Push {
    uint count_slot;  // where in `counts` the number of keys stands
    uint chunk;       // keys per chunk; with the table's size under the driver's limit of loop iterations
    uint shift;       // lowest bit of the digit
    uint digit_count; // a power of two
} push;

// Where this invocation's part of a digit's counts stands.
uint chunk;
uint chunk_count;
uint shift;
uint mask;

// The same counts, as long as there is room: tables of neighbouring chunks are a power of two apart in memory
// where the number of chunks is, and would contend for the same lines of a processor's cache.
const uint NEAR_ENTRIES = 2048;
shared uint near[NEAR_ENTRIES];

void count_key_near(uint key) {
    near[((key >> shift) & mask) * WORKGROUP + gl_LocalInvocationID.x] += 1;
}

void count_key(uint key) {
    table[((key >> shift) & mask) * chunk_count + chunk] += 1;
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
    // Four keys a turn, and tested at the end: a turn costs a software device as much as a load, and a loop that
    // is tested at its beginning costs it one more body, for no lane.
    uint quads = begin + (end - begin) / 4 * 4;
    if (push.digit_count * WORKGROUP <= NEAR_ENTRIES) {
        uint i = gl_LocalInvocationID.x;
        do {
            near[i] = 0;
            i += WORKGROUP;
        } while (i < push.digit_count * WORKGROUP);
        for (i = quads; i < end; ++i) count_key_near(keys[i]);
        if (quads > begin) {
            i = begin;
            do {
                uvec4 key = uvec4(keys[i], keys[i + 1], keys[i + 2], keys[i + 3]);
                [[unroll]] for (uint k = 0; k < 4; ++k) count_key_near(key[k]);
                i += 4;
            } while (i < quads);
        }
        uint digit = 0;
        do {
            table[digit * chunk_count + chunk] = near[digit * WORKGROUP + gl_LocalInvocationID.x];
        } while (++digit < push.digit_count);
    } else {
        uint slot = chunk;
        do {
            table[slot] = 0;
            slot += chunk_count;
        } while (slot < push.digit_count * chunk_count);
        uint i = quads;
        for (; i < end; ++i) count_key(keys[i]);
        if (quads > begin) {
            i = begin;
            do {
                uvec4 key = uvec4(keys[i], keys[i + 1], keys[i + 2], keys[i + 3]);
                [[unroll]] for (uint k = 0; k < 4; ++k) count_key(key[k]);
                i += 4;
            } while (i < quads);
        }
    }
}
