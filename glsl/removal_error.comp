#version 460
#include "shared/prelude.glsl"

// Error in a tile's pixels from the removal of each splat of its list.
//
// One workgroup per tile. Lanes exchange splats, vote and add up through shared memory, in lane order, for any subgroup
// size.

#include "removal_error.glsl"
#include "shared/stage.shared.glsl"

shared uint vote;
shared vec3 lane_influence[WORKGROUP];

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
    lane_influence[gl_LocalInvocationID.x] = mine;
    barrier();
    vec3 total = lane_influence[0];
    [[unroll]] for (uint i = 1; i < WORKGROUP; ++i) total += lane_influence[i];
    return total;
}
