// Tile geometry: the pixels of each lane.

const uint LANE_PIXELS = TILE_PIXELS / WORKGROUP;
const uint QUADS = LANE_PIXELS / 4;

Tile tile_of(uint tile, View view) {
    uint lane = gl_LocalInvocationID.x;
    Tile t;
    t.corner = uvec2(tile % view.tiles.x, tile / view.tiles.x) * uvec2(TILE_WIDTH, TILE_HEIGHT);
    t.x = lane % TILE_WIDTH;
    t.y = lane / TILE_WIDTH * LANE_PIXELS;
    return t;
}

// Mask of the pixels of the lane's quad `q` in the image.
bvec4 inside(Tile t, uint q, View view) {
    uvec4 rows = uvec4(0, 1, 2, 3) + t.corner.y + t.y + q * 4;
    bvec4 ok = lessThan(rows, uvec4(view.size.y));
    return t.corner.x + t.x < view.size.x ? ok : bvec4(false);
}

uint pixel_of(Tile t, uint row, View view) {
    return (t.corner.y + t.y + row) * view.size.x + t.corner.x + t.x;
}

bvec4 both(bvec4 a, bvec4 b) {
    return bvec4(a.x && b.x, a.y && b.y, a.z && b.z, a.w && b.w);
}
