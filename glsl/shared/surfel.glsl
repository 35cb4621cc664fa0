// Surfels: flat Gaussians that each pixel's ray meets in their own plane. With d = pixel - mean, W the whitening matrix
// of the projection of the two axes at the mean, and the tilt h of the plane, a ray meets the plane at
//   depth z = z0 w with w = 1 / (1 + h . d), and the coordinates in standard deviations are w W d:
// the ellipse of `primitive.glsl` in perspective, exactly.
//
// Without the mip filter a surfel counts at least as a spot of half a squared pixel about its mean (2DGS, section 4.2);
// with it, the ellipse is dilated, and the tilt is that under the filter.
//
// Needs `primitive.glsl` and `plane.glsl`.

// Cosine between line of sight and normal below which a surfel is edge-on: there, rounding is as large as its shape.
const float EDGE_COSINE = 1e-3;
// Whitening factor of a surfel that is only a spot: no pixel hits it but in the middle.
const float SPOT_WHITEN = 1e6;
// Radius at which alpha is 1/255 at an opacity of 1, in standard deviations, and a little more for rounding.
const float SURFEL_RADIUS = 3.34;
// Share of the disc's depth over z0 up to which its outline is the ellipse in closed form, squared.
const float OUTLINE_MAX = 0.9;

// Removes what surfels do not have: the third scale, and the filter along it.
void flatten(inout Smoothed s) {
    s.scale.z = 0.0;
    s.own.z = 1.0;
    s.added.z = 0.0;
}

// Footprint of a surfel; its area by the plane's distance from the camera, `along`, which does not cancel.
Footprint surfel_footprint(View view, vec3 v_x, vec3 v_y, vec3 scale, float depth, float along) {
    Footprint f = footprint(v_x, v_y, view.dilation);
    float area = (view.focal.x * scale.x / depth) * (view.focal.y * scale.y / depth) * (along / depth);
    f.minors = vec3(0.0, 0.0, area);
    f.det = area * area + view.dilation * (dot(v_x, v_x) + dot(v_y, v_y)) + view.dilation * view.dilation;
    return f;
}

// Tilt of a surfel with its normal in the view, and variance of the filter; `along` is normal . mean.
vec3 surfel_plane(View view, vec3 normal, float depth, float along) {
    return vec3(depth / along * normal.xy / view.focal, view.dilation);
}

// Tilt under the filter: with the covariance S on the screen and the filter's variance k, (S + k)^-1 S times that of
// the plane. A pixel sees the mean depth of all that the filter brings there; what is seen edge-on is level.
vec2 filtered_tilt(vec2 tilt, float filter_variance, float slope, vec2 whiten) {
    // With Q = W^T W the inverse of S + k, tilt - k Q tilt.
    precise vec2 w = whiten / WHITEN;
    precise float x = w.x * tilt.x;
    precise float y = w.y * (tilt.y - slope * tilt.x);
    precise vec2 lost = filter_variance * vec2(w.x * x - slope * (w.y * y), w.y * y);
    precise vec2 left = tilt - lost;
    return left;
}

// True if a surfel is only a spot: it is edge-on, or too small for its ellipse.
bool is_spot(vec2 whiten, float along, float distance) {
    bool is_shaped = is_finite(vec3(whiten, 0.0)) && max(whiten.x, whiten.y) < SPOT_WHITEN;
    return !is_shaped || abs(along) < EDGE_COSINE * distance;
}

// Drawn region of a surfel, from the stored shape, tone and plane: the pass that counts tiles and the pass that lists
// them must read the same floats.
struct Outline {
    Ellipse ellipse;    // of the hits, if not boxed
    bool boxed;         // the hits reach so near to the camera that a box bounds them
    vec2 low;           // the box, pixels from the mean
    vec2 high;
    vec2 mean;
    float spot;         // radius of the spot, or 0
};

// Bounds of the hits within radius `reach` in front of the near plane: those of a square with a side along the tilt.
void box_of(inout Outline o, vec2 axis_x, vec2 axis_y, vec2 tilt, float reach, float nearest) {
    // Depth is z0 (1 - along . g) at the whitened position g.
    vec2 along = vec2(dot(axis_x, tilt), dot(axis_y, tilt));
    float slope = length(along);
    vec2 uphill = along / slope;
    float far = min(reach, (1.0 - nearest) / slope);
    o.low = vec2(1e30);
    o.high = vec2(-1e30);
    [[unroll]] for (uint corner = 0; corner < 4; ++corner) {
        precise float s = (corner & 1) != 0 ? far : -reach;
        precise float t = (corner & 2) != 0 ? reach : -reach;
        precise vec2 g = s * uphill + t * vec2(-uphill.y, uphill.x);
        precise vec2 d = (g.x * axis_x + g.y * axis_y) / (1.0 - slope * s);
        o.low = min(o.low, d);
        o.high = max(o.high, d);
    }
    // Rounding never drops a pixel on the rim.
    precise vec2 margin = 1e-4 * (o.high - o.low) + 1e-2;
    o.low -= margin;
    o.high += margin;
}

