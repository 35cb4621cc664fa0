// Tile geometry of lanes that own LANE_PIXELS pixels of one column each.

const uint LANE_PIXELS = TILE_PIXELS / WORKGROUP;

// A tile, with the pixels of a lane.
Tile tile_of_lane(uint tile, uint lane, View view) {
    Tile t;
    t.corner = uvec2(tile % view.tiles.x, tile / view.tiles.x) * uvec2(TILE_WIDTH, TILE_HEIGHT);
    t.corner.y += view.first_row;
    t.x = lane % TILE_WIDTH;
    t.y = lane / TILE_WIDTH * LANE_PIXELS;
    return t;
}

// Place of a pixel among those of the drawn rows.
uint pixel_of(Tile t, uint row, View view) {
    return (t.corner.y - view.first_row + t.y + row) * view.size.x + t.corner.x + t.x;
}
