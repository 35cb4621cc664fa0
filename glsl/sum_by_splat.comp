#version 460
#include "shared/prelude.glsl"

// Adds a view's records by splat to those of earlier views: the maximum of the first numbers, the sum of the second,
// the minimum of the third; or the sums of all three.
//
// One invocation per splat. A splat's records are contiguous and are taken in order, so that the result is the same in
// every run. A frame that did not fit changes nothing.

layout(constant_id = 0) const uint WORKGROUP = 64;
// Not 0: sums of all three.
layout(constant_id = 1) const uint SUMS = 0;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) readonly buffer TileCounts { uint tile_count_from_splat[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Begins { uint emitted_from_splat[]; };
layout(set = 0, binding = 3, scalar) readonly buffer Records { vec3 record_from_emitted[]; };
layout(set = 0, binding = 4, scalar) buffer Totals { vec3 sum_from_splat[]; };

layout(push_constant, scalar) uniform Push {
    uint splat_count;
} push;

void add(uint source, inout vec3 total) {
    vec3 loss = record_from_emitted[source];
    vec3 sum = total + loss;
    total = SUMS != 0 ? sum : vec3(max(total.x, loss.x), sum.y, min(total.z, loss.z));
}

void main() {
    uint splat = global_index();
    if (splat >= push.splat_count || counts[COUNT_FAILED] != 0) return;
    uint begin = emitted_from_splat[splat];
    uint end = begin + tile_count_from_splat[splat];
    if (begin == end) return;
    vec3 total = sum_from_splat[splat];
    // Two per iteration: llvmpipe leaves loops after 65,535 iterations, and the largest image that it binds has 65,536
    // tiles.
    for (uint source = begin; source < end; source += 2) {
        add(source, total);
        if (source + 1 < end) add(source + 1, total);
    }
    sum_from_splat[splat] = total;
}
