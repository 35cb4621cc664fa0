#version 460
#include "shared/prelude.glsl"

// Last of three passes of an exclusive prefix sum: every value's offset.
//
// One workgroup per chunk of SCAN_CHUNK consecutive values, as in scan_reduce.workgroup.

layout(constant_id = 0) const uint WORKGROUP = 64;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) readonly buffer Values { uint values[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Sums { uint sum_from_chunk[]; };
layout(set = 0, binding = 3, scalar) writeonly buffer Offsets { uint offsets[]; };

layout(push_constant, scalar) uniform Push {
    uint count_slot;  // slot in `counts` of the number of values
    uint flags;       // sum "is not 0" instead of the values
} push;

#include "shared/scan.glsl"

const uint LANE_VALUES = SCAN_CHUNK / WORKGROUP;

void main() {
    uint chunk = group_index();
    uint count = counts[push.count_slot];
    if (chunk * SCAN_CHUNK >= count) return;
    uint begin = chunk * SCAN_CHUNK + gl_LocalInvocationID.x * LANE_VALUES;
    uint value[LANE_VALUES];
    uint mine = 0;
    [[unroll]] for (uint k = 0; k < LANE_VALUES; ++k) {
        value[k] = begin + k < count ? values[begin + k] : 0;
        if (push.flags != 0) value[k] = min(value[k], 1u);
        mine += value[k];
    }
    uint total;
    uint offset = sum_from_chunk[chunk] + sum_of_lanes_before(mine, total);
    [[unroll]] for (uint k = 0; k < LANE_VALUES; ++k) {
        if (begin + k < count) offsets[begin + k] = offset;
        offset += value[k];
    }
}
