#version 460
#extension GL_KHR_shader_subgroup_vote : require
#extension GL_KHR_shader_subgroup_shuffle : require
#include "shared/prelude.glsl"

// Contribution of each splat of a tile's list to the tile's pixels.
//
// One workgroup per tile, in one subgroup: lanes exchange splats, vote and add up by shuffles, in a fixed order.

#include "contribution.glsl"
#include "shared/stage.shuffle.glsl"

bool any_lane(bool mine) {
    return subgroupAny(mine);
}

vec3 across(vec3 mine, uint mask) {
    return both_of(mine, vec3(subgroupShuffleXor(mine.x, mask), subgroupShuffleXor(mine.y, mask),
                              subgroupShuffleXor(mine.z, mask)));
}

// Unrolled by hand: a loop over masks would add to the iterations that some devices count over all loops.
vec3 over_lanes(vec3 mine) {
    mine = across(across(across(mine, 1), 2), 4);
    if (WORKGROUP > 8) mine = across(mine, 8);
    if (WORKGROUP > 16) mine = across(mine, 16);
    return mine;
}
