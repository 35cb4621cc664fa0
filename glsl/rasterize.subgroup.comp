#version 460
#extension GL_KHR_shader_subgroup_vote : require
#extension GL_KHR_shader_subgroup_shuffle : require
#include "shared/prelude.glsl"

// Composites the sorted splats of every tile into an image, front to back.
//
// One workgroup per tile, in one subgroup: lanes exchange splats and vote without shared memory.

#include "rasterize.glsl"
#include "shared/stage.shuffle.glsl"

bool any_lane(bool mine) {
    return subgroupAny(mine);
}
