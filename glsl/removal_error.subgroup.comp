#version 460
#extension GL_KHR_shader_subgroup_vote : require
#extension GL_KHR_shader_subgroup_shuffle : require
#include "shared/prelude.glsl"

// Change of a tile's pixels by the removal of each splat of its list.
//
// One workgroup per tile, in one subgroup: lanes exchange splats, vote and add up by shuffles, in a fixed order.

#include "removal_error.glsl"
#include "shared/stage.shuffle.glsl"

bool any_lane(bool mine) {
    return subgroupAny(mine);
}

vec2 across(vec2 mine, uint mask) {
    return mine + vec2(subgroupShuffleXor(mine.x, mask), subgroupShuffleXor(mine.y, mask));
}

// Unrolled by hand: a loop over masks would add to the iterations that some devices count over all loops.
vec2 over_lanes(vec2 mine) {
    mine = across(across(across(mine, 1), 2), 4);
    if (WORKGROUP > 8) mine = across(mine, 8);
    if (WORKGROUP > 16) mine = across(mine, 16);
    return mine;
}
