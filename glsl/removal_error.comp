#version 460
#include "shared/prelude.glsl"

// Change of a tile's pixels by the removal of each splat of its list.
//
// One workgroup per tile. Lanes exchange splats, vote and add up through shared memory, in lane order, for any subgroup
// size.

#include "removal_error.glsl"
#include "shared/stage.shared.glsl"

shared uint vote;
shared vec2 lane_sums[WORKGROUP];

bool any_lane(bool mine) {
    barrier();
    if (gl_LocalInvocationID.x == 0) vote = 0;
    barrier();
    if (mine) vote = 1;
    barrier();
    return vote != 0;
}

vec2 over_lanes(vec2 mine) {
    barrier();
    lane_sums[gl_LocalInvocationID.x] = mine;
    barrier();
    vec2 total = lane_sums[0];
    [[unroll]] for (uint i = 1; i < WORKGROUP; ++i) total += lane_sums[i];
    return total;
}
