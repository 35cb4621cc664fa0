#version 460
#include "shared/prelude.glsl"
#include "shared/math.glsl"

// One step of Adam on mean, opacity, quaternion and scales. Gradients of colours are put aside for `adam_color`.
//
// One invocation per vec4 of a plane; a row of workgroups covers a plane, a last row the colours. Quaternions are
// normalised again, so that their length cannot drift and slow them down; scales are clamped to the bound on a splat's
// aspect.

layout(constant_id = 0) const uint WORKGROUP = 64;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) readonly buffer Gradients { vec4 d_params[]; };
layout(set = 0, binding = 2, scalar) buffer ParamsBlock { vec4 params[]; };
layout(set = 0, binding = 3, scalar) buffer Moments1 { vec4 moment1[]; };
layout(set = 0, binding = 4, scalar) buffer Moments2 { vec4 moment2[]; };
// dL/d colour of each step since the last update of the harmonics.
layout(set = 0, binding = 5, scalar) writeonly buffer ColorGradients { vec3 d_colors[]; };

layout(push_constant, scalar) uniform Push {
    uint first_splat;        // index of the first splat of this dispatch
    uint splat_count;        // splats of this dispatch
    uint stride;             // elements between two planes
    float rate_mean;         // learning rates
    float rate_opacity;
    float rate_quaternion;
    float rate_log_scale;
    float beta1;
    float beta2;
    float epsilon;
    float correction1;       // 1 / (1 - beta1^step), in double precision on the host
    float correction2;       // 1 / (1 - beta2^step)
    float log_aspect_max;    // largest difference of a splat's log-scales; 0: no bound
    uint color_step;         // number of this step among those
} push;

// Counts a gradient that is not finite, or has a square that is not.
void note_poisoned(uint splat) {
    atomicAdd(counts[COUNT_POISONED], 1);
    atomicMax(counts[COUNT_POISONED_FIRST], 0xffffffffu - (push.first_splat + splat));
}

// Updates the moments along the gradient `g`; `next` are the parameters after the step. A gradient that is not finite,
// or has a square that is not, leaves all as they are: false.
bool take_step(uint place, uint splat, vec4 g, vec4 rate, out vec4 next) {
    // An infinite square would stay in the second moment.
    if (!is_finite(g * g)) {
        note_poisoned(splat);
        return false;
    }
    precise vec4 m = push.beta1 * moment1[place] + (1.0 - push.beta1) * g;
    precise vec4 v = push.beta2 * moment2[place] + (1.0 - push.beta2) * g * g;
    moment1[place] = m;
    moment2[place] = v;
    precise vec4 step = rate * (m * push.correction1) / (sqrt(v * push.correction2) + push.epsilon);
    precise vec4 after = params[place] - step;
    next = after;
    return true;
}

// Puts the gradient of a colour aside; of one that is not finite, zeros.
void put_aside(uint splat) {
    vec3 d_color = d_params[D_COLOR_PLANE * push.stride + splat].rgb;
    // Squares of basis functions are below 8.
    bool is_sound = is_finite(8.0 * d_color * d_color);
    if (!is_sound) note_poisoned(splat);
    d_colors[push.color_step * push.stride + splat] = is_sound ? d_color : vec3(0.0);
}

vec4 rate_of(uint plane) {
    if (plane == 0) return vec4(vec3(push.rate_mean), push.rate_opacity);
    if (plane == 1) return vec4(push.rate_quaternion);
    return vec4(vec3(push.rate_log_scale), 0.0);
}

// The nearest log-scales with pairwise differences up to `most`; their sum (the log of the splat's volume) stays.
vec3 bounded(vec3 x, float most) {
    float high = max(x.x, max(x.y, x.z));
    float low = min(x.x, min(x.y, x.z));
    float middle = max(min(x.x, x.y), min(max(x.x, x.y), x.z));
    if (!(high - low > most)) return x;
    float bottom = 0.5 * (high + low - most);
    if (middle > bottom + most) bottom = (high + middle + low - 2.0 * most) / 3.0;
    else if (middle < bottom) bottom = (high + middle + low - most) / 3.0;
    return clamp(x, bottom, bottom + most);
}

void main() {
    uint plane = gl_WorkGroupID.y;
    uint splat = gl_WorkGroupID.x * WORKGROUP + gl_LocalInvocationID.x;
    if (splat >= push.splat_count || counts[COUNT_FAILED] != 0) return;
    if (plane == GEOMETRY_PLANES) {
        put_aside(splat);
        return;
    }
    uint place = plane * push.stride + splat;
    vec4 next;
    if (!take_step(place, splat, d_params[place], rate_of(plane), next)) return;
    if (plane == 1) next /= quaternion_length(next);
    if (plane == 2 && push.log_aspect_max > 0.0) next.xyz = bounded(next.xyz, push.log_aspect_max);
    // Else the previous state stays, which is finite.
    if (is_finite(next)) params[place] = next;
}
