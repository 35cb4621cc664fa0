#version 460
#include "shared/prelude.glsl"

// Second of three passes of an exclusive prefix sum: the chunks' sums, in place, and the total.
//
// One workgroup for all. Each invocation owns a run of chunks; the runs' sums are scanned in shared memory. The total
// saturates at 2^32 - 1, so that an overflow is never taken for a small count.

layout(constant_id = 0) const uint WORKGROUP = 64;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) buffer Sums { uint sum_from_chunk[]; };

layout(push_constant, scalar) uniform Push {
    uint count_slot;  // slot in `counts` of the number of values
    uint total_slot;  // slot in `counts` of the total
} push;

shared uint run_sum[WORKGROUP];

#include "shared/saturating.glsl"

void main() {
    uint lane = gl_LocalInvocationID.x;
    uint chunk_count = (counts[push.count_slot] + SCAN_CHUNK - 1) / SCAN_CHUNK;
    uint run = (chunk_count + WORKGROUP - 1) / WORKGROUP;
    uint begin = min(lane * run, chunk_count);
    uint end = min(begin + run, chunk_count);
    uint sum = 0;
    for (uint i = begin; i < end; ++i) sum = add_saturating(sum, sum_from_chunk[i]);
    run_sum[lane] = sum;
    barrier();
    uint before = 0;
    uint total = 0;
    for (uint i = 0; i < WORKGROUP; ++i) {
        if (i == lane) before = total;
        total = add_saturating(total, run_sum[i]);
    }
    for (uint i = begin; i < end; ++i) {
        uint value = sum_from_chunk[i];
        sum_from_chunk[i] = before;
        before = add_saturating(before, value);
    }
    if (lane == 0) counts[push.total_slot] = total;
}
