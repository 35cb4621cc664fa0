// Surfels along a column of pixels: hits, exponents and their sums. Needs `tile.glsl` and `surfel.glsl`.

// Residual where nothing is hit.
const float NO_HIT = 1e9;

// A surfel along one column of pixels, beside its `Column`.
struct SurfelColumn {
    float log_opacity;  // log2
    vec2 d;             // first pixel of the lane from the mean
    float zero;         // 1 + h . d there
    float row;          // its step from row to row
    float nearest;      // largest 1 + h . d in front of the near plane
    bool has_spot;
};

SurfelColumn surfel_column_of(Tile t, vec4 shape, vec2 whiten, vec3 plane, float depth, View view) {
    SurfelColumn c;
    precise vec2 tilt = filtered_tilt(plane.xy, plane.z, shape.z, whiten);
    // Positions relative to the tile are small, and so is their rounding.
    precise vec2 mean = shape.xy - vec2(t.corner);
    precise vec2 d = vec2(t.x, t.y) + 0.5 - mean;
    precise float zero = 1.0 + dot(tilt, d);
    c.log_opacity = shape.w;
    c.d = d;
    c.zero = zero;
    c.row = tilt.y;
    c.nearest = depth / view.near_plane;
    c.has_spot = SURFEL == SURFEL_ANY && view.compensate == 0;
    return c;
}

vec4 surfel_d_y(SurfelColumn c, uint q) {
    return c.d.y + vec4(0.0, 1.0, 2.0, 3.0) + float(q * 4);
}

// Hits of the pixels of a quad.
struct Hits {
    vec4 inverse;       // 1 + h . d
    vec4 w;             // depth over z0, 0 without a hit
    vec4 residual;      // squared and whitened, as it counts
    bvec4 is_spot;      // true where the spot counts, not the hit
};

// log2 of alpha before its cap, for quad `q` with the residual `f` in y of `exponent_of`. Forward and backward share
// this, for equal alphas.
vec4 surfel_exponent(Column column, SurfelColumn c, uint q, vec4 f, out Hits hits) {
    precise vec4 inverse = c.zero + c.row * (vec4(0.0, 1.0, 2.0, 3.0) + float(q * 4));
    bvec4 hit = both(greaterThan(inverse, vec4(0.0)), lessThanEqual(inverse, vec4(c.nearest)));
    precise vec4 w = mix(vec4(0.0), 1.0 / inverse, hit);
    precise vec4 flat_residual = mix(vec4(NO_HIT), w * w * (column.f_x * column.f_x + f * f), hit);
    hits.inverse = inverse;
    hits.w = w;
    hits.residual = flat_residual;
    hits.is_spot = bvec4(false);
    if (c.has_spot) {
        precise vec4 d_y = surfel_d_y(c, q);
        precise vec4 spot = (2.0 * WHITEN * WHITEN) * (c.d.x * c.d.x + d_y * d_y);
        hits.is_spot = lessThan(spot, flat_residual);
        hits.residual = min(spot, flat_residual);
    }
    precise vec4 exponent = c.log_opacity - hits.residual;
    return exponent;
}

// Plane of a surfel as it is drawn: tilt under the filter, and range of its depth over that of the mean, by the rim on
// the screen.
vec3 drawn_plane(vec4 shape, vec2 whiten, vec3 plane) {
    vec2 tilt = filtered_tilt(plane.xy, plane.z, shape.z, whiten);
    vec2 axis_x = (WHITEN / whiten.x) * vec2(1.0, shape.z);
    float axis_y = WHITEN / whiten.y;
    return vec3(tilt, SURFEL_RADIUS * length(vec2(dot(axis_x, tilt), axis_y * tilt.y)));
}

// Depth of the plane at the pixels of a quad, but not beyond the surfel: where the spot counts, the plane is beyond it.
vec4 depth_of_hits(PlaneColumn c, Hits hits, float near_plane) {
    // Hits alone are within the surfel and in front of the near plane.
    if (SURFEL == SURFEL_MIP) return c.depth * max(hits.w, vec4(1e-6));
    vec4 depth = c.depth / max(hits.inverse, vec4(1e-6));
    return clamp(depth, max(c.depth * (1.0 - c.range), near_plane), c.depth * (1.0 + c.range));
}

// Sums over the quads of a column.
struct SurfelMoments {
    vec4 s;
    vec4 kappa;
    vec4 kappa_y;
    vec4 spot;
    vec4 spot_y;
};

// Adds the gradients s of a quad to both; to `m` by the residuals of the hits, w f.
void add_surfel_moments(inout Moments m, inout SurfelMoments sums, SurfelColumn c, uint q, vec4 s, vec4 f, Hits hits) {
    vec4 d_y = surfel_d_y(c, q);
    vec4 of_hit = SURFEL == SURFEL_ANY ? mix(s, vec4(0.0), hits.is_spot) : s;
    add_moments(m, of_hit * hits.w * hits.w, f);
    // Without a hit and without a spot alpha is 0, and so is s.
    vec4 kappa = of_hit * hits.residual * hits.w * (1.0 / (WHITEN * WHITEN));
    sums.s += s;
    sums.kappa += kappa;
    sums.kappa_y += kappa * d_y;
    if (SURFEL != SURFEL_ANY) return;
    vec4 of_spot = s - of_hit;
    sums.spot += of_spot;
    sums.spot_y += of_spot * d_y;
}

SurfelSums surfel_sums_of(SurfelMoments m, SurfelColumn c) {
    const vec4 one = vec4(1.0);
    float kappa = dot(m.kappa, one);
    float spot = dot(m.spot, one);
    return SurfelSums(vec3(kappa, kappa * c.d.x, dot(m.kappa_y, one)), vec2(spot * c.d.x, dot(m.spot_y, one)));
}
