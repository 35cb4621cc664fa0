#version 460
#include "shared/prelude.glsl"
#include "shared/window.glsl"
#include "shared/photo.glsl"
#include "shared/exposure.glsl"
#include "shared/patches.glsl"

// Loss terms of a render and its photograph: L1, SSIM and squared error per tile, and SSIM's derivatives.
//
// Of a photograph in bands, the drawn rows are those that count and a halo, whose windows reach the counted ones; their
// slopes are written, and their loss is not counted.
//
// One workgroup per tile and all three channels, one after the other. The window is separable: a lane slides it along a
// strip of a row, then down a strip of a column, held in registers. Values are shifted by one pixel of the photograph,
// so that variances of flat bright tiles do not cancel. SSIM needs only the sum of the two variances, hence four
// moments: the means of x, y, x^2 + y^2 and x y.

layout(constant_id = 0) const uint WORKGROUP = 32;
// 0: without SSIM and its windows, most of the work; slopes are not written.
layout(constant_id = 1) const uint WITH_SSIM = 1;
// 1: the render is compared under the photograph's exposure.
layout(constant_id = 2) const uint WITH_EXPOSURE = 0;
// 1: patches that are ignored have no weight.
layout(constant_id = 3) const uint WITH_IGNORED = 0;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer ViewBlock { View view; };
layout(set = 0, binding = 1, scalar) readonly buffer Image { float image[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Photo { uint photo[]; };
// Derivatives of the sum of SSIM by each window's mean of x, of x^2 and of x y.
layout(set = 0, binding = 3, scalar) writeonly buffer Slopes { vec3 ssim_slope[]; };
layout(set = 0, binding = 4, scalar) writeonly buffer Partials { vec4 loss_from_tile[]; };
// A bit of each patch.
layout(set = 0, binding = 5, scalar) readonly buffer Ignored { uint ignored[]; };

layout(push_constant, scalar) uniform Push {
    uint alpha_mode;     // ALPHA_MASKS, or 0 to composite over the background
    vec3 gain;           // exposure of the photograph: gains,
    vec3 toe;            // and slopes on the curve's toe
    uvec2 offset;        // first window of the lattice, less than STRIDE
    uint patch_shift;    // log2 of a patch's pixels along a side
    uint patch_columns;  // patches in a row
    uint photo_first;    // place of the first drawn pixel in the photograph's part
    uint photo_rows;     // rows of the photograph from the first drawn one on
    uvec2 counted;       // drawn rows that count, and the end of those; whole tiles
    uint tile_row;       // row of the first tile, which may lie above the first drawn one
    uint tile_rows;      // rows of tiles
} push;

// Pixels that the windows of a strip read.
const uint STRIP_SPAN = STRIDE * (STRIP - 1) + 2 * WINDOW_REACH + 1;
// Strips of a tile: along its rows, those of its halo too, and down its columns.
const uint STRIPS_OF_ROW = LOSS_TILE_WIDTH / (STRIDE * STRIP);
const uint ROW_STRIPS = WINDOW_SPAN * STRIPS_OF_ROW;
const uint COLUMNS = LOSS_TILE_WIDTH / STRIDE;
const uint COLUMN_STRIPS = COLUMNS * (LOSS_TILE_HEIGHT / (STRIDE * STRIP));

// Moments along rows.
shared vec4 along[WINDOW_SPAN][LOSS_TILE_WIDTH];
shared vec4 lane_loss[WORKGROUP];

// Cached: a buffer load costs as much as several arithmetic operations.
uvec2 size;
uint alpha_mode;
uint pixels;

// One channel of the photograph and of the render.
struct Channel {
    uint index;
    float background;
    float shift;
    float gain;
    float toe;
};

// Weight of a pixel's patch.
float kept(uint x, uint y) {
    uint place = patch_at(x, view.first_row + y, push.patch_shift, push.patch_columns);
    return kept_by(ignored[word_of(place)], place);
}

// The weighted pair (render, photograph) and the weight at a pixel; zeros outside. Coordinates left of the image or
// above it wrap to large unsigned numbers, outside too.
vec3 pair_at(uint x, uint y, Channel c) {
    bool inside = x < size.x && y < size.y;
    uint row = y < size.y ? y : 0;
    uint column = min(x, size.x - 1);
    uint pixel = row * size.x + column;
    uint rgba = photo[push.photo_first + pixel];
    float weight = inside ? weight_of(rgba, alpha_mode) : 0.0;
    if (WITH_IGNORED != 0) weight *= kept(column, row);
    float value = image[c.index * pixels + pixel];
    float goal = target_of(rgba, c.index, alpha_mode, c.background);
    if (WITH_EXPOSURE != 0) value = exposed(value, goal, c.gain, c.toe).x;
    return weight * vec3(value, goal, 1.0);
}

// The weighted photograph in the middle of a tile, which may lie outside the drawn rows.
float shift_of(uvec2 corner, Channel c) {
    uvec2 middle = corner + uvec2(LOSS_TILE_WIDTH, LOSS_TILE_HEIGHT) / 2;
    uint x = min(middle.x, size.x - 1);
    uint y = uint(min(int(middle.y), int(push.photo_rows) - 1));
    uint rgba = photo[push.photo_first + y * size.x + x];
    float weight = weight_of(rgba, alpha_mode);
    if (WITH_IGNORED != 0) weight *= kept(x, y);
    return weight * target_of(rgba, c.index, alpha_mode, c.background);
}

// True if a row from `begin` to `end` is at most `reach` rows from the counted ones.
bool matters(uint begin, uint end, int reach) {
    return int(end) > int(push.counted.x) - reach && int(begin) < int(push.counted.y) + reach;
}

// Loss terms of a pixel without SSIM.
vec4 differ(vec3 here) {
    float weight = here.z;
    float difference = weight > 0.0 ? (here.x - here.y) / weight : 0.0;
    return weight * vec4(abs(difference), 0.0, difference * difference, 1.0);
}

// Returns the loss terms of the strip's pixels in the row without SSIM if not every pixel has a window.
vec4 slide_along_row(uvec2 corner, uint row, uint begin, Channel c) {
    uint own = corner.x + STRIDE * begin;
    uint left = own + push.offset.x - WINDOW_REACH;
    uint top = corner.y + row - WINDOW_REACH;
    vec4 values[STRIP_SPAN];
    vec4 loss = vec4(0.0);
    bool is_own = STRIDE > 1 && top - corner.y < LOSS_TILE_HEIGHT;
    [[unroll]] for (uint from = 0; from < STRIP_SPAN; ++from) {
        vec3 here = pair_at(left + from, top, c);
        vec2 v = here.xy - c.shift;
        values[from] = vec4(v, dot(v, v), v.x * v.y);
        if (STRIDE > 1) loss += is_own && left + from - own < STRIDE * STRIP ? differ(here) : vec4(0.0);
    }
    [[unroll]] for (uint to = 0; to < STRIP; ++to) along[row][begin + to] = window_sum(values, STRIDE * to);
    return loss;
}

// SSIM of one window from its shifted moments; stores the derivatives and returns the loss terms.
vec4 compare(uvec2 at, Channel c, vec4 moments) {
    vec3 here = pair_at(at.x, at.y, c);
    float weight = here.z;
    vec2 mean = moments.xy + c.shift;
    float variances = max(moments.z - dot(moments.xy, moments.xy), 0.0);
    float covariance = moments.w - moments.x * moments.y;
    float a = 2.0 * mean.x * mean.y + SSIM_C1;
    float b = 2.0 * covariance + SSIM_C2;
    float e = dot(mean, mean) + SSIM_C1;
    float f = variances + SSIM_C2;
    float scale = 1.0 / (e * f);
    float ssim = a * b * scale;
    float by_square = -ssim / f;
    float by_product = 2.0 * a * scale;
    float by_mean = 2.0 * b * scale * (mean.y - mean.x * a / e) - 2.0 * mean.x * by_square - mean.y * by_product;
    float share = float(STRIDE * STRIDE) * weight;
    ssim_slope[place_of_window(at, c.index, size)] = share * vec3(by_mean, by_square, by_product);
    vec4 rest = STRIDE > 1 ? vec4(0.0) : differ(here);
    return rest + vec4(0.0, share * (1.0 - ssim), 0.0, 0.0);
}

vec4 slide_down_column(uvec2 corner, uint column, uint begin, Channel c) {
    vec4 values[STRIP_SPAN];
    [[unroll]] for (uint from = 0; from < STRIP_SPAN; ++from) {
        values[from] = along[STRIDE * begin + push.offset.y + from][column];
    }
    vec4 loss = vec4(0.0);
    [[unroll]] for (uint to = 0; to < STRIP; ++to) {
        uvec2 at = corner + STRIDE * uvec2(column, begin + to) + push.offset;
        bool inside = all(lessThan(at, size));
        if (WITH_SSIM != 0) {
            vec4 moments = window_sum(values, STRIDE * to);
            if (inside) loss += compare(at, c, moments);
        } else if (inside) {
            loss += differ(pair_at(at.x, at.y, c));
        }
    }
    return loss;
}

void main() {
    size = view.size;
    alpha_mode = push.alpha_mode;
    pixels = size.x * size.y;
    const uvec2 extent = uvec2(LOSS_TILE_WIDTH, LOSS_TILE_HEIGHT);
    uint columns = (size.x + extent.x - 1) / extent.x;
    uint tile = group_index();
    if (tile >= columns * push.tile_rows) return;
    uvec2 corner = uvec2(tile % columns, tile / columns) * extent + uvec2(0, push.tile_row);
    uint lane = gl_LocalInvocationID.x;
    vec4 loss = vec4(0.0);
    for (uint index = 0; index < 3; ++index) {
        Channel c = Channel(index, view.background[index], 0.0, push.gain[index], push.toe[index]);
        c.shift = shift_of(corner, c);
        // Tested at the end: some software devices run a body once more, without active lanes, to find that a loop is
        // over.
        uint i = lane;
        if (WITH_SSIM != 0) do {
            uint row = i / STRIPS_OF_ROW;
            uint y = corner.y + row - WINDOW_REACH;
            bool read = i < ROW_STRIPS && matters(y, y + 1, int(2 * WINDOW_REACH));
            if (read) loss += slide_along_row(corner, row, i % STRIPS_OF_ROW * STRIP, c);
            i += WORKGROUP;
        } while (i < ROW_STRIPS);
        barrier();
        i = lane;
        do {
            uint begin = i / COLUMNS * STRIP;
            uint y = corner.y + STRIDE * begin;
            bool read = i < COLUMN_STRIPS && matters(y, y + STRIDE * STRIP, int(WINDOW_REACH));
            if (read) loss += slide_down_column(corner, i % COLUMNS, begin, c);
            i += WORKGROUP;
        } while (i < COLUMN_STRIPS);
        barrier();
    }
    lane_loss[lane] = loss;
    barrier();
    if (lane != 0) return;
    vec4 total = vec4(0.0);
    for (uint i = 0; i < WORKGROUP; ++i) total += lane_loss[i];
    bool counts = corner.y >= push.counted.x && corner.y < push.counted.y;
    loss_from_tile[tile] = counts ? total : vec4(0.0);
}
