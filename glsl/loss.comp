#version 460
#include "shared/prelude.glsl"
#include "shared/window.glsl"
#include "shared/photo.glsl"

// Compares a render with its photograph: L1, SSIM and squared error per tile, and SSIM's derivatives.
//
// One workgroup per 16x16 tile and all three channels, one after the other. The window is separable: a
// lane slides it along a strip of a row, then down a strip of a column, held in registers. Values are
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
shared vec4 lane_loss[WORKGROUP];

// Read once: a buffer load costs as much as several arithmetic operations.
uvec2 size;
vec3 background;

// The weighted pair (render, photograph) and the weight at a pixel; zeros outside, where positions left of the
// image or above it are too, being unsigned.
vec3 pair_at(uint x, uint y, uint channel) {
    bool inside = x < size.x && y < size.y;
    uint pixel = (y < size.y ? y : 0) * size.x + min(x, size.x - 1);
    uint rgba = photo[pixel];
    float weight = inside ? weight_of(rgba, push.alpha_mode) : 0.0;
    float rendered = image[channel * size.x * size.y + pixel];
    return weight * vec3(rendered, target_of(rgba, channel, push.alpha_mode, background), 1.0);
}

void slide_along_row(ivec2 corner, uint row, uint begin, uint channel, float shift) {
    uint left = uint(corner.x) + begin - WINDOW_REACH;
    uint top = uint(corner.y) + row - WINDOW_REACH;
    float x[STRIP_SPAN], y[STRIP_SPAN], xx[STRIP_SPAN], yy[STRIP_SPAN], xy[STRIP_SPAN];
    [[unroll]] for (uint from = 0; from < STRIP_SPAN; ++from) {
        vec2 v = pair_at(left + from, top, channel).xy - shift;
        x[from] = v.x;
        y[from] = v.y;
        xx[from] = v.x * v.x;
        yy[from] = v.y * v.y;
        xy[from] = v.x * v.y;
    }
    [[unroll]] for (uint to = 0; to < STRIP; ++to) {
        along[0][row][begin + to] = window_sum(x, to);
        along[1][row][begin + to] = window_sum(y, to);
        along[2][row][begin + to] = window_sum(xx, to);
        along[3][row][begin + to] = window_sum(yy, to);
        along[4][row][begin + to] = window_sum(xy, to);
    }
}

// SSIM of one window from its shifted moments; stores the derivatives and returns the loss terms.
vec4 compare(ivec2 at, uint channel, float moments[5], float shift) {
    vec3 here = pair_at(uint(at.x), uint(at.y), channel);
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
    uint pixels = size.x * size.y;
    uint place = channel * pixels + uint(at.y) * size.x + uint(at.x);
    ssim_slope[place] = weight * by_mean;
    ssim_slope[3 * pixels + place] = weight * by_var;
    ssim_slope[6 * pixels + place] = weight * by_cov;
    float difference = weight > 0.0 ? (here.x - here.y) / weight : 0.0;
    return weight * vec4(abs(difference), 1.0 - ssim, difference * difference, 1.0);
}

vec4 slide_down_column(ivec2 corner, uint column, uint begin, uint channel, float shift) {
    float values[5][STRIP_SPAN];
    [[unroll]] for (uint i = 0; i < 5; ++i)
        [[unroll]] for (uint from = 0; from < STRIP_SPAN; ++from) values[i][from] = along[i][begin + from][column];
    vec4 loss = vec4(0.0);
    [[unroll]] for (uint to = 0; to < STRIP; ++to) {
        float moments[5];
        [[unroll]] for (uint i = 0; i < 5; ++i) moments[i] = window_sum(values[i], to);
        ivec2 at = corner + ivec2(column, begin + to);
        if (all(lessThan(at, ivec2(size)))) loss += compare(at, channel, moments, shift);
    }
    return loss;
}

void main() {
    size = view.size;
    background = view.background;
    uint columns = (size.x + WINDOW_TILE - 1) / WINDOW_TILE;
    uint rows = (size.y + WINDOW_TILE - 1) / WINDOW_TILE;
    uint tile = group_index();
    if (tile >= columns * rows) return;
    ivec2 corner = ivec2(tile % columns, tile / columns) * int(WINDOW_TILE);
    uint lane = gl_LocalInvocationID.x;
    ivec2 middle = min(corner + int(WINDOW_TILE) / 2, ivec2(size) - 1);
    vec4 loss = vec4(0.0);
    for (uint channel = 0; channel < 3; ++channel) {
        float shift = pair_at(uint(middle.x), uint(middle.y), channel).y;
        for (uint i = lane; i < WINDOW_SPAN * STRIPS; i += WORKGROUP) {
            slide_along_row(corner, i % WINDOW_SPAN, i / WINDOW_SPAN * STRIP, channel, shift);
        }
        barrier();
        for (uint i = lane; i < WINDOW_TILE * STRIPS; i += WORKGROUP) {
            loss += slide_down_column(corner, i % WINDOW_TILE, i / WINDOW_TILE * STRIP, channel, shift);
        }
        barrier();
    }
    lane_loss[lane] = loss;
    barrier();
    if (lane != 0) return;
    vec4 total = vec4(0.0);
    for (uint i = 0; i < WORKGROUP; ++i) total += lane_loss[i];
    loss_from_tile[tile] = total;
}
