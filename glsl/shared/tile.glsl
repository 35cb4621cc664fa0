// Tile geometry: the pixels of each lane.

const uint LANE_PIXELS = TILE_PIXELS / WORKGROUP;
const uint QUADS = LANE_PIXELS / 4;

Tile tile_of(uint tile, View view) {
    uint lane = gl_LocalInvocationID.x;
    Tile t;
    t.corner = uvec2(tile % view.tiles.x, tile / view.tiles.x) * uvec2(TILE_WIDTH, TILE_HEIGHT);
    t.corner.y += view.first_row;
    t.x = lane % TILE_WIDTH;
    t.y = lane / TILE_WIDTH * LANE_PIXELS;
    return t;
}

// Mask of the pixels of the lane's quad `q` in the drawn rows.
bvec4 inside(Tile t, uint q, View view) {
    uvec4 rows = uvec4(0, 1, 2, 3) + t.corner.y + t.y + q * 4;
    bvec4 ok = lessThan(rows, uvec4(view.first_row + view.size.y));
    return t.corner.x + t.x < view.size.x ? ok : bvec4(false);
}

// Place of a pixel among those of the drawn rows.
uint pixel_of(Tile t, uint row, View view) {
    return (t.corner.y - view.first_row + t.y + row) * view.size.x + t.corner.x + t.x;
}

bvec4 both(bvec4 a, bvec4 b) {
    return bvec4(a.x && b.x, a.y && b.y, a.z && b.z, a.w && b.w);
}
