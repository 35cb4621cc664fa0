#version 460
#include "shared/prelude.glsl"

// First of three passes of an exclusive prefix sum: the sum of every chunk.
//
// One workgroup per chunk of SCAN_CHUNK consecutive values: loads of neighbouring lanes are neighbours in memory.

layout(constant_id = 0) const uint WORKGROUP = 64;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) readonly buffer Values { uint values[]; };
layout(set = 0, binding = 2, scalar) writeonly buffer Sums { uint sum_from_chunk[]; };

layout(push_constant, scalar) uniform Push {
    uint count_slot;  // slot in `counts` of the number of values
    uint flags;       // sum "is not 0" instead of the values
} push;

#include "shared/scan.glsl"

void main() {
    uint chunk = group_index();
    uint count = counts[push.count_slot];
    uint begin = chunk * SCAN_CHUNK;
    if (begin >= count) return;
    uint end = min(begin + SCAN_CHUNK, count);
    uint sum = 0;
    for (uint i = begin + gl_LocalInvocationID.x; i < end; i += WORKGROUP) {
        uint value = values[i];
        sum = add_saturating(sum, push.flags != 0 ? min(value, 1u) : value);
    }
    uint total;
    sum_of_lanes_before(sum, total);
    if (gl_LocalInvocationID.x == 0) sum_from_chunk[chunk] = total;
}
