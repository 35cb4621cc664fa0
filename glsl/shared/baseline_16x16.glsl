// Common code of the two baselines of compositing: tiles of 16x16 pixels, one invocation per pixel, and batches of
// splats that a workgroup fetches together.

const uint BASELINE_BATCH = 256;

// A batch of splats; positions are relative to the tile, for small rounding.
shared vec4 batch_shape[BASELINE_BATCH];
shared vec4 batch_tone[BASELINE_BATCH];
shared float batch_blue[BASELINE_BATCH];

void fetch(uint slot, uint splat, uvec2 corner) {
    batch_shape[slot] = ellipse_from_splat[splat] - vec4(vec2(corner), 0.0, 0.0);
    batch_tone[slot] = whiten_rg_from_splat[splat];
    batch_blue[slot] = blue_depth_from_splat[splat].x;
}

// log2 of a splat's alpha before its cap at a position in the tile; `f` is the whitened residual.
float baseline_exponent(uint slot, vec2 at, out vec2 f) {
    vec4 shape = batch_shape[slot];
    vec2 d = at - shape.xy;
    f = vec2(d.x, d.y - shape.z * d.x) * batch_tone[slot].xy;
    return shape.w - dot(f, f);
}
