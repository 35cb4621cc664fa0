// Everything that depends on the kind of splat: footprint, extent, exponent and depth at a pixel, and the exponent's
// gradient; here of a 3D Gaussian with its ellipse on the screen, of surfels in `surfel.glsl`. The screen filter is
// apart: its dilation is an argument.

// The rows of J W: pixels per world unit, at the direction x/z, y/z clamped to the view's limits.
struct Jacobian {
    vec3 row_x;
    vec3 row_y;
    vec2 slope;         // clamped x/z, y/z
    bvec2 inside;       // true if not clamped
};

Jacobian jacobian(View view, vec3 mean_view) {
    Jacobian j;
    vec2 raw = mean_view.xy / mean_view.z;
    j.slope = clamp(raw, view.limit.xz, view.limit.yw);
    j.inside = equal(j.slope, raw);
    vec3 w0 = vec3(view.view_from_world[0][0], view.view_from_world[1][0], view.view_from_world[2][0]);
    vec3 w1 = vec3(view.view_from_world[0][1], view.view_from_world[1][1], view.view_from_world[2][1]);
    vec3 w2 = vec3(view.view_from_world[0][2], view.view_from_world[1][2], view.view_from_world[2][2]);
    j.row_x = (view.focal.x / mean_view.z) * (w0 - j.slope.x * w2);
    j.row_y = (view.focal.y / mean_view.z) * (w1 - j.slope.y * w2);
    return j;
}

// The same of an orthographic projection: all directions are that of the view's z axis.
Jacobian parallel_jacobian(View view) {
    mat3 axes = transpose(view.view_from_world);
    return Jacobian(view.focal.x * axes[0], view.focal.y * axes[1], vec2(0.0), bvec2(true));
}

// A splat's standard deviations after the 3D smoothing filter of Mip-Splatting (section 5.1), a convolution with a
// round Gaussian of standard deviation `sigma` (0: none), below the resolution of the training views.
struct Smoothed {
    vec3 scale;
    vec3 own;           // the splat's share of each variance
    vec3 added;         // the filter's share
};

Smoothed smoothed(vec3 scale, float sigma) {
    Smoothed s = Smoothed(scale, vec3(1.0), vec3(0.0));
    if (!(sigma > 0.0)) return s;
    // Squares of lengths would leave the range of floats in scenes of very small or large units.
    vec3 more = max(scale, vec3(sigma));
    vec3 ratio = min(scale, vec3(sigma)) / more;
    s.scale = more * sqrt(1.0 + ratio * ratio);
    s.own = scale / s.scale * (scale / s.scale);
    s.added = sigma / s.scale * (sigma / s.scale);
    return s;
}

// log2 of the opacity's factor that keeps smoothing from adding light.
float log_smoothing(Smoothed s) {
    return 0.5 * (log2(s.own.x) + log2(s.own.y) + log2(s.own.z));
}

// Screen covariance in a form without cancellation: V = J W R S has the covariance V V^T + dilation, with a sum of
// squares as determinant (Cauchy-Binet).
struct Footprint {
    vec3 v_x;           // rows of V
    vec3 v_y;
    float a;            // covariance xx, px^2
    float slope;        // covariance xy / xx
    float det;
    vec3 minors;        // v_x x v_y; its squared length is the determinant without dilation
};

Footprint footprint(vec3 v_x, vec3 v_y, float dilation) {
    Footprint f;
    f.v_x = v_x;
    f.v_y = v_y;
    float xx = dot(v_x, v_x);
    vec3 minors = cross(v_x, v_y);
    f.a = xx + dilation;
    f.slope = dot(v_x, v_y) / f.a;
    f.minors = minors;
    f.det = dot(minors, minors) + dilation * (xx + dot(v_y, v_y)) + dilation * dilation;
    return f;
}

// Whitening factors of a pixel's distance from the mean: of x, and of y - slope x.
vec2 whitening(Footprint f) {
    return vec2(inversesqrt(f.a), sqrt(f.a / f.det));
}

// log2 of the opacity's factor that keeps dilation from adding light: sqrt(det without / det with it).
float log_compensation(Footprint f) {
    return 0.5 * log2(dot(f.minors, f.minors) / f.det);
}

// Drawn region of a splat, from the stored shape and tone: the pass that counts tiles and the pass that lists them must
// read the same floats.
struct Ellipse {
    vec2 mean;
    vec2 extent;        // half size of the bounding box, px
    float slope_x;      // y at the rightmost point / extent.x
    float slope_y;      // x at the topmost point / extent.y
    float level;        // squared Mahalanobis radius
    float yy;           // covariance yy
    float x_from_y;     // variance of x at fixed y
    float square;       // half the side of the square of the 3DGS code's rule, or 0 for an ellipse
};

