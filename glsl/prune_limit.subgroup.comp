#version 460
#extension GL_KHR_shader_subgroup_vote : require
#extension GL_KHR_shader_subgroup_shuffle : require
#include "shared/prelude.glsl"

// For each pixel, the highest prune rank with a summed weight within the budget.
//
// One workgroup per tile, in one subgroup: lanes exchange splats and vote without shared memory.

#include "prune_limit.glsl"
#include "shared/stage.shuffle.glsl"

bool any_lane(bool mine) {
    return subgroupAny(mine);
}
