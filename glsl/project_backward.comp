#version 460
#include "shared/prelude.glsl"

// Gradient of every splat, from the records of compositing: of its geometry, and of its colour in the view's direction,
// from which that of the harmonics follows.
//
// Each invocation sums the records of its splat.

#include "project_backward.glsl"

// Two per iteration: llvmpipe leaves loops after 65,535 iterations, and the largest image that it binds has 65,536
// tiles.
void add_records(uint splat, uint tile_count, inout Sums sum, inout SurfelSums more, inout vec4 by_surface) {
    if (tile_count == 0) return;
    uint begin = emitted_from_splat[splat];
    uint end = begin + tile_count;
    for (uint source = begin; source < end; source += 2) {
        add_record(source, sum, more, by_surface);
        if (source + 1 < end) add_record(source + 1, sum, more, by_surface);
    }
}
