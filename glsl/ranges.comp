#version 460
#include "shared/prelude.glsl"

// For every tile, its slice of the sorted intersections.
//
// One invocation per intersection. If its tile differs from its left neighbour's, it closes the neighbour's slice and
// opens its own; tiles without intersections keep the empty slice that they were cleared to. Also detects slices longer
// than the device's loops may run: some software devices leave a loop after 65,535 iterations without an error. The
// frame has then failed, and is drawn again in bands.

layout(constant_id = 0) const uint WORKGROUP = 64;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) readonly buffer Tiles { uint tile_from_isect[]; };
layout(set = 0, binding = 2, scalar) writeonly buffer Ranges { uvec2 range_from_tile[]; };

layout(push_constant, scalar) uniform Push {
    uint tile_count;  // number of tiles; intersections of higher tiles are padding
    uint list_limit;  // most intersections of a tile
} push;

void main() {
    uint isect = global_index();
    uint count = counts[COUNT_ISECT];
    if (isect >= count) return;
    uint tile = tile_from_isect[isect];
    uint left = isect == 0 ? push.tile_count : tile_from_isect[isect - 1];
    if (tile != left) {
        if (tile < push.tile_count) range_from_tile[tile].x = isect;
        if (isect > 0 && left < push.tile_count) range_from_tile[left].y = isect;
    }
    // All invocations that detect it write the same value.
    bool too_long = isect >= push.list_limit && tile_from_isect[isect - push.list_limit] == tile;
    if (too_long && tile < push.tile_count) {
        counts[COUNT_LIST_TOO_LONG] = 1;
        counts[COUNT_FAILED] = 1;
    }
    if (isect + 1 == count && tile < push.tile_count) range_from_tile[tile].y = count;
}
