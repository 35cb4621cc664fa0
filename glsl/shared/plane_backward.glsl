// Gradient by a splat from that by its plane: tilt and normal. Needs `plane.glsl` and `surfel.glsl`.

// Gradient by a normal n in the view, given that by the unit normal toward the camera; `along` is n . mean.
vec3 toward_backward(vec3 normal, float along, vec3 d_toward) {
    float inverse = inversesqrt(dot(normal, normal));
    vec3 unit = normal * inverse;
    vec3 d = (d_toward - unit * dot(unit, d_toward)) * inverse;
    return along > 0.0 ? -d : d;
}

// Gradient by a tilt from that by the tilt under the filter, t - k Q t; adds that by the axes on the screen to `d`.
vec2 filter_backward(View view, Footprint f, vec2 tilt, vec2 d_filtered, inout FootprintGradient d) {
    if (view.dilation == 0.0) return d_filtered;
    vec2 white = whitening(f);
    mat2 whiten = mat2(white.x, -f.slope * white.y, 0.0, white.y);
    vec2 a = transpose(whiten) * (whiten * d_filtered);
    vec2 b = transpose(whiten) * (whiten * tilt);
    // The symmetric part of k a b^T, times twice the axes.
    vec3 by_a = a.x * f.v_x + a.y * f.v_y;
    vec3 by_b = b.x * f.v_x + b.y * f.v_y;
    d.v_x += view.dilation * (b.x * by_a + a.x * by_b);
    d.v_y += view.dilation * (b.y * by_a + a.y * by_b);
    return d_filtered - view.dilation * a;
}

struct PlaneGradient {
    mat3 axes;
    vec3 log_scale;     // of the smoothed scales
    vec3 mean;          // by the mean in the world, through the line of sight
    vec3 mean_view;     // by the mean in the view, at a fixed line of sight
    vec2 mean_pixel;
};

// Of a 3D Gaussian. With o = offset / depth, the normal is n = R K R^T o with K = (least scale / scale)^2; tilt and
// unit normal do not depend on its length, so that the least scale is a constant, and so is the depth. `tilt` holds the
// sums of kappa and kappa d. A plane that was level or bounded for its slope has none.
PlaneGradient plane_backward(View view, mat3 axes, vec3 scale, vec3 offset, vec3 mean_view, vec3 tilt, vec3 d_toward) {
    PlaneGradient d = PlaneGradient(mat3(0.0), vec3(0.0), vec3(0.0), vec3(0.0), vec2(0.0));
    vec3 sight = offset / mean_view.z;
    vec3 ray = sight * axes;
    vec3 ratio = min(min(scale.x, scale.y), scale.z) / scale;
    vec3 share = ratio * ratio;
    vec3 local = share * ray;
    float along = dot(local, ray);
    vec3 normal = view.view_from_world * (axes * local);
    vec2 slope = normal.xy / along;
    bool is_bounded = !(max(abs(slope.x), abs(slope.y)) < SLOPE_MAX);
    if (is_bounded || !is_finite(vec3(slope, along))) return d;
    TiltGradient by_tilt = tilt_backward(view, normal, mean_view, along * mean_view.z, tilt.yz);
    vec3 d_normal = by_tilt.normal + toward_backward(normal, along, d_toward);
    vec3 d_world = d_normal * view.view_from_world;
    vec3 d_local = d_world * axes;
    d.axes = outerProduct(d_world, local) + outerProduct(sight, share * d_local);
    d.log_scale = -2.0 * local * d_local;
    d.mean = (axes * (share * d_local)) / mean_view.z;
    d.mean_view = by_tilt.mean;
    d.mean_pixel = -tilt.x * slope / view.focal;
    return d;
}
