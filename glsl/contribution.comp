#version 460
#include "shared/prelude.glsl"

// Contribution of each splat of a tile's list to the tile's pixels.
//
// One workgroup per tile. Lanes exchange splats, vote and add up through shared memory, in lane order, for any subgroup
// size.

#include "contribution.glsl"
#include "shared/stage.shared.glsl"

shared uint vote;
shared vec3 lane_loss[WORKGROUP];

bool any_lane(bool mine) {
    barrier();
    if (gl_LocalInvocationID.x == 0) vote = 0;
    barrier();
    if (mine) vote = 1;
    barrier();
    return vote != 0;
}

vec3 over_lanes(vec3 mine) {
    barrier();
    lane_loss[gl_LocalInvocationID.x] = mine;
    barrier();
    vec3 total = lane_loss[0];
    [[unroll]] for (uint i = 1; i < WORKGROUP; ++i) total = both_of(total, lane_loss[i]);
    return total;
}
