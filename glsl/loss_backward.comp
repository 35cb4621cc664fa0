#version 460
#include "shared/prelude.glsl"
#include "shared/window.glsl"
#include "shared/photo.glsl"

// Gradient of the loss (1 - lambda) L1 + lambda (1 - SSIM) by every pixel of the render.
//
// One workgroup per 16x16 tile, channel after channel: the derivatives by each window's moments are spread
// back by the same window, along rows and then down columns, strips held in registers as in `loss`.

layout(constant_id = 0) const uint WORKGROUP = 32;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer ViewBlock { View view; };
layout(set = 0, binding = 1, scalar) readonly buffer Image { float image[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Photo { uint photo[]; };
layout(set = 0, binding = 3, scalar) readonly buffer Slopes { float ssim_slope[]; };
layout(set = 0, binding = 4, scalar) writeonly buffer ImageGradient { float d_image[]; };

layout(push_constant, scalar) uniform Push {
    uint alpha_mode;    // ALPHA_MASKS, or 0 to composite over the background
    float l1_scale;     // (1 - lambda) / (3 * sum of weights)
    float ssim_scale;   // lambda / (3 * sum of weights)
} push;

shared float along[3][WINDOW_SPAN][WINDOW_TILE];

float slope_at(ivec2 at, uint quantity, uint channel) {
    if (any(lessThan(at, ivec2(0))) || any(greaterThanEqual(at, ivec2(view.size)))) return 0.0;
    return ssim_slope[((quantity * 3 + channel) * view.size.y + uint(at.y)) * view.size.x + uint(at.x)];
}

void slide_along_row(ivec2 corner, uint row, uint channel) {
    float sums[3][WINDOW_TILE];
    [[unroll]] for (int i = 0; i < 3; ++i)
        [[unroll]] for (int to = 0; to < int(WINDOW_TILE); ++to) sums[i][to] = 0.0;
    [[unroll]] for (int from = 0; from < int(WINDOW_SPAN); ++from) {
        ivec2 at = corner + ivec2(from, row) - int(WINDOW_REACH);
        float values[3] = float[](slope_at(at, 0, channel), slope_at(at, 1, channel), slope_at(at, 2, channel));
        [[unroll]] for (int to = max(0, from - 10); to <= min(int(WINDOW_TILE) - 1, from); ++to) {
            float weight = window_weight(from, to);
            [[unroll]] for (int i = 0; i < 3; ++i) sums[i][to] += weight * values[i];
        }
    }
    [[unroll]] for (int i = 0; i < 3; ++i)
        [[unroll]] for (int to = 0; to < int(WINDOW_TILE); ++to) along[i][row][to] = sums[i][to];
}

void store(ivec2 at, uint channel, float sums[3]) {
    uint pixel = uint(at.y) * view.size.x + uint(at.x);
    uint place = channel * view.size.x * view.size.y + pixel;
    uint rgba = photo[pixel];
    float weight = weight_of(rgba, push.alpha_mode);
    float x = image[place];
    float y = target_of(rgba, channel, push.alpha_mode, view.background);
    // The windows saw weight * x and weight * y.
    float d_ssim = weight * (sums[0] + 2.0 * weight * x * sums[1] + weight * y * sums[2]);
    d_image[place] = push.l1_scale * weight * sign(x - y) - push.ssim_scale * d_ssim;
}

void slide_down_column(ivec2 corner, uint column, uint channel) {
    float sums[WINDOW_TILE][3];
    [[unroll]] for (int to = 0; to < int(WINDOW_TILE); ++to)
        [[unroll]] for (int i = 0; i < 3; ++i) sums[to][i] = 0.0;
    [[unroll]] for (int from = 0; from < int(WINDOW_SPAN); ++from) {
        float values[3] = float[](along[0][from][column], along[1][from][column], along[2][from][column]);
        [[unroll]] for (int to = max(0, from - 10); to <= min(int(WINDOW_TILE) - 1, from); ++to) {
            float weight = window_weight(from, to);
            [[unroll]] for (int i = 0; i < 3; ++i) sums[to][i] += weight * values[i];
        }
    }
    [[unroll]] for (int to = 0; to < int(WINDOW_TILE); ++to) {
        ivec2 at = corner + ivec2(column, to);
        if (all(lessThan(at, ivec2(view.size)))) store(at, channel, sums[to]);
    }
}

void main() {
    uint columns = (view.size.x + WINDOW_TILE - 1) / WINDOW_TILE;
    uint rows = (view.size.y + WINDOW_TILE - 1) / WINDOW_TILE;
    uint tile = group_index();
    if (tile >= columns * rows) return;
    ivec2 corner = ivec2(tile % columns, tile / columns) * int(WINDOW_TILE);
    uint lane = gl_LocalInvocationID.x;
    for (uint channel = 0; channel < 3; ++channel) {
        for (uint row = lane; row < WINDOW_SPAN; row += WORKGROUP) slide_along_row(corner, row, channel);
        barrier();
        for (uint column = lane; column < WINDOW_TILE; column += WORKGROUP) slide_down_column(corner, column, channel);
        barrier();
    }
}
