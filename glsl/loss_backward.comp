#version 460
#include "shared/prelude.glsl"
#include "shared/window.glsl"
#include "shared/photo.glsl"
#include "shared/exposure.glsl"
#include "shared/patches.glsl"

// Gradient of the loss (1 - lambda) L1 + lambda (1 - SSIM) by every pixel of the render.
//
// One workgroup per tile, channel after channel: the derivatives by each window's moments are spread back by the same
// window, along rows and then down columns, with strips in registers as in `loss`.

layout(constant_id = 0) const uint WORKGROUP = 32;
// 0: L1 only; slopes are not read.
layout(constant_id = 1) const uint WITH_SSIM = 1;
// 1: the render is compared under the photograph's exposure.
layout(constant_id = 2) const uint WITH_EXPOSURE = 0;
// 1: patches that are ignored have no weight.
layout(constant_id = 3) const uint WITH_IGNORED = 0;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer ViewBlock { View view; };
layout(set = 0, binding = 1, scalar) readonly buffer Image { float image[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Photo { uint photo[]; };
layout(set = 0, binding = 3, scalar) readonly buffer Slopes { vec3 ssim_slope[]; };
layout(set = 0, binding = 4, scalar) writeonly buffer ImageGradient { float d_image[]; };
// A bit of each patch.
layout(set = 0, binding = 5, scalar) readonly buffer Ignored { uint ignored[]; };

layout(push_constant, scalar) uniform Push {
    uint alpha_mode;     // ALPHA_MASKS, or 0 to composite over the background
    float l1_scale;      // (1 - lambda) / (3 * sum of weights)
    float ssim_scale;    // lambda / (3 * sum of weights)
    vec3 gain;           // exposure of the photograph: gains,
    vec3 toe;            // and slopes on the curve's toe
    uvec2 offset;        // first window of the lattice, less than STRIDE
    uint patch_shift;    // log2 of a patch's pixels along a side
    uint patch_columns;  // patches in a row
    uint photo_first;    // place of the first drawn pixel in the photograph's part
    uint tile_row;       // row of the first tile among the drawn ones
    uint tile_rows;      // rows of tiles
} push;

// Rows of windows that reach a tile, and windows that reach a strip.
const uint ROWS = (LOSS_TILE_HEIGHT + 2 * WINDOW_REACH) / STRIDE;
const uint STRIP_SPAN = (STRIP + 2 * WINDOW_REACH) / STRIDE;
// Strips of a tile: along its rows, those of its halo too, and down its columns.
const uint STRIPS_OF_ROW = LOSS_TILE_WIDTH / STRIP;
const uint ROW_STRIPS = ROWS * STRIPS_OF_ROW;
const uint COLUMN_STRIPS = LOSS_TILE_WIDTH * (LOSS_TILE_HEIGHT / STRIP);

shared vec3 along[WINDOW_SPAN][LOSS_TILE_WIDTH];

// Image size, cached: a buffer load costs as much as several arithmetic operations.
uvec2 size;

// Sums for the pixels of a strip from the windows that reach it. A macro, because a function would copy the arrays.
// On a lattice the windows' distances from a pixel are all even or all odd.
#define spread(values, offset, sums)                                                                     \
    if (STRIDE == 1) {                                                                                   \
        [[unroll]] for (uint to = 0; to < STRIP; ++to) sums[to] = window_sum(values, to);                \
    } else {                                                                                             \
        [[unroll]] for (uint i = 0; i < STRIP / 2; ++i) {                                                \
            vec3 odd = odd_sum(values, i);                                                               \
            sums[2 * i] = (offset) == 0 ? even_sum(values, i) : odd;                                     \
            sums[2 * i + 1] = (offset) == 0 ? odd : even_sum(values, i + 1);                             \
        }                                                                                                \
    }

// First window from the halo's border on. Coordinates left of the image or above it wrap to large unsigned numbers,
// outside too.
uint first_window(uint pixel, uint offset) {
    return pixel - WINDOW_REACH + (STRIDE == 1 ? 0 : 1 - offset);
}

void slide_along_row(uvec2 corner, uint row, uint begin, uint channel) {
    uint y = first_window(corner.y, push.offset.y) + STRIDE * row;
    uint x = first_window(corner.x + begin, push.offset.x);
    vec3 values[STRIP_SPAN];
    vec3 sums[STRIP];
    bool in_rows = y < size.y;
    uint last = (size.x - 1) / STRIDE * STRIDE;
    [[unroll]] for (uint from = 0; from < STRIP_SPAN; ++from) {
        uint at = x + STRIDE * from;
        vec3 value = ssim_slope[place_of_window(uvec2(min(at, last), in_rows ? y : 0), channel, size)];
        values[from] = in_rows && at < size.x ? value : vec3(0.0);
    }
    spread(values, push.offset.x, sums);
    [[unroll]] for (uint to = 0; to < STRIP; ++to) along[row][begin + to] = sums[to];
}

void store(uvec2 at, uint channel, vec3 sums) {
    uint pixel = at.y * size.x + at.x;
    uint place = channel * size.x * size.y + pixel;
    uint rgba = photo[push.photo_first + pixel];
    float weight = weight_of(rgba, push.alpha_mode);
    if (WITH_IGNORED != 0) {
        uint square = patch_at(at.x, view.first_row + at.y, push.patch_shift, push.patch_columns);
        weight *= kept_by(ignored[word_of(square)], square);
    }
    float x = image[place];
    float y = target_of(rgba, channel, push.alpha_mode, view.background[channel]);
    float slope = 1.0;
    if (WITH_EXPOSURE != 0) {
        vec2 value = exposed(x, y, push.gain[channel], push.toe[channel]);
        x = value.x;
        slope = value.y;
    }
    // The moments are of weight * x and weight * y.
    float d_ssim = weight * (sums.x + weight * (2.0 * x * sums.y + y * sums.z));
    float d_exposed = push.l1_scale * weight * sign(x - y) - push.ssim_scale * d_ssim;
    d_image[place] = WITH_EXPOSURE != 0 ? slope * d_exposed : d_exposed;
}

void slide_down_column(uvec2 corner, uint column, uint begin, uint channel) {
    vec3 values[STRIP_SPAN];
    vec3 sums[STRIP];
    [[unroll]] for (uint from = 0; from < STRIP_SPAN; ++from) values[from] = along[begin / STRIDE + from][column];
    spread(values, push.offset.y, sums);
    [[unroll]] for (uint to = 0; to < STRIP; ++to) {
        uvec2 at = corner + uvec2(column, begin + to);
        if (all(lessThan(at, size))) store(at, channel, WITH_SSIM != 0 ? sums[to] : vec3(0.0));
    }
}

void main() {
    size = view.size;
    const uvec2 extent = uvec2(LOSS_TILE_WIDTH, LOSS_TILE_HEIGHT);
    uint columns = (size.x + extent.x - 1) / extent.x;
    uint tile = group_index();
    if (tile >= columns * push.tile_rows) return;
    uvec2 corner = uvec2(tile % columns, tile / columns) * extent + uvec2(0, push.tile_row);
    uint lane = gl_LocalInvocationID.x;
    for (uint channel = 0; channel < 3; ++channel) {
        // Tested at the end: some software devices run a body once more, without active lanes, to find that a loop is
        // over.
        uint i = lane;
        if (WITH_SSIM != 0) do {
            if (i < ROW_STRIPS) slide_along_row(corner, i / STRIPS_OF_ROW, i % STRIPS_OF_ROW * STRIP, channel);
            i += WORKGROUP;
        } while (i < ROW_STRIPS);
        barrier();
        i = lane;
        do {
            if (i < COLUMN_STRIPS) {
                slide_down_column(corner, i % LOSS_TILE_WIDTH, i / LOSS_TILE_WIDTH * STRIP, channel);
            }
            i += WORKGROUP;
        } while (i < COLUMN_STRIPS);
        barrier();
    }
}
