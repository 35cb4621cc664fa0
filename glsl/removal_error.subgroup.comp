#version 460
#extension GL_KHR_shader_subgroup_vote : require
#extension GL_KHR_shader_subgroup_shuffle : require
#include "shared/prelude.glsl"

// Finds what each splat of a tile's list does to the tile's pixels.
//
// One workgroup per tile, and the workgroup lies in one subgroup: lanes pass splats round, vote and add up by
// shuffles, in an order that is fixed.

#include "removal_error.glsl"
#include "shared/stage.shuffle.glsl"

bool any_lane(bool mine) {
    return subgroupAny(mine);
}

vec3 across(vec3 mine, uint mask) {
    return mine + vec3(subgroupShuffleXor(mine.x, mask), subgroupShuffleXor(mine.y, mask),
                       subgroupShuffleXor(mine.z, mask));
}

// Written out: a loop over masks would be one, turn by turn, to devices that count the turns of all loops.
vec3 over_lanes(vec3 mine) {
    mine = across(across(across(mine, 1), 2), 4);
    if (WORKGROUP > 8) mine = across(mine, 8);
    if (WORKGROUP > 16) mine = across(mine, 16);
    return mine;
}