// Region where alpha is at least 2^log2_alpha_min.
Ellipse ellipse(vec4 shape, vec2 whiten, float log2_alpha_min) {
    Ellipse e;
    precise float a = (WHITEN / whiten.x) * (WHITEN / whiten.x);
    precise float y_from_x = (WHITEN / whiten.y) * (WHITEN / whiten.y);
    precise float yy = y_from_x + shape.z * shape.z * a;
    // Slightly wider than exact, so that rounding never drops a pixel on the rim.
    precise float reach = max(shape.w - log2_alpha_min, 0.0) * (1.0 / (WHITEN * WHITEN));
    precise float level = reach * 1.00001 + 1e-5;
    e.mean = shape.xy;
    e.slope_x = shape.z;
    e.slope_y = shape.z * a / yy;
    e.level = level;
    e.yy = yy;
    e.x_from_y = a * y_from_x / yy;
    e.extent = vec2(sqrt(level * a), sqrt(level * yy));
    e.square = 0.0;
    return e;
}

// Half the side of the 3DGS code's square: three of the splat's largest standard deviations.
float inria_square(vec4 shape, vec2 whiten) {
    precise float a = (WHITEN / whiten.x) * (WHITEN / whiten.x);
    precise float y_from_x = (WHITEN / whiten.y) * (WHITEN / whiten.y);
    precise float yy = y_from_x + shape.z * shape.z * a;
    precise float difference = 0.5 * (a - yy);
    precise float across = shape.z * a;
    precise float largest = 0.5 * (a + yy) + sqrt(max(difference * difference + across * across, 0.1));
    return ceil(3.0 * sqrt(largest));
}

// First and last of the engine's tiles of `tile` pixels along an axis, within the 16-pixel tiles of the 3DGS code's
// square. That code has pixel centres at integers.
ivec2 inria_tiles(float mean, float square, uint tile, uint pixel_count) {
    float count = float((pixel_count + 15) / 16);
    precise float place = mean - 0.5;
    float first = clamp(trunc((place - square) / 16.0), 0.0, count);
    float end = clamp(trunc((place + square + 15.0) / 16.0), 0.0, count);
    if (!(first < end)) return ivec2(1, 0);
    int last_tile = int((pixel_count + tile - 1) / tile) - 1;
    return ivec2(int(first) * 16 / int(tile), min(int(end) * 16 / int(tile) - 1, last_tile));
}

// First and last index of the cells of `cell` pixels, among `count`, with a pixel centre in [low, high]; first > last
// if there is none. Clamped as floats: conversions out of range are undefined.
ivec2 cells(float low, float high, uint cell, uint pixel_count) {
    float first = clamp(ceil(low - 0.5), 0.0, float(pixel_count));
    float last = clamp(floor(high - 0.5), -1.0, float(pixel_count) - 1.0);
    if (!(first <= last)) return ivec2(1, 0);
    return ivec2(int(first) / int(cell), int(last) / int(cell));
}

// Rows of tiles touched by the ellipse or its square.
ivec2 tile_rows(Ellipse e, uvec2 size) {
    if (e.square > 0.0) return inria_tiles(e.mean.y, e.square, TILE_HEIGHT, size.y);
    precise float low = e.mean.y - e.extent.y;
    precise float high = e.mean.y + e.extent.y;
    return cells(low, high, TILE_HEIGHT, size.y);
}

// Part of the rows from `first` to `last`, in pixels of the picture, within the ellipse: from its mean; empty if x > y.
vec2 strip_of(Ellipse e, float first, float last) {
    precise float top = max(first - e.mean.y, -e.extent.y);
    precise float bottom = min(last - e.mean.y, e.extent.y);
    return vec2(top, bottom);
}

// Leftmost and rightmost place of the ellipse in a strip, slightly wider than exact.
vec2 sides_in(Ellipse e, vec2 strip) {
    precise float reach = e.slope_x * e.extent.x;
    precise float y_right = clamp(reach, strip.x, strip.y);
    precise float y_left = clamp(-reach, strip.x, strip.y);
    precise float half_right = sqrt(max(e.level - y_right * y_right / e.yy, 0.0) * e.x_from_y);
    precise float half_left = sqrt(max(e.level - y_left * y_left / e.yy, 0.0) * e.x_from_y);
    precise float right = e.mean.x + e.slope_y * y_right + half_right + 1e-3;
    precise float left = e.mean.x + e.slope_y * y_left - half_left - 1e-3;
    return vec2(left, right);
}

// Columns of tiles in one row of tiles touched by the ellipse or its square.
ivec2 tile_columns(Ellipse e, int row, uvec2 size) {
    if (e.square > 0.0) return inria_tiles(e.mean.x, e.square, TILE_WIDTH, size.x);
    // The strip between the row's first and last pixel centres in the image.
    float end = min(float(row + 1) * float(TILE_HEIGHT), float(size.y));
    vec2 strip = strip_of(e, float(row) * float(TILE_HEIGHT) + 0.5, end - 0.5);
    vec2 sides = sides_in(e, strip);
    return cells(sides.x, sides.y, TILE_WIDTH, size.x);
}

