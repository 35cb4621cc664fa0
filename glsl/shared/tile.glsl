// Tile geometry: the pixels of each lane.

#include "shared/tile_lane.glsl"

const uint QUADS = LANE_PIXELS / 4;

Tile tile_of(uint tile, View view) {
    return tile_of_lane(tile, gl_LocalInvocationID.x, view);
}

// Mask of the pixels of the lane's quad `q` in the drawn rows.
bvec4 inside(Tile t, uint q, View view) {
    uvec4 rows = uvec4(0, 1, 2, 3) + t.corner.y + t.y + q * 4;
    bvec4 ok = lessThan(rows, uvec4(view.first_row + view.size.y));
    return t.corner.x + t.x < view.size.x ? ok : bvec4(false);
}

bvec4 both(bvec4 a, bvec4 b) {
    return bvec4(a.x && b.x, a.y && b.y, a.z && b.z, a.w && b.w);
}
