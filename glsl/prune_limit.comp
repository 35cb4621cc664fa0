#version 460
#include "shared/prelude.glsl"

// For each pixel, the highest prune rank with a summed weight within the budget.
//
// One workgroup per tile. Lanes exchange splats and vote on stopping through shared memory, for any subgroup size.

#include "prune_limit.glsl"
#include "shared/stage.shared.glsl"

shared uint vote;

bool any_lane(bool mine) {
    barrier();
    if (gl_LocalInvocationID.x == 0) vote = 0;
    barrier();
    if (mine) vote = 1;
    barrier();
    return vote != 0;
}
