#version 460
#include "shared/prelude.glsl"

// Indexed reads: the tile counts of the visible splats in depth order.
//
// One invocation per visible splat.

layout(constant_id = 0) const uint WORKGROUP = 64;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) readonly buffer Index { uint splat_from_rank[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Source { uint tile_count_from_splat[]; };
layout(set = 0, binding = 3, scalar) writeonly buffer Target { uint tile_count_from_rank[]; };

void main() {
    uint rank = global_index();
    if (rank >= counts[COUNT_VISIBLE]) return;
    tile_count_from_rank[rank] = tile_count_from_splat[splat_from_rank[rank]];
}
