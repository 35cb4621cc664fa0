#version 460
#extension GL_KHR_shader_subgroup_ballot : require
#extension GL_KHR_shader_subgroup_shuffle : require
#include "shared/prelude.glsl"

// Gradient of every splat, from the records of compositing: of its geometry, and of its colour in the view's direction,
// from which that of the harmonics follows.
//
// Each invocation sums the records of its splat, if they are few; those of a splat with many tiles are summed by the
// whole subgroup, so that it does not keep the others waiting. The workgroup consists of full subgroups.

#include "project_backward.glsl"
#include "shared/across.glsl"

// Most records of a splat that its invocation sums by itself.
const uint OWN_RECORDS = 32;

// Adds up the lanes' sums, by halves of the subgroup.
void add_lanes(inout Sums sum, inout SurfelSums more, inout vec4 by_surface) {
    for (uint mask = 1; mask < gl_SubgroupSize; mask *= 2) {
        sum.shape += from_across(sum.shape, mask);
        sum.tone += from_across(sum.tone, mask);
        sum.rest += subgroupShuffleXor(sum.rest, mask);
        if (TILTED) {
            vec4 tilt_spot = from_across(vec4(more.tilt, more.spot.x), mask);
            more.tilt += tilt_spot.xyz;
            if (SURFEL == SURFEL_ANY) more.spot += vec2(tilt_spot.w, subgroupShuffleXor(more.spot.y, mask));
        }
        if (WITH_SURFACE != 0) by_surface += from_across(by_surface, mask);
    }
}

// Sums the records from `begin` on by all lanes.
void sum_by_all(uint begin, uint count, out Sums sum, out SurfelSums more, out vec4 by_surface) {
    sum = Sums(vec4(0.0), vec4(0.0), 0.0);
    more = SurfelSums(vec3(0.0), vec2(0.0));
    by_surface = vec4(0.0);
    for (uint i = gl_SubgroupInvocationID; i < count; i += gl_SubgroupSize) {
        add_record(begin + i, sum, more, by_surface);
    }
    add_lanes(sum, more, by_surface);
}

void add_records(uint splat, uint tile_count, inout Sums sum, inout SurfelSums more, inout vec4 by_surface) {
    uint begin = tile_count != 0 ? emitted_from_splat[splat] : 0;
    bool by_itself = tile_count <= OWN_RECORDS;
    uint end = by_itself ? begin + tile_count : begin;
    for (uint source = begin; source < end; ++source) add_record(source, sum, more, by_surface);
    uvec4 waiting = subgroupBallot(!by_itself);
    while (any(notEqual(waiting, uvec4(0)))) {
        uint lane = subgroupBallotFindLSB(waiting);
        Sums all;
        SurfelSums more_all;
        vec4 surface_all;
        sum_by_all(subgroupShuffle(begin, lane), subgroupShuffle(tile_count, lane), all, more_all, surface_all);
        bool mine = gl_SubgroupInvocationID == lane;
        if (mine) {
            sum = Sums(sum.shape + all.shape, sum.tone + all.tone, sum.rest + all.rest);
            more = SurfelSums(more.tilt + more_all.tilt, more.spot + more_all.spot);
            by_surface += surface_all;
        }
        waiting &= ~subgroupBallot(mine);
    }
}
