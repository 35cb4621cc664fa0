// Weights alpha T of a pixel's splats, recomputed exactly as in compositing: the same exponents, products and end.
// Kernels that include this walk a tile's list from the front.
//
// They need `tile.glsl`, `primitive.glsl`, `surfel_column.glsl` and `stage.glsl`, a `view`, T_MIN, LOG2_ALPHA_MIN,
// INRIA and SURFEL.

bool any_lane(bool mine);

// Transmittance of the lane's pixels after all splats so far.
vec4 transmittance[QUADS];

void begin_pixels(Tile t) {
    [[unroll]] for (uint q = 0; q < QUADS; ++q) {
        transmittance[q] = mix(vec4(0.0), vec4(1.0), inside(t, q, view));
    }
}

// True if any pixel of the workgroup is still open.
bool any_open() {
    bool open = false;
    [[unroll]] for (uint q = 0; q < QUADS; ++q) {
        open = open || any(greaterThanEqual(transmittance[q], vec4(T_MIN)));
    }
    return any_lane(open);
}

// A splat along the lane's pixels.
struct WeightColumn {
    Column ellipse;
    SurfelColumn surfel;
};

// Column of the splat staged by a lane; its plane is staged beside it if it is a surfel.
WeightColumn weight_column_of(Tile t, Staged splat, uint lane) {
    WeightColumn c;
    c.ellipse = column_of(t, splat.shape, splat.tone);
    if (SURFEL != 0) {
        vec3 plane = staged_plane_by(lane);
        c.surfel = surfel_column_of(t, splat.shape, splat.tone.xy, plane, depth_of(splat.rest), view);
    }
    return c;
}

// A splat's weights in quad `q`, 0 where it does not count; updates the transmittance.
vec4 weights_of(WeightColumn c, uint q) {
    vec4 f;
    vec4 exponent = exponent_of(c.ellipse, q, f);
    Hits hits;
    if (SURFEL != 0) exponent = surfel_exponent(c.ellipse, c.surfel, q, f, hits);
    bvec4 on = both(greaterThanEqual(exponent, vec4(LOG2_ALPHA_MIN)),
                    greaterThanEqual(transmittance[q], vec4(T_MIN)));
    float cap = INRIA != 0 ? 0.99 : ALPHA_MAX;
    vec4 alpha = mix(vec4(0.0), min(exp2(exponent), vec4(cap)), on);
    vec4 weight = alpha * transmittance[q];
    vec4 next = transmittance[q] * (vec4(1.0) - alpha);
    if (INRIA != 0) {
        // A splat that would take the transmittance below the threshold is left out and ends the pixel.
        bvec4 ends = both(on, lessThan(next, vec4(T_MIN)));
        weight = mix(weight, vec4(0.0), ends);
        next = mix(next, vec4(0.0), ends);
    }
    transmittance[q] = next;
    return weight;
}
