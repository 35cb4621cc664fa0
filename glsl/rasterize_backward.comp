#version 460
#include "shared/prelude.glsl"

// Gradient of every (tile, splat) pair from the gradient of the image.
//
// One workgroup per tile; one record per pair, written once and without atomics, so that a splat's sum over its records
// is the same in every run. Lanes exchange splats and add up through shared memory, in lane order.

#include "rasterize_backward.glsl"
#include "shared/stage.shared.glsl"

shared uint lane_last[WORKGROUP];
shared Sums lane_sums[2][WORKGROUP];
// Of tilts, and of depths and normals; else hardly any.
const uint TILTED_LANES = TILTED ? WORKGROUP : 1;
shared SurfelSums lane_surfel_sums[2][TILTED_LANES];
const uint SURFACE_LANES = WITH_SURFACE != 0 ? WORKGROUP : 1;
shared vec4 lane_surface_sums[2][SURFACE_LANES];

uint max_of_lanes(uint mine) {
    lane_last[gl_LocalInvocationID.x] = mine;
    barrier();
    uint most = 0;
    for (uint i = 0; i < WORKGROUP; ++i) most = max(most, lane_last[i]);
    return most;
}

Sums sum_of_lanes(Sums even, Sums odd) {
    uint lane = gl_LocalInvocationID.x;
    barrier();
    lane_sums[0][lane] = even;
    lane_sums[1][lane] = odd;
    barrier();
    uint which = lane & 1;
    Sums total = lane_sums[which][0];
    [[unroll]] for (uint i = 1; i < WORKGROUP; ++i) {
        total.shape += lane_sums[which][i].shape;
        total.tone += lane_sums[which][i].tone;
        total.rest += lane_sums[which][i].rest;
    }
    return total;
}

SurfelSums surfel_sum_of_lanes(SurfelSums even, SurfelSums odd) {
    uint lane = gl_LocalInvocationID.x;
    barrier();
    lane_surfel_sums[0][lane] = even;
    lane_surfel_sums[1][lane] = odd;
    barrier();
    uint which = lane & 1;
    SurfelSums total = lane_surfel_sums[which][0];
    [[unroll]] for (uint i = 1; i < WORKGROUP; ++i) {
        total.tilt += lane_surfel_sums[which][i].tilt;
        if (SURFEL == SURFEL_ANY) total.spot += lane_surfel_sums[which][i].spot;
    }
    return total;
}

vec4 surface_sum_of_lanes(vec4 even, vec4 odd) {
    uint lane = gl_LocalInvocationID.x;
    barrier();
    lane_surface_sums[0][lane] = even;
    lane_surface_sums[1][lane] = odd;
    barrier();
    uint which = lane & 1;
    vec4 total = lane_surface_sums[which][0];
    [[unroll]] for (uint i = 1; i < WORKGROUP; ++i) total += lane_surface_sums[which][i];
    return total;
}