// Region where alpha is at least 2^log2_alpha_min. Hits within c standard deviations fill
// { d^T Q d <= c^2 (1 + h . d)^2 }, an ellipse while the disc is in front of the camera.
Outline outline(View view, vec4 shape, vec2 whiten, vec3 plane, float depth, float log2_alpha_min) {
    Outline o;
    precise float a = (WHITEN / whiten.x) * (WHITEN / whiten.x);
    precise float y_from_x = (WHITEN / whiten.y) * (WHITEN / whiten.y);
    precise float across = shape.z * a;
    precise float yy = y_from_x + shape.z * across;
    // Slightly wider than exact, so that rounding never drops a pixel on the rim.
    precise float level = max(shape.w - log2_alpha_min, 0.0) * (1.00001 / (WHITEN * WHITEN)) + 1e-5;
    precise vec2 tilt = filtered_tilt(plane.xy, plane.z, shape.z, whiten);
    precise vec2 lean = vec2(a * tilt.x + across * tilt.y, across * tilt.x + yy * tilt.y);
    precise float share = level * dot(tilt, lean);
    o.mean = shape.xy;
    o.spot = view.compensate != 0 ? 0.0 : sqrt(0.5 * level);
    o.boxed = !(share < OUTLINE_MAX);
    if (o.boxed) {
        vec2 axis_x = (WHITEN / whiten.x) * vec2(1.0, shape.z);
        vec2 axis_y = vec2(0.0, WHITEN / whiten.y);
        box_of(o, axis_x, axis_y, tilt, sqrt(level), clamp(view.near_plane / depth, 1e-6, 1.0));
        return o;
    }
    precise float rest = 1.0 - share;
    precise float scale = level / rest;
    precise float a_seen = a + scale * lean.x * lean.x;
    precise float across_seen = across + scale * lean.x * lean.y;
    precise float yy_seen = yy + scale * lean.y * lean.y;
    // The rounding of the share counts over the rest.
    precise float level_seen = scale * (1.0 + 2e-5 / rest);
    o.ellipse.mean = shape.xy + scale * lean;
    o.ellipse.slope_x = across_seen / a_seen;
    o.ellipse.slope_y = across_seen / yy_seen;
    o.ellipse.level = level_seen;
    o.ellipse.yy = yy_seen;
    o.ellipse.x_from_y = a * y_from_x / rest / yy_seen;
    o.ellipse.extent = vec2(sqrt(level_seen * a_seen), sqrt(level_seen * yy_seen));
    o.ellipse.square = 0.0;
    return o;
}

// Smallest range over two, each empty if its first is beyond its last.
ivec2 hull(ivec2 a, ivec2 b) {
    if (a.x > a.y) return b;
    if (b.x > b.y) return a;
    return ivec2(min(a.x, b.x), max(a.y, b.y));
}

// Rows of tiles touched by a surfel.
ivec2 outline_rows(Outline o, uvec2 size) {
    precise float low = o.mean.y + o.low.y;
    precise float high = o.mean.y + o.high.y;
    ivec2 rows = o.boxed ? cells(low, high, TILE_HEIGHT, size.y) : tile_rows(o.ellipse, size);
    if (o.spot <= 0.0) return rows;
    precise float top = o.mean.y - o.spot;
    precise float bottom = o.mean.y + o.spot;
    return hull(rows, cells(top, bottom, TILE_HEIGHT, size.y));
}

// Columns of tiles in one row of tiles touched by a surfel. Both regions contain the mean: no gap is between them.
ivec2 outline_columns(Outline o, int row, uvec2 size) {
    // The row's first and last pixel centres in the image.
    float first = float(row) * float(TILE_HEIGHT) + 0.5;
    float last = min(float(row + 1) * float(TILE_HEIGHT), float(size.y)) - 0.5;
    ivec2 columns = ivec2(1, 0);
    if (o.boxed) {
        precise float left = o.mean.x + o.low.x;
        precise float right = o.mean.x + o.high.x;
        bool touched = first <= o.mean.y + o.high.y && last >= o.mean.y + o.low.y;
        if (touched) columns = cells(left, right, TILE_WIDTH, size.x);
    } else if (first <= o.ellipse.mean.y + o.ellipse.extent.y && last >= o.ellipse.mean.y - o.ellipse.extent.y) {
        columns = tile_columns(o.ellipse, row, size);
    }
    if (o.spot <= 0.0) return columns;
    precise float y = clamp(o.mean.y, first, last) - o.mean.y;
    if (abs(y) > o.spot) return columns;
    precise float half_width = sqrt(max(o.spot * o.spot - y * y, 0.0)) + 1e-3;
    precise float left = o.mean.x - half_width;
    precise float right = o.mean.x + half_width;
    return hull(columns, cells(left, right, TILE_WIDTH, size.x));
}

// Sums over pixels for the gradient of one surfel beside those of `Sums`, whose residuals are those of the hits. With
// s = alpha * dL/d alpha and kappa = dL/d (h . d) = s rho w:
struct SurfelSums {
    vec3 tilt;  // kappa, kappa d
    vec2 spot;  // s d of the pixels where the spot counts
};

// Gradients of normal and mean in the view by that of the tilt.
struct TiltGradient {
    vec3 normal;
    vec3 mean;
};

TiltGradient tilt_backward(View view, vec3 normal, vec3 mean_view, float along, vec2 d_tilt) {
    // h = z0 e / D with e = normal.xy / focal and D = normal . mean.
    vec2 by_focal = d_tilt / view.focal;
    float pull = dot(by_focal, normal.xy) / along;
    TiltGradient d;
    d.normal = (mean_view.z / along) * (vec3(by_focal, 0.0) - pull * mean_view);
    d.mean = vec3(0.0, 0.0, pull) - (mean_view.z / along * pull) * normal;
    return d;
}
