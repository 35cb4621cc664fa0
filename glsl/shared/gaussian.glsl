// Projection of a 3D Gaussian to its ellipse on the screen, and the tiles that the ellipse touches.

bool is_finite(float x) {
    // Integer arithmetic: a compiler may assume that floats are never NaN.
    return (floatBitsToUint(x) & 0x7f800000u) != 0x7f800000u;
}

bool is_finite(vec3 v) {
    return is_finite(v.x) && is_finite(v.y) && is_finite(v.z);
}

bool is_finite(vec4 v) {
    return is_finite(v.xyz) && is_finite(v.w);
}

// 1 / (1 + exp(-u)) without overflow at either end.
float sigmoid(float u) {
    float e = exp(-abs(u));
    return (u >= 0.0 ? 1.0 : e) / (1.0 + e);
}

// Length of a quaternion, safe over the whole range of floats.
float quaternion_length(vec4 q) {
    float m = max(max(abs(q.x), abs(q.y)), max(abs(q.z), abs(q.w)));
    return m > 0.0 ? m * length(q / m) : 0.0;
}

// Length of a vector, safe over the whole range of floats. The scale is a power of two, so that the result equals the
// plain length bit for bit unless that overflows or underflows.
float vector_length(vec3 v) {
    float m = max(max(abs(v.x), abs(v.y)), abs(v.z));
    float unit = uintBitsToFloat(floatBitsToUint(m) & 0x7f800000u);
    return unit > 0.0 ? unit * length(v / unit) : 0.0;
}

// Rotation matrix of a unit quaternion (w, x, y, z); columns are the local axes in the world.
mat3 rotation_matrix(vec4 q) {
    float w = q.x, x = q.y, y = q.z, z = q.w;
    return mat3(
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y),
        2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x),
        2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y));
}

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

// Columns of tiles in one row of tiles touched by the ellipse or its square.
ivec2 tile_columns(Ellipse e, int row, uvec2 size) {
    if (e.square > 0.0) return inria_tiles(e.mean.x, e.square, TILE_WIDTH, size.x);
    // The strip between the row's first and last pixel centres in the image, clipped to the ellipse.
    precise float top = max(float(row) * float(TILE_HEIGHT) + 0.5 - e.mean.y, -e.extent.y);
    float end = min(float(row + 1) * float(TILE_HEIGHT), float(size.y));
    precise float bottom = min(end - 0.5 - e.mean.y, e.extent.y);
    precise float reach = e.slope_x * e.extent.x;
    precise float y_right = clamp(reach, top, bottom);
    precise float y_left = clamp(-reach, top, bottom);
    precise float half_right = sqrt(max(e.level - y_right * y_right / e.yy, 0.0) * e.x_from_y);
    precise float half_left = sqrt(max(e.level - y_left * y_left / e.yy, 0.0) * e.x_from_y);
    precise float right = e.mean.x + e.slope_y * y_right + half_right + 1e-3;
    precise float left = e.mean.x + e.slope_y * y_left - half_left - 1e-3;
    return cells(left, right, TILE_WIDTH, size.x);
}
