#version 460
#include "shared/prelude.glsl"
#include "shared/window.glsl"
#include "shared/photo.glsl"

// Compares a render with its photograph: L1, SSIM and squared error per tile, and SSIM's derivatives.
//
// One workgroup per 16x16 tile and all three channels, one after the other. The window is separable: a
// lane first slides it along one row, then one down a column, holding its strip in registers. Values are
// shifted by one pixel of the photograph, so that variances of flat bright tiles do not cancel.

layout(constant_id = 0) const uint WORKGROUP = 32;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer ViewBlock { View view; };
layout(set = 0, binding = 1, scalar) readonly buffer Image { float image[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Photo { uint photo[]; };
// Derivatives of the sum of SSIM by each window's mean, mean square and mean product, planes of
// [quantity][channel][pixel].
layout(set = 0, binding = 3, scalar) writeonly buffer Slopes { float ssim_slope[]; };
layout(set = 0, binding = 4, scalar) writeonly buffer Partials { vec4 loss_from_tile[]; };

layout(push_constant, scalar) uniform Push {
    uint alpha_mode;  // ALPHA_MASKS, or 0 to composite over the background
} push;

// Sums along rows: x, y, x^2, y^2, x y.
shared float along[5][WINDOW_SPAN][WINDOW_TILE];
shared vec4 column_loss[WINDOW_TILE];

// The weighted pair (render, photograph) at a pixel; (0, 0) outside.
vec3 pair_at(ivec2 at, uint channel) {
    if (any(lessThan(at, ivec2(0))) || any(greaterThanEqual(at, ivec2(view.size)))) return vec3(0.0);
    uint pixel = uint(at.y) * view.size.x + uint(at.x);
    uint rgba = photo[pixel];
    float weight = weight_of(rgba, push.alpha_mode);
    float x = image[channel * view.size.x * view.size.y + pixel];
    return vec3(weight * x, weight * target_of(rgba, channel, push.alpha_mode, view.background), weight);
}

void slide_along_row(ivec2 corner, uint row, uint channel, float shift) {
    float sums[5][WINDOW_TILE];
    [[unroll]] for (int i = 0; i < 5; ++i)
        [[unroll]] for (int to = 0; to < int(WINDOW_TILE); ++to) sums[i][to] = 0.0;
    [[unroll]] for (int from = 0; from < int(WINDOW_SPAN); ++from) {
        vec2 v = pair_at(corner + ivec2(from, row) - int(WINDOW_REACH), channel).xy - shift;
        float values[5] = float[](v.x, v.y, v.x * v.x, v.y * v.y, v.x * v.y);
        [[unroll]] for (int to = max(0, from - 10); to <= min(int(WINDOW_TILE) - 1, from); ++to) {
            float weight = window_weight(from, to);
            [[unroll]] for (int i = 0; i < 5; ++i) sums[i][to] += weight * values[i];
        }
    }
    [[unroll]] for (int i = 0; i < 5; ++i)
        [[unroll]] for (int to = 0; to < int(WINDOW_TILE); ++to) along[i][row][to] = sums[i][to];
}

// SSIM of one window from its shifted moments; stores the derivatives and returns the loss terms.
vec4 compare(ivec2 at, uint channel, float moments[5], float shift) {
    vec3 here = pair_at(at, channel);
    float weight = here.z;
    float mean_x = moments[0] + shift;
    float mean_y = moments[1] + shift;
    float var_x = max(moments[2] - moments[0] * moments[0], 0.0);
    float var_y = max(moments[3] - moments[1] * moments[1], 0.0);
    float cov = moments[4] - moments[0] * moments[1];
    float a = 2.0 * mean_x * mean_y + SSIM_C1;
    float b = 2.0 * cov + SSIM_C2;
    float c = mean_x * mean_x + mean_y * mean_y + SSIM_C1;
    float d = var_x + var_y + SSIM_C2;
    float ssim = a * b / (c * d);
    float by_var = -ssim / d;
    float by_cov = 2.0 * a / (c * d);
    float by_mean = 2.0 * b * (mean_y - mean_x * a / c) / (c * d) - 2.0 * mean_x * by_var - mean_y * by_cov;
    uint pixels = view.size.x * view.size.y;
    uint place = channel * pixels + uint(at.y) * view.size.x + uint(at.x);
    ssim_slope[place] = weight * by_mean;
    ssim_slope[3 * pixels + place] = weight * by_var;
    ssim_slope[6 * pixels + place] = weight * by_cov;
    float difference = weight > 0.0 ? (here.x - here.y) / weight : 0.0;
    return weight * vec4(abs(difference), 1.0 - ssim, difference * difference, 1.0);
}

vec4 slide_down_column(ivec2 corner, uint column, uint channel, float shift) {
    float sums[WINDOW_TILE][5];
    [[unroll]] for (int to = 0; to < int(WINDOW_TILE); ++to)
        [[unroll]] for (int i = 0; i < 5; ++i) sums[to][i] = 0.0;
    [[unroll]] for (int from = 0; from < int(WINDOW_SPAN); ++from) {
        float values[5];
        [[unroll]] for (int i = 0; i < 5; ++i) values[i] = along[i][from][column];
        [[unroll]] for (int to = max(0, from - 10); to <= min(int(WINDOW_TILE) - 1, from); ++to) {
            float weight = window_weight(from, to);
            [[unroll]] for (int i = 0; i < 5; ++i) sums[to][i] += weight * values[i];
        }
    }
    vec4 loss = vec4(0.0);
    [[unroll]] for (int to = 0; to < int(WINDOW_TILE); ++to) {
        ivec2 at = corner + ivec2(column, to);
        if (all(lessThan(at, ivec2(view.size)))) loss += compare(at, channel, sums[to], shift);
    }
    return loss;
}

void main() {
    uint columns = (view.size.x + WINDOW_TILE - 1) / WINDOW_TILE;
    uint rows = (view.size.y + WINDOW_TILE - 1) / WINDOW_TILE;
    uint tile = group_index();
    if (tile >= columns * rows) return;
    ivec2 corner = ivec2(tile % columns, tile / columns) * int(WINDOW_TILE);
    uint lane = gl_LocalInvocationID.x;
    ivec2 middle = min(corner + int(WINDOW_TILE) / 2, ivec2(view.size) - 1);
    for (uint i = lane; i < WINDOW_TILE; i += WORKGROUP) column_loss[i] = vec4(0.0);
    for (uint channel = 0; channel < 3; ++channel) {
        float shift = pair_at(middle, channel).y;
        for (uint row = lane; row < WINDOW_SPAN; row += WORKGROUP) slide_along_row(corner, row, channel, shift);
        barrier();
        for (uint column = lane; column < WINDOW_TILE; column += WORKGROUP) {
            column_loss[column] += slide_down_column(corner, column, channel, shift);
        }
        barrier();
    }
    if (lane != 0) return;
    vec4 total = vec4(0.0);
    for (uint i = 0; i < WINDOW_TILE; ++i) total += column_loss[i];
    loss_from_tile[tile] = total;
}