// A splat along one column of pixels: the exponent of alpha is top - (scale * (row - row_zero))^2. Forward and backward
// share this, for equal alphas; so do all divisions of a tile among lanes, since rows count from the tile's corner.
struct Column {
    float f_x;      // whitened residual in x, the same for the whole column
    float top;
    float scale;
    float row_zero;
    float row;      // the lane's first row
};

Column column_of(Tile t, vec4 shape, vec4 tone) {
    // Positions relative to the tile are small, and so is their rounding.
    precise vec2 mean = shape.xy - vec2(t.corner);
    precise float dx = float(t.x) + 0.5 - mean.x;
    Column c;
    precise float f_x = dx * tone.x;
    precise float top = shape.w - f_x * f_x;
    precise float row_zero = mean.y + shape.z * dx;
    c.f_x = f_x;
    c.top = top;
    c.scale = tone.y;
    c.row_zero = row_zero;
    c.row = float(t.y);
    return c;
}

// log2 of alpha before its cap, for quad `q`; `f` is the whitened residual in y.
vec4 exponent_of(Column c, uint q, out vec4 f) {
    precise vec4 residual = (vec4(0.5, 1.5, 2.5, 3.5) + (c.row + float(q * 4)) - c.row_zero) * c.scale;
    precise vec4 exponent = c.top - residual * residual;
    f = residual;
    return exponent;
}

// The same in one row, from the lane's first.
float exponent_in_row(Column c, uint row, out float f) {
    precise float residual = (0.5 + (c.row + float(row)) - c.row_zero) * c.scale;
    precise float exponent = c.top - residual * residual;
    f = residual;
    return exponent;
}

// log2 of a splat's alpha before its cap, at a pixel of the tile; `corner` is the tile's first pixel.
float exponent_at(uvec2 in_tile, uvec2 corner, vec4 shape, vec4 tone) {
    // Positions relative to the tile are small, and so is their rounding.
    precise vec2 mean = shape.xy - vec2(corner);
    precise vec2 d = vec2(in_tile) + 0.5 - mean;
    precise float f_x = d.x * tone.x;
    precise float f_y = (d.y - shape.z * d.x) * tone.y;
    precise float exponent = shape.w - f_x * f_x - f_y * f_y;
    return exponent;
}

// Depth of a splat at a pixel: that of its mean.
float depth_of(vec2 rest) {
    return rest.y;
}

// Sums over pixels for the gradient of one splat. With s = alpha * dL/d alpha and the whitened residual f = WHITEN * e:
// sums of s, s f, s f f^T, and of the blending weight times the upstream gradient.
struct Sums {
    vec4 shape;  // s, s f_x, s f_y, s f_x f_x
    vec4 tone;   // s f_x f_y, s f_y f_y, red, green
    float rest;  // blue
};

// Sums over the quads of a column, each with the gradient s by the exponents and the residual f in y.
struct Moments {
    vec4 s;
    vec4 sf;
    vec4 sff;
};

void add_moments(inout Moments m, vec4 s, vec4 f) {
    m.s += s;
    s *= f;
    m.sf += s;
    m.sff += s * f;
}

// The exponent's part of the sums; colours are 0.
Sums sums_of(Moments m, Column c) {
    const vec4 one = vec4(1.0);
    float sum = dot(m.s, one);
    float sum_y = dot(m.sf, one);
    vec4 shape = vec4(sum, sum * c.f_x, sum_y, sum * c.f_x * c.f_x);
    return Sums(shape, vec4(sum_y * c.f_x, dot(m.sff, one), 0.0, 0.0), 0.0);
}

struct FootprintGradient {
    vec2 mean_pixel;
    vec3 v_x;
    vec3 v_y;
};

// Gradient of the footprint and the mean's pixel, from a splat's sums.
FootprintGradient footprint_backward(Footprint f, Sums sums) {
    // The whitening matrix [[p, 0], [-slope q, q]], e = matrix * (pixel - mean); first and second moments
    // of e, weighted by s.
    vec2 white = whitening(f);
    float p = white.x;
    float q = white.y;
    vec2 first = sums.shape.yz / WHITEN;
    vec3 second = vec3(sums.shape.w, sums.tone.xy) / (WHITEN * WHITEN);  // xx, xy, yy
    FootprintGradient d;
    d.mean_pixel = vec2(first.x * p - first.y * f.slope * q, first.y * q);
    // dL/dV = W^T M (W V): whitened moments stay accurate for needles, where an inverse covariance cancels.
    vec3 white_x = p * f.v_x;
    vec3 white_y = q * (f.v_y - f.slope * f.v_x);
    vec3 moved_x = second.x * white_x + second.y * white_y;
    vec3 moved_y = second.y * white_x + second.z * white_y;
    d.v_x = p * moved_x - q * f.slope * moved_y;
    d.v_y = q * moved_y;
    return d;
}
