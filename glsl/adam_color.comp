#version 460
#include "shared/prelude.glsl"
#include "shared/math.glsl"
#include "shared/sh.glsl"

// One step of Adam on the spherical harmonics.
//
// One invocation per splat. The gradient of a coefficient is its basis function, in the direction of the view, times
// the gradient of the colour: 6 numbers give all 48.

layout(constant_id = 0) const uint WORKGROUP = 64;
layout(constant_id = 1) const uint SH_DEGREE = 3;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) readonly buffer Gradients { vec4 d_params[]; };
layout(set = 0, binding = 2, scalar) buffer ParamsBlock { vec4 params[]; };
layout(set = 0, binding = 3, scalar) buffer Moments1 { vec4 moment1[]; };
layout(set = 0, binding = 4, scalar) buffer Moments2 { vec4 moment2[]; };

layout(push_constant, scalar) uniform Push {
    uint first_splat;   // index of the first splat of this dispatch
    uint splat_count;   // splats of this dispatch
    uint stride;        // elements between two planes
    float rate_sh_dc;   // learning rates
    float rate_sh_rest;
    float beta1;
    float beta2;
    float epsilon;
    float correction1;  // 1 / (1 - beta1^step), in double precision on the host
    float correction2;  // 1 / (1 - beta2^step)
} push;

#include "shared/adam.glsl"

void main() {
    uint splat = global_index();
    if (splat >= push.splat_count || counts[COUNT_FAILED] != 0) return;
    vec3 d_color = d_params[D_COLOR_PLANE * push.stride + splat].rgb;
    vec3 direction = d_params[DIRECTION_PLANE * push.stride + splat].xyz;
    float basis[16];
    sh_basis(SH_DEGREE, direction, basis);
    uint numbers = 3 * (SH_DEGREE + 1) * (SH_DEGREE + 1);
    [[unroll]] for (uint plane = 0; plane < (numbers + 3) / 4; ++plane) {
        vec4 g = vec4(0.0);
        vec4 rate = vec4(push.rate_sh_rest);
        [[unroll]] for (uint lane = 0; lane < 4; ++lane) {
            uint k = plane * 4 + lane;
            if (k < numbers) g[lane] = basis[k / 3] * d_color[k % 3];
            if (k < 3) rate[lane] = push.rate_sh_dc;
        }
        uint place = (GEOMETRY_PLANES + plane) * push.stride + splat;
        vec4 next;
        // Else the previous state stays, which is finite.
        if (take_step(place, splat, g, rate, next) && is_finite(next)) params[place] = next;
    }
}
