#version 460
#include "shared/prelude.glsl"

// Second of three passes of an exclusive prefix sum: the chunks' sums, in place, and the total.
//
// One workgroup for all, a block of four chunks per invocation at a time. The total saturates at 2^32 - 1, so that an
// overflow is never taken for a small count.

layout(constant_id = 0) const uint WORKGROUP = 64;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) buffer Sums { uint sum_from_chunk[]; };

layout(push_constant, scalar) uniform Push {
    uint count_slot;  // slot in `counts` of the number of values
    uint total_slot;  // slot in `counts` of the total
} push;

#include "shared/scan.glsl"

const uint LANE_CHUNKS = 4;

void main() {
    uint chunk_count = (counts[push.count_slot] + SCAN_CHUNK - 1) / SCAN_CHUNK;
    uint total = 0;
    for (uint block = 0; block < chunk_count; block += LANE_CHUNKS * WORKGROUP) {
        uint begin = block + gl_LocalInvocationID.x * LANE_CHUNKS;
        uint value[LANE_CHUNKS];
        uint mine = 0;
        [[unroll]] for (uint k = 0; k < LANE_CHUNKS; ++k) {
            value[k] = begin + k < chunk_count ? sum_from_chunk[begin + k] : 0;
            mine = add_saturating(mine, value[k]);
        }
        uint block_total;
        uint before = add_saturating(total, sum_of_lanes_before(mine, block_total));
        [[unroll]] for (uint k = 0; k < LANE_CHUNKS; ++k) {
            if (begin + k < chunk_count) sum_from_chunk[begin + k] = before;
            before = add_saturating(before, value[k]);
        }
        total = add_saturating(total, block_total);
    }
    if (gl_LocalInvocationID.x == 0) counts[push.total_slot] = total;
}
