// Plane of a splat: the tangent plane of its Gaussian at the mean that is conjugate to the line of sight. With
// d = pixel - mean, the depth of the plane at a pixel is depth / (1 + tilt . d): the Gaussian's maximum along the ray,
// but for a relative error of (distance of the ray / distance of the camera)^2, both in standard deviations.
//
// Stored as vec3: tilt in 1/px, and the largest |tilt . d|: that of three standard deviations; of surfels, the variance
// of the screen's filter.

// Largest |tilt . d|, so that depths stay positive.
const float TILT_RANGE_MAX = 0.9;
// Largest slope of a plane against the image: squares of slopes stay in the range of floats.
const float SLOPE_MAX = 1e6;

// `axes` are the splat's in the world, `offset` is its mean from the camera, `f` its footprint. A plane beyond the
// range of floats, edge-on, is level instead.
vec3 plane_of(View view, mat3 axes, vec3 scale, vec3 offset, float depth, Footprint f) {
    // The inverse covariance times the line of sight, up to a factor: with exponents of at most 1 nothing overflows.
    vec3 ray = (offset / depth) * axes;
    vec3 ratio = min(min(scale.x, scale.y), scale.z) / scale;
    vec3 normal = ratio * ratio * ray;
    // A sum of squares: no cancellation.
    float along = dot(normal, ray);
    vec2 slope = (view.view_from_world * (axes * normal)).xy / along;
    slope *= min(1.0, SLOPE_MAX / max(max(abs(slope.x), abs(slope.y)), 1e-30));
    vec2 tilt = slope / view.focal;
    float range = min(3.0 * length(tilt.x * f.v_x + tilt.y * f.v_y), TILT_RANGE_MAX);
    vec3 plane = vec3(tilt, range);
    return is_finite(plane) ? plane : vec3(0.0);
}

// Unit normal in the view, toward the camera. `lens` is focal length and principal point, pixels.
vec3 normal_of(vec3 plane, vec2 mean, vec4 lens) {
    vec3 normal = vec3(plane.xy * lens.xy, 1.0 - dot(plane.xy, mean - lens.zw));
    return -normal * inversesqrt(dot(normal, normal));
}

// A plane along one column of pixels.
struct PlaneColumn {
    float tilt_zero;  // tilt . d at the lane's first row
    float tilt_row;   // its step from row to row
    float range;
    float depth;
    vec2 d;           // the lane's first pixel from the mean
};

PlaneColumn plane_column_of(Tile t, vec3 plane, vec2 mean_pixel, float depth) {
    // Positions relative to the tile are small, and so is their rounding.
    vec2 mean = mean_pixel - vec2(t.corner);
    vec2 d = vec2(t.x, t.y) + 0.5 - mean;
    return PlaneColumn(dot(plane.xy, d), plane.y, plane.z, depth, d);
}

// Depth of the plane at the pixels of quad `q`.
vec4 depth_of(PlaneColumn c, uint q) {
    vec4 tilt = c.tilt_zero + c.tilt_row * (vec4(0.0, 1.0, 2.0, 3.0) + float(q * 4));
    return c.depth / (1.0 + clamp(tilt, -c.range, c.range));
}
