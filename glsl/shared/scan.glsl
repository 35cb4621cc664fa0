// Saturating prefix sum over the lanes of a workgroup of WORKGROUP lanes, in shared memory.

#include "shared/saturating.glsl"

shared uint sum_to_lane[WORKGROUP];

// Sum of the values of the lanes before this one, and of all. All lanes call it.
uint sum_of_lanes_before(uint mine, out uint total) {
    uint lane = gl_LocalInvocationID.x;
    barrier();
    sum_to_lane[lane] = mine;
    for (uint apart = 1; apart < WORKGROUP; apart *= 2) {
        barrier();
        uint other = lane >= apart ? sum_to_lane[lane - apart] : 0;
        barrier();
        sum_to_lane[lane] = add_saturating(sum_to_lane[lane], other);
    }
    barrier();
    total = sum_to_lane[WORKGROUP - 1];
    return lane == 0 ? 0 : sum_to_lane[lane - 1];
}
