#version 460
#include "shared/prelude.glsl"
#include "shared/math.glsl"
#include "shared/sh.glsl"

// Steps of Adam on the spherical harmonics, for the gradients of several iterations at once.
//
// One invocation per splat. The gradient of a coefficient is its basis function, in the direction of the view, times
// the gradient of the colour: 6 numbers an iteration give all 48. Both moments go through all steps; the parameters
// move by the sum of the first moments over the root of the last second moment. Until the next update they lie ahead,
// where their momentum would take them on the mean of the steps until then. Directions are those to the splat as it
// lies now. The kernels of all degrees take the same steps to the bit: `precise` keeps compilers from fusing products
// into sums in some of them.

layout(constant_id = 0) const uint WORKGROUP = 64;
layout(constant_id = 1) const uint SH_DEGREE = 3;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer Counts { uint counts[]; };
// dL/d colour of each step.
layout(set = 0, binding = 1, scalar) readonly buffer ColorGradients { vec3 d_colors[]; };
layout(set = 0, binding = 2, scalar) buffer ParamsBlock { vec4 params[]; };
layout(set = 0, binding = 3, scalar) buffer Moments1 { vec4 moment1[]; };
layout(set = 0, binding = 4, scalar) buffer Moments2 { vec4 moment2[]; };

layout(push_constant, scalar) uniform Push {
    uint splat_count;                // splats of this dispatch
    uint stride;                     // elements between two planes
    uint step_count;                 // steps, COLOR_STEPS at most
    float rate_sh_dc;                // learning rates
    float rate_sh_rest;
    float beta1;
    float beta2;
    float epsilon;
    vec3 position[COLOR_STEPS];      // camera centre of each step from the last back, world units
    float correction1[COLOR_STEPS];  // 1 / (1 - beta1^step) of each, in double precision on the host
    float correction2[2];            // 1 / (1 - beta2^step) before these steps, and after
    float look_ahead[2];             // first moments by which parameters lie ahead before these steps, and after
} push;

// Products of a coefficient's gradients with their weights are those of these factors and the basis functions.
struct Factors {
    vec3 first;   // in the first moment
    vec3 sum;     // in the sum of the first moments, each times its correction
    vec3 second;  // in the second moment, with squares of the basis functions
};

void main() {
    uint splat = global_index();
    if (splat >= push.splat_count || counts[COUNT_FAILED] != 0) return;
    vec3 mean = params[splat].xyz;
    float basis[COLOR_STEPS][16];
    Factors factors[COLOR_STEPS];
    precise float weight1 = 1.0 - push.beta1;
    precise float weight2 = 1.0 - push.beta2;
    precise float weight_sum = 0.0;
    precise float kept1 = 1.0;
    precise float kept2 = 1.0;
    [[unroll]] for (uint i = 0; i < COLOR_STEPS; ++i) {
        bool is_step = i < push.step_count;
        vec3 d_color = is_step ? d_colors[(push.step_count - 1 - i) * push.stride + splat] : vec3(0.0);
        vec3 offset = mean - push.position[i];
        sh_basis(SH_DEGREE, offset / vector_length(offset), basis[i]);
        if (is_step) weight_sum = push.beta1 * weight_sum + weight1 * push.correction1[i];
        precise vec3 first = weight1 * kept1 * d_color;
        precise vec3 sum = weight_sum * d_color;
        precise vec3 second = weight2 * kept2 * d_color * d_color;
        factors[i] = Factors(first, sum, second);
        if (is_step) {
            kept1 *= push.beta1;
            kept2 *= push.beta2;
        }
    }
    // Share of the first moment so far in the sum.
    precise float kept_sum = weight_sum * push.beta1 / weight1;
    uint numbers = 3 * (SH_DEGREE + 1) * (SH_DEGREE + 1);
    [[unroll]] for (uint plane = 0; plane < (numbers + 3) / 4; ++plane) {
        uint place = (GEOMETRY_PLANES + plane) * push.stride + splat;
        vec4 m_before = moment1[place];
        vec4 v_before = moment2[place];
        precise vec4 m = kept1 * m_before;
        precise vec4 sum = kept_sum * m_before;
        precise vec4 v = kept2 * v_before;
        vec4 rate = vec4(push.rate_sh_rest);
        [[unroll]] for (uint lane = 0; lane < 4; ++lane) {
            uint k = plane * 4 + lane;
            if (k < 3) rate[lane] = push.rate_sh_dc;
            if (k >= numbers) continue;
            [[unroll]] for (uint i = 0; i < COLOR_STEPS; ++i) {
                float b = basis[i][k / 3];
                m[lane] += b * factors[i].first[k % 3];
                sum[lane] += b * factors[i].sum[k % 3];
                v[lane] += b * b * factors[i].second[k % 3];
            }
        }
        precise vec4 back = push.look_ahead[0] * m_before / (sqrt(v_before * push.correction2[0]) + push.epsilon);
        precise vec4 move = (sum + push.look_ahead[1] * m) / (sqrt(v * push.correction2[1]) + push.epsilon);
        precise vec4 next = params[place] - rate * (move - back);
        // Else the previous state stays, which is finite.
        if (!is_finite(m) || !is_finite(v) || !is_finite(next)) continue;
        params[place] = next;
        moment1[place] = m;
        moment2[place] = v;
    }
}
