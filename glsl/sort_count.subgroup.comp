#version 460
#extension GL_KHR_shader_subgroup_ballot : require
#include "shared/prelude.glsl"
#include "shared/chunk.glsl"

// First half of a pass of a stable radix sort: histogram of digits of each chunk of keys.
//
// One workgroup per chunk, counting in shared memory: sums of integers do not depend on their order. It uses no
// subgroup operation itself, but is paired with `sort_scatter.subgroup` and has the same requirements.

layout(constant_id = 0) const uint WORKGROUP = 8;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) readonly buffer Keys { uint keys[]; };
layout(set = 0, binding = 2, scalar) buffer Table { uint table[]; };

layout(push_constant, scalar) uniform Push {
    uint count_slot;  // slot in `counts` of the number of keys
    uint chunk_slot;  // slot in `counts` of the number of chunks
    uint shift;       // lowest bit of the digit
    uint digit_count; // a power of two, at most SORT_DIGITS_MAX
} push;

shared uint counted[SORT_DIGITS_MAX];

void main() {
    uint chunk = group_index();
    uint lane = gl_LocalInvocationID.x;
    uint count = counts[push.count_slot];
    uint chunk_count = counts[push.chunk_slot];
    if (chunk >= chunk_count) return;
    uint size = keys_per_chunk(count, chunk_count);
    uint begin = min(chunk * size, count);
    uint end = min(begin + size, count);
    for (uint digit = lane; digit < push.digit_count; digit += WORKGROUP) counted[digit] = 0;
    barrier();
    for (uint i = begin + lane; i < end; i += WORKGROUP) {
        atomicAdd(counted[(keys[i] >> push.shift) & (push.digit_count - 1)], 1);
    }
    barrier();
    for (uint digit = lane; digit < push.digit_count; digit += WORKGROUP) {
        table[digit * chunk_count + chunk] = counted[digit];
    }
}
