#version 460
#include "shared/prelude.glsl"

// Reads a rectangle of a host's depth image: distance along z of the host's surface at each pixel, and the farthest of
// each tile.
//
// One invocation per tile. Splats at a limit or beyond are hidden; where the host has nothing, the limit is infinite.

layout(constant_id = 0) const uint WORKGROUP = 64;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0) uniform texture2D stored;
layout(set = 0, binding = 1, scalar) writeonly buffer PixelLimits { float limit_from_pixel[]; };
layout(set = 0, binding = 2, scalar) writeonly buffer TileLimits { float limit_from_tile[]; };

layout(push_constant, scalar) uniform Push {
    float a;       // stored depth is a + b / z
    float b;
    uint linear;   // not 0: it is a + b * z
    float empty;   // value where the host has nothing
    uvec2 size;    // pixels
    uvec2 origin;  // the stored image's pixel at the first
} push;

float limit_of(float value) {
    float z = push.linear != 0 ? (value - push.a) / push.b : push.b / (value - push.a);
    float infinite = uintBitsToFloat(0x7f800000);
    // A depth behind the camera, or none at all, hides nothing.
    return value != push.empty && z >= 0.0 ? z : infinite;
}

void main() {
    uint tile = global_index();
    uvec2 tiles = (push.size + uvec2(TILE_WIDTH, TILE_HEIGHT) - 1) / uvec2(TILE_WIDTH, TILE_HEIGHT);
    if (tile >= tiles.x * tiles.y) return;
    uvec2 corner = uvec2(tile % tiles.x, tile / tiles.x) * uvec2(TILE_WIDTH, TILE_HEIGHT);
    uvec2 end = min(corner + uvec2(TILE_WIDTH, TILE_HEIGHT), push.size);
    float farthest = 0.0;
    for (uint y = corner.y; y < end.y; ++y) {
        for (uint x = corner.x; x < end.x; ++x) {
            float limit = limit_of(texelFetch(stored, ivec2(push.origin + uvec2(x, y)), 0).r);
            limit_from_pixel[y * push.size.x + x] = limit;
            farthest = max(farthest, limit);
        }
    }
    limit_from_tile[tile] = farthest;
}
