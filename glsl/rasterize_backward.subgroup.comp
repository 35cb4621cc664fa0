#version 460
#extension GL_KHR_shader_subgroup_arithmetic : require
#include "shared/prelude.glsl"

// Gradient of every (tile, splat) pair from the gradient of the image.
//
// One workgroup per tile, lying in one subgroup: lanes add up by subgroup reductions, whose order is
// fixed on a given device. One record per pair, without atomics.

#include "rasterize_backward.glsl"

uint max_of_lanes(uint mine) {
    return subgroupMax(mine);
}

Sums sum_of_lanes(Sums mine, out bool stores) {
    stores = subgroupElect();
    mine.shape = subgroupAdd(mine.shape);
    mine.tone = subgroupAdd(mine.tone);
    mine.rest = subgroupAdd(mine.rest);
    return mine;
}
