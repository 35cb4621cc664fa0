#version 460
#include "shared/prelude.glsl"
#include "shared/math.glsl"
#include "shared/sh.glsl"

// Sums for the gradient of the loss by the camera's pose, from the gradients of the splats: the force on all of them,
// and their torque about the camera.
//
// To move the camera is to move all splats the other way, and to turn it about its centre is to turn the world about
// that point: means, orientations and harmonics. Harmonics that turn with the directions keep their colours, so the
// part of the means' gradient that comes from directions is taken out of the torque.
//
// One workgroup per POSE_SPLATS splats, given by their slots; lanes add in a fixed order. A splat whose gradient is not
// finite is left out, as the optimiser leaves it out.

layout(constant_id = 0) const uint WORKGROUP = 64;
layout(constant_id = 1) const uint SH_DEGREE = 3;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer ViewBlock { View view; };
layout(set = 0, binding = 1, scalar) readonly buffer Counts { uint counts[]; };
layout(set = 0, binding = 2, scalar) readonly buffer ParamsBlock { vec4 params[]; };
layout(set = 0, binding = 3, scalar) readonly buffer Gradients { vec4 d_params[]; };
// Two for each workgroup: force, torque.
layout(set = 0, binding = 4, scalar) writeonly buffer Partials { vec4 sums_from_group[]; };

layout(push_constant, scalar) uniform Push {
    uint splat_count;  // splats of this dispatch
    uint stride;       // elements between two planes
    uint first_group;  // place of the first workgroup's sums, in pairs
} push;

#include "shared/direction.glsl"

shared vec3 lane_force[WORKGROUP];
shared vec3 lane_torque[WORKGROUP];

// Gradient by a turn of the world, from that by an orientation: a turn by the vector w makes q to
// (1, w / 2) q.
vec3 orientation_torque(vec4 q, vec4 d) {
    return 0.5 * (q.x * d.yzw - d.x * q.yzw + cross(q.yzw, d.yzw));
}

void add_splat(uint slot, inout vec3 force, inout vec3 torque) {
    vec3 d_mean = d_params[slot].xyz;
    vec4 d_quaternion = d_params[push.stride + slot];
    vec3 d_color = d_params[D_COLOR_PLANE * push.stride + slot].xyz;
    vec3 direction = d_params[DIRECTION_PLANE * push.stride + slot].xyz;
    bool is_still = d_mean == vec3(0.0) && d_quaternion == vec4(0.0);
    vec3 turned = cross(params[slot].xyz - view.position, d_mean);
    turned += orientation_torque(params[push.stride + slot], d_quaternion);
    turned -= cross(direction, direction_backward(slot, !is_still, direction, d_color));
    if (is_still || !is_finite(d_mean) || !is_finite(turned)) return;
    force += d_mean;
    torque += turned;
}

void main() {
    uint group = group_index();
    uint first = group * POSE_SPLATS;
    if (first >= push.splat_count || counts[COUNT_FAILED] != 0) return;
    uint lane = gl_LocalInvocationID.x;
    vec3 force = vec3(0.0);
    vec3 torque = vec3(0.0);
    for (uint i = lane; i < POSE_SPLATS; i += WORKGROUP) {
        uint slot = first + i;
        if (slot >= push.splat_count) break;
        add_splat(slot, force, torque);
    }
    lane_force[lane] = force;
    lane_torque[lane] = torque;
    barrier();
    if (lane != 0) return;
    for (uint i = 1; i < WORKGROUP; ++i) {
        force += lane_force[i];
        torque += lane_torque[i];
    }
    uint place = 2 * (push.first_group + group);
    sums_from_group[place] = vec4(force, 0.0);
    sums_from_group[place + 1] = vec4(torque, 0.0);
}
