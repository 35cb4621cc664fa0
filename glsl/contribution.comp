#version 460
#include "shared/prelude.glsl"

// Finds what the pixels of a tile would lose with each of its splats.
//
// One workgroup per tile. Lanes pass splats round, vote and add up through shared memory, in lane order, so any
// subgroup size will do.

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
