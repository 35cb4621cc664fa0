// Tile geometry: the pixels of each lane, and a splat's exponent along its column. Forward and backward share this, for
// equal alphas.

const uint LANE_PIXELS = TILE_PIXELS / WORKGROUP;
const uint QUADS = LANE_PIXELS / 4;

struct Tile {
    uvec2 corner;  // the tile's first pixel
    uint x;        // this lane's column, from the corner
    uint y;        // this lane's first row, from the corner
};

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

// A splat along one column of pixels: the exponent of alpha is top - (scale * (row - row_zero))^2.
struct Column {
    float f_x;      // whitened residual in x, the same for the whole column
    float top;
    float scale;
    float row_zero;
};

Column column_of(Tile t, vec4 shape, vec4 tone) {
    // Positions relative to the tile are small, and so is their rounding.
    precise vec2 mean = shape.xy - vec2(t.corner);
    precise float dx = float(t.x) + 0.5 - mean.x;
    Column c;
    precise float f_x = dx * tone.x;
    precise float top = shape.w - f_x * f_x;
    precise float row_zero = mean.y + shape.z * dx - float(t.y);
    c.f_x = f_x;
    c.top = top;
    c.scale = tone.y;
    c.row_zero = row_zero;
    return c;
}

// log2 of alpha before its cap, for quad `q`; `f` is the whitened residual in y.
vec4 exponent_of(Column c, uint q, out vec4 f) {
    precise vec4 residual = (vec4(0.5, 1.5, 2.5, 3.5) + float(q * 4) - c.row_zero) * c.scale;
    precise vec4 exponent = c.top - residual * residual;
    f = residual;
    return exponent;
}
