#version 460
#include "shared/prelude.glsl"
#include "shared/photo.glsl"
#include "shared/exposure.glsl"

// Sums of the residuals, render minus photograph, in each patch of a photograph: red, green, blue, and their weight.
//
// One workgroup per patch; lanes add in a fixed order. Detail that the render has not yet cancels within a patch;
// an object that only this photograph shows does not. Patches that the loss leaves out are summed all the same.
// Rows that do not count add nothing.

layout(constant_id = 0) const uint WORKGROUP = 32;
// 1: the render is compared under the photograph's exposure.
layout(constant_id = 1) const uint WITH_EXPOSURE = 0;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer ViewBlock { View view; };
layout(set = 0, binding = 1, scalar) readonly buffer Image { float image[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Photo { uint photo[]; };
layout(set = 0, binding = 3, scalar) writeonly buffer Residuals { vec4 residual_from_patch[]; };

layout(push_constant, scalar) uniform Push {
    uint alpha_mode;     // ALPHA_MASKS, or 0 to composite over the background
    vec3 gain;           // exposure of the photograph: gains,
    vec3 toe;            // and slopes on the curve's toe
    uint patch_shift;    // log2 of a patch's pixels along a side
    uint patch_columns;  // patches in a row
    uint photo_first;    // place of the first drawn pixel in the photograph's part
    uvec2 counted;       // drawn rows that count, and the end of those
} push;

shared vec4 lane_sum[WORKGROUP];

void main() {
    uvec2 size = view.size;
    uint pixels = size.x * size.y;
    uint edge = 1u << push.patch_shift;
    uint group = group_index();
    uvec2 corner = uvec2(group % push.patch_columns, group / push.patch_columns) << push.patch_shift;
    uint lane = gl_LocalInvocationID.x;
    vec4 sum = vec4(0.0);
    // Rows above the first drawn one wrap to large numbers, which do not count either.
    corner.y -= view.first_row;
    bool counts = int(corner.y + edge) > int(push.counted.x) && int(corner.y) < int(push.counted.y);
    for (uint i = lane; counts && i < edge * edge; i += WORKGROUP) {
        uvec2 at = corner + uvec2(i & (edge - 1), i >> push.patch_shift);
        if (at.x >= size.x || at.y < push.counted.x || at.y >= push.counted.y) continue;
        uint pixel = at.y * size.x + at.x;
        uint rgba = photo[push.photo_first + pixel];
        float weight = weight_of(rgba, push.alpha_mode);
        for (uint c = 0; c < 3; ++c) {
            float x = image[c * pixels + pixel];
            float y = target_of(rgba, c, push.alpha_mode, view.background[c]);
            if (WITH_EXPOSURE != 0) x = exposed(x, y, push.gain[c], push.toe[c]).x;
            sum[c] += weight * (x - y);
        }
        sum.w += weight;
    }
    lane_sum[lane] = sum;
    barrier();
    if (lane != 0) return;
    for (uint i = 1; i < WORKGROUP; ++i) sum += lane_sum[i];
    residual_from_patch[group] = sum;
}
