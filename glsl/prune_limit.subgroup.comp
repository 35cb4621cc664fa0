#version 460
#extension GL_KHR_shader_subgroup_vote : require
#extension GL_KHR_shader_subgroup_shuffle : require
#include "shared/prelude.glsl"

// Finds how far down a ranking of splats each pixel can do without them.
//
// One workgroup per tile, and the workgroup lies in one subgroup: lanes pass splats round
// and vote without shared memory.

#include "prune_limit.glsl"
#include "shared/stage.shuffle.glsl"

bool any_lane(bool mine) {
    return subgroupAny(mine);
}
