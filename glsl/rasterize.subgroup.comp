#version 460
#extension GL_KHR_shader_subgroup_vote : require
#include "shared/prelude.glsl"

// Composites the sorted splats of every tile into an image, front to back.
//
// One workgroup per tile, and the workgroup lies in one subgroup: lanes vote without shared memory.

#include "rasterize.glsl"

bool any_lane(bool mine) {
    return subgroupAny(mine);
}
