#version 460
#include "shared/prelude.glsl"
#include "shared/photo.glsl"
#include "shared/exposure.glsl"
#include "shared/patches.glsl"

// Sums of least squares for a photograph's gains: those of (x + 0.055)(y + 0.055) and of (x + 0.055)^2 in each channel,
// x the render without exposure and y the photograph.
//
// One workgroup per EXPOSURE_PIXELS pixels; lanes add in a fixed order. Clipped and masked values do not count, and
// those far from the render at the present gain count less (Huber), because they are of something else.

layout(constant_id = 0) const uint WORKGROUP = 64;
// 1: patches that are ignored have no weight.
layout(constant_id = 1) const uint WITH_IGNORED = 0;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer ViewBlock { View view; };
layout(set = 0, binding = 1, scalar) readonly buffer Image { float image[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Photo { uint photo[]; };
// Two for each workgroup: products and the weight, squares.
layout(set = 0, binding = 3, scalar) writeonly buffer Partials { vec4 sums_from_group[]; };
// A bit of each patch.
layout(set = 0, binding = 4, scalar) readonly buffer Ignored { uint ignored[]; };

layout(push_constant, scalar) uniform Push {
    uint alpha_mode;     // ALPHA_MASKS, or 0 to composite over the background
    vec3 gain;           // present gains
    vec3 toe;            // slopes on the curve's toe, gain^2.4
    uint patch_shift;    // log2 of a patch's pixels along a side
    uint patch_columns;  // patches in a row
    uint photo_first;    // place of the first drawn pixel in the photograph's part
    uvec2 counted;       // drawn rows that count, and the end of those
} push;

// Levels up to 13 lie on the toe or near it.
const float VALUE_LEAST = 13.5 / 255.0;
const float VALUE_MOST = 252.5 / 255.0;
// Residual from which a pixel counts in inverse proportion.
const float HUBER = 0.1;

shared vec4 lane_products[WORKGROUP];
shared vec4 lane_squares[WORKGROUP];

void main() {
    uint pixels = view.size.x * view.size.y;
    uint group = group_index();
    uint first = push.counted.x * view.size.x + group * EXPOSURE_PIXELS;
    uint end = push.counted.y * view.size.x;
    if (first >= end) return;
    uint lane = gl_LocalInvocationID.x;
    vec4 products = vec4(0.0);
    vec4 squares = vec4(0.0);
    for (uint i = lane; i < EXPOSURE_PIXELS; i += WORKGROUP) {
        uint pixel = first + i;
        if (pixel >= end) break;
        uint rgba = photo[push.photo_first + pixel];
        float alpha = channel_of(rgba, 3);
        float coverage = push.alpha_mode == ALPHA_MASKS ? alpha : float(alpha == 1.0);
        if (WITH_IGNORED != 0) {
            uint row = view.first_row + pixel / view.size.x;
            uint place = patch_at(pixel % view.size.x, row, push.patch_shift, push.patch_columns);
            coverage *= kept_by(ignored[word_of(place)], place);
        }
        for (uint c = 0; c < 3; ++c) {
            float y = channel_of(rgba, c);
            if (y < VALUE_LEAST || y > VALUE_MOST) continue;
            float x = image[c * pixels + pixel];
            float residual = abs(exposed(x, y, push.gain[c], push.toe[c]).x - y);
            float weight = coverage * min(1.0, HUBER / max(residual, 1e-6));
            float shifted = x + CURVE_OFFSET;
            products[c] += weight * shifted * (y + CURVE_OFFSET);
            squares[c] += weight * shifted * shifted;
            products.w += weight;
        }
    }
    lane_products[lane] = products;
    lane_squares[lane] = squares;
    barrier();
    if (lane != 0) return;
    for (uint i = 1; i < WORKGROUP; ++i) {
        products += lane_products[i];
        squares += lane_squares[i];
    }
    sums_from_group[2 * group] = products;
    sums_from_group[2 * group + 1] = squares;
}
