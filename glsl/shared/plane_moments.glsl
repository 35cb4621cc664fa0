// Gradients of a pixel's depths and normals by the planes of its splats. Needs `plane.glsl` and `surfel_column.glsl`.

// Gradient by the surface of the pixels of a quad.
struct SurfaceGradient {
    vec4 coverage;
    vec4 depth;         // by the sum of weight * z
    vec4 normal_x;      // by the sums of weight * normal
    vec4 normal_y;
    vec4 normal_z;
    vec4 spread;        // by the variance of ln z, times the coverage
    vec4 center;        // depth with the mean of ln z
    vec4 variance;      // that variance
};

// Depths of a plane at the pixels of a quad.
struct PlaneDepths {
    vec4 depth;
    vec4 by_mean;       // d depth / d z0
    vec4 by_tilt;       // d depth / d (tilt . d)
};

// The range of a plane is a constant, a share of the mean's depth.
PlaneDepths plane_depths(PlaneColumn c, uint q) {
    vec4 tilt = c.tilt_zero + c.tilt_row * (vec4(0.0, 1.0, 2.0, 3.0) + float(q * 4));
    PlaneDepths at;
    at.depth = depth_of(c, q);
    at.by_mean = at.depth / c.depth;
    at.by_tilt = mix(vec4(0.0), -at.depth * at.by_mean, lessThan(abs(tilt), vec4(c.range)));
    return at;
}

PlaneDepths plane_depths(PlaneColumn c, Hits hits, float near_plane) {
    PlaneDepths at;
    at.depth = depth_of_hits(c, hits, near_plane);
    if (SURFEL == SURFEL_MIP) {
        at.by_mean = hits.w;
        at.by_tilt = -at.depth * hits.w;
        return at;
    }
    at.by_mean = mix(at.depth / c.depth, vec4(0.0), lessThanEqual(at.depth, vec4(near_plane)));
    vec4 free = c.depth / max(hits.inverse, vec4(1e-6));
    at.by_tilt = mix(vec4(0.0), -at.depth * at.by_mean, equal(free, at.depth));
    return at;
}

// Derivative of the objective by the weight of a splat in front of the others; `by_depth`: its derivative by the depth.
vec4 ahead_of(SurfaceGradient d, vec4 depth, vec3 normal, bool with_spread, out vec4 by_depth) {
    vec4 ahead = d.coverage + d.depth * depth;
    ahead += d.normal_x * normal.x + d.normal_y * normal.y + d.normal_z * normal.z;
    by_depth = d.depth;
    if (with_spread) {
        vec4 m = log(depth / d.center);
        ahead += d.spread * (m * m - d.variance);
        by_depth += 2.0 * d.spread * m / depth;
    }
    return ahead;
}

// Sums over the quads of a column.
struct PlaneMoments {
    vec4 kappa;         // dL/d (tilt . d)
    vec4 kappa_y;
    vec4 depth;
    vec4 normal_x;
    vec4 normal_y;
    vec4 normal_z;
};

void add_plane_moments(inout PlaneMoments m, PlaneColumn c, uint q, vec4 weight, vec4 by_depth, PlaneDepths at,
                       SurfaceGradient d) {
    vec4 kappa = by_depth * at.by_tilt;
    m.kappa += kappa;
    m.kappa_y += kappa * (c.d.y + vec4(0.0, 1.0, 2.0, 3.0) + float(q * 4));
    m.depth += by_depth * at.by_mean;
    m.normal_x += weight * d.normal_x;
    m.normal_y += weight * d.normal_y;
    m.normal_z += weight * d.normal_z;
}

// kappa, and kappa times the distance from the mean.
vec3 tilt_of(PlaneMoments m, PlaneColumn c) {
    const vec4 one = vec4(1.0);
    float kappa = dot(m.kappa, one);
    return vec3(kappa, kappa * c.d.x, dot(m.kappa_y, one));
}

// Gradients by the mean's depth and by the normal.
vec4 surface_of(PlaneMoments m) {
    const vec4 one = vec4(1.0);
    return vec4(dot(m.depth, one), dot(m.normal_x, one), dot(m.normal_y, one), dot(m.normal_z, one));
}
