// Gradient of a splat's colour by its viewing direction. Expects planes of vec4 `params`, `push.stride` elements apart,
// and SH_DEGREE.

// dL/d direction, before the projection on the sphere's tangent. Invisible splats take the same path, because software
// devices walk both sides of a branch.
vec3 direction_backward(uint slot, bool is_visible, vec3 direction, vec3 d_color) {
    vec3 slope[16];
    sh_basis_gradient(SH_DEGREE, direction, slope);
    uint terms = (SH_DEGREE + 1) * (SH_DEGREE + 1);
    vec3 d_direction = vec3(0.0);
    [[unroll]] for (uint plane = 0; plane < (terms * 3 + 3) / 4; ++plane) {
        uint place = (GEOMETRY_PLANES + plane) * push.stride + slot;
        vec4 coefficients = vec4(0.0);
        if (is_visible) coefficients = params[place];
        [[unroll]] for (uint lane = 0; lane < 4; ++lane) {
            uint k = plane * 4 + lane;
            if (k < terms * 3) d_direction += slope[k / 3] * (coefficients[lane] * d_color[k % 3]);
        }
    }
    return d_direction;
}
