#version 460
#extension GL_KHR_shader_subgroup_arithmetic : require
#extension GL_KHR_shader_subgroup_shuffle : require
#include "shared/prelude.glsl"

// Gradient of every (tile, splat) pair from the gradient of the image.
//
// One workgroup per tile, in one subgroup: lanes exchange splats and add up by shuffles, in a fixed order. The sums of
// two splats are folded into one value per lane at the first step, for little more than the cost of one splat; a
// subgroup reduction for each would cost twice that on a software device. One record per pair, without atomics.

#include "rasterize_backward.glsl"
#include "shared/stage.shuffle.glsl"
#include "shared/across.glsl"

uint max_of_lanes(uint mine) {
    return subgroupMax(mine);
}

void add_from_across(inout Sums mine, Sums other, uint mask) {
    mine.shape += from_across(other.shape, mask);
    mine.tone += from_across(other.tone, mask);
    mine.rest += subgroupShuffleXor(other.rest, mask);
}

// No loop: some software devices do not unroll one with a multiplied counter, and its iterations would count towards
// their limit over all loops.
Sums sum_of_lanes(Sums even, Sums odd) {
    bool is_odd = (stage_lane() & 1) != 0;
    Sums mine = either(even, odd, is_odd);
    Sums other = either(odd, even, is_odd);
    add_from_across(mine, other, 1);
    if (WORKGROUP > 2) add_from_across(mine, mine, 2);
    if (WORKGROUP > 4) add_from_across(mine, mine, 4);
    if (WORKGROUP > 8) add_from_across(mine, mine, 8);
    if (WORKGROUP > 16) add_from_across(mine, mine, 16);
    if (WORKGROUP > 32) add_from_across(mine, mine, 32);
    return mine;
}

void add_surfel_from_across(inout SurfelSums mine, SurfelSums other, uint mask) {
    vec4 tilt_spot = from_across(vec4(other.tilt, other.spot.x), mask);
    mine.tilt += tilt_spot.xyz;
    if (SURFEL == SURFEL_ANY) mine.spot += vec2(tilt_spot.w, subgroupShuffleXor(other.spot.y, mask));
}

SurfelSums surfel_sum_of_lanes(SurfelSums even, SurfelSums odd) {
    bool is_odd = (stage_lane() & 1) != 0;
    SurfelSums mine = surfel_either(even, odd, is_odd);
    SurfelSums other = surfel_either(odd, even, is_odd);
    add_surfel_from_across(mine, other, 1);
    if (WORKGROUP > 2) add_surfel_from_across(mine, mine, 2);
    if (WORKGROUP > 4) add_surfel_from_across(mine, mine, 4);
    if (WORKGROUP > 8) add_surfel_from_across(mine, mine, 8);
    if (WORKGROUP > 16) add_surfel_from_across(mine, mine, 16);
    if (WORKGROUP > 32) add_surfel_from_across(mine, mine, 32);
    return mine;
}

vec4 surface_sum_of_lanes(vec4 even, vec4 odd) {
    bool is_odd = (stage_lane() & 1) != 0;
    vec4 mine = mix(even, odd, bvec4(is_odd));
    vec4 other = mix(odd, even, bvec4(is_odd));
    mine += from_across(other, 1);
    if (WORKGROUP > 2) mine += from_across(mine, 2);
    if (WORKGROUP > 4) mine += from_across(mine, 4);
    if (WORKGROUP > 8) mine += from_across(mine, 8);
    if (WORKGROUP > 16) mine += from_across(mine, 16);
    if (WORKGROUP > 32) mine += from_across(mine, 32);
    return mine;
}
