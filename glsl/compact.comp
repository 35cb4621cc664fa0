#version 460
#include "shared/prelude.glsl"

// Lists the visible splats in the order of their index, with their depth as a sortable key.
//
// One invocation per splat; `visible_from_splat` is the exclusive prefix sum of "touches a tile".
// Depths are positive (beyond the near plane), so their bits have the same order.

layout(constant_id = 0) const uint WORKGROUP = 64;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) readonly buffer TileCounts { uint tile_count_from_splat[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Offsets { uint visible_from_splat[]; };
layout(set = 0, binding = 3, scalar) readonly buffer Rests { vec2 blue_depth_from_splat[]; };
layout(set = 0, binding = 4, scalar) writeonly buffer Keys { uint depth_from_visible[]; };
layout(set = 0, binding = 5, scalar) writeonly buffer Values { uint splat_from_visible[]; };

void main() {
    uint splat = global_index();
    if (splat >= counts[COUNT_SPLAT] || tile_count_from_splat[splat] == 0) return;
    uint visible = visible_from_splat[splat];
    depth_from_visible[visible] = floatBitsToUint(blue_depth_from_splat[splat].y);
    splat_from_visible[visible] = splat;
}
