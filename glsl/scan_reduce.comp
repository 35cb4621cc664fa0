#version 460
#include "shared/prelude.glsl"

// First of three passes of an exclusive prefix sum: the sum of every chunk.
//
// One invocation per chunk of SCAN_CHUNK consecutive values. It relies neither on subgroup operations nor on forward
// progress between workgroups. With `flags` set, a value counts as 1 if it is not 0. Sums saturate at 2^32 - 1, like
// the total.

layout(constant_id = 0) const uint WORKGROUP = 64;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) readonly buffer Values { uint values[]; };
layout(set = 0, binding = 1, scalar) readonly buffer ValuesByFour { uvec4 values_by_four[]; };
layout(set = 0, binding = 2, scalar) writeonly buffer Sums { uint sum_from_chunk[]; };

layout(push_constant, scalar) uniform Push {
    uint count_slot;  // slot in `counts` of the number of values
    uint flags;       // sum "is not 0" instead of the values
} push;

void main() {
    uint chunk = global_index();
    uint count = counts[push.count_slot];
    uint begin = chunk * SCAN_CHUNK;
    if (begin >= count) return;
    uint end = min(begin + SCAN_CHUNK, count);
    uint quads = begin + (end - begin) / 4 * 4;
    uint sum = 0;
    uint i = begin;
    // A load of four values costs a software device half of four loads.
    for (; i < quads; i += 4) {
        uvec4 value = values_by_four[i / 4];
        value = push.flags != 0 ? min(value, uvec4(1)) : value;
        [[unroll]] for (uint k = 0; k < 4; ++k) sum += min(value[k], ~sum);
    }
    for (; i < end; ++i) {
        uint value = values[i];
        value = push.flags != 0 ? min(value, 1u) : value;
        sum += min(value, ~sum);
    }
    sum_from_chunk[chunk] = sum;
}
