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

void main() {
    uint chunk = global_index();
    uint count = counts[push.count_slot];
    uint begin = chunk * push.chunk;
    if (begin >= count) return;
    uint end = min(begin + push.chunk, count);
    uint chunk_count = (count + push.chunk - 1) / push.chunk;
    for (uint digit = 0; digit < push.digit_count; ++digit) table[digit * chunk_count + chunk] = 0;
    for (uint i = begin; i < end; ++i) {
        uint digit = (keys[i] >> push.shift) & (push.digit_count - 1);
        table[digit * chunk_count + chunk] += 1;
    }
}
