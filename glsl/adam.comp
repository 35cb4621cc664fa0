#version 460
#include "shared/prelude.glsl"
#include "shared/math.glsl"

// One step of Adam on mean, opacity, quaternion and scales.
//
// One invocation per vec4 of a plane; a row of workgroups covers a plane. Quaternions are normalised again, so that
// their length cannot drift and slow them down; scales are clamped to the bound on a splat's aspect.

layout(constant_id = 0) const uint WORKGROUP = 64;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) readonly buffer Gradients { vec4 d_params[]; };
layout(set = 0, binding = 2, scalar) buffer ParamsBlock { vec4 params[]; };
layout(set = 0, binding = 3, scalar) buffer Moments1 { vec4 moment1[]; };
layout(set = 0, binding = 4, scalar) buffer Moments2 { vec4 moment2[]; };

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
} push;

#include "shared/adam.glsl"

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
    uint place = plane * push.stride + splat;
    vec4 next;
    if (!take_step(place, splat, d_params[place], rate_of(plane), next)) return;
    if (plane == 1) next /= quaternion_length(next);
    if (plane == 2 && push.log_aspect_max > 0.0) next.xyz = bounded(next.xyz, push.log_aspect_max);
    // Else the previous state stays, which is finite.
    if (is_finite(next)) params[place] = next;
}
