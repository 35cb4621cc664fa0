// Tiles that a splat touches: the pass that counts them and the pass that lists them must find the same ones. Needs
// `primitive.glsl` and `surfel.glsl`, and a `view`, LOG2_ALPHA_MIN, INRIA and SURFEL.

// Drawn region: the ellipse of a 3D Gaussian or its square, or the outline of a surfel.
struct Cover {
    Ellipse ellipse;
    Outline outline;
};

// Columns of the picture, and rows down to the last drawn one.
uvec2 drawn_end() {
    return uvec2(view.size.x, view.first_row + view.size.y);
}

// The region of a projected splat, and its drawn rows of tiles, counted from the picture's first.
Cover cover_of(vec4 shape, vec2 whiten, vec3 plane, float depth, out ivec2 rows) {
    Cover c;
    if (SURFEL != 0) {
        c.outline = outline(view, shape, whiten, plane, depth, LOG2_ALPHA_MIN);
        rows = outline_rows(c.outline, drawn_end());
    } else {
        c.ellipse = ellipse(shape, whiten, LOG2_ALPHA_MIN);
        if (INRIA != 0) c.ellipse.square = inria_square(shape, whiten);
        rows = tile_rows(c.ellipse, drawn_end());
    }
    rows.x = max(rows.x, int(view.first_row / TILE_HEIGHT));
    return c;
}

// Its columns of tiles in one row of tiles.
ivec2 columns_of(Cover c, int row) {
    return SURFEL != 0 ? outline_columns(c.outline, row, drawn_end()) : tile_columns(c.ellipse, row, drawn_end());
}
