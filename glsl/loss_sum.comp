#version 460
#include "shared/prelude.glsl"

// Sums of the tiles' loss terms over pixels and channels: L1, 1 - SSIM, squared error, weight; or of the partial sums
// for a photograph's gains.
//
// One workgroup; lanes add in a fixed order, so the sums have the same bits in every run.

layout(constant_id = 0) const uint WORKGROUP = 64;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer Partials { vec4 loss_from_tile[]; };
layout(set = 0, binding = 1, scalar) writeonly buffer Total { vec4 total[]; };

layout(push_constant, scalar) uniform Push {
    uint tile_count;
    uint first;   // place of the first tile's terms, and
    uint stride;  // distance to the next
    uint slot;    // place of the total
} push;

shared vec4 lane_sum[WORKGROUP];

void main() {
    uint lane = gl_LocalInvocationID.x;
    vec4 sum = vec4(0.0);
    for (uint tile = lane; tile < push.tile_count; tile += WORKGROUP) {
        sum += loss_from_tile[push.first + tile * push.stride];
    }
    lane_sum[lane] = sum;
    barrier();
    if (lane != 0) return;
    for (uint i = 1; i < WORKGROUP; ++i) sum += lane_sum[i];
    total[push.slot] = sum;
}
