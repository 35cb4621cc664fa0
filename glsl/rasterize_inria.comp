#version 460
#include "shared/prelude.glsl"

// Composites by the rules of the 3DGS code, for scenes trained by it: alphas are capped at 0.99, and the splat that
// would take the transmittance below 1e-4 is left out and ends its pixel.
//
// One workgroup per tile, one invocation per pixel. Written for clarity, not for speed; the engine's own kernel is
// `rasterize`. The tiles of a splat are determined in `project` and `expand`.

layout(constant_id = 0) const uint WITH_DEPTH = 0;
// Largest alpha, and least transmittance (3DGS code, forward.cu).
layout(constant_id = 1) const float ALPHA_CAP = 0.99;
layout(constant_id = 2) const float T_MIN = TRANSMITTANCE_MIN;
layout(constant_id = 3) const uint WITH_ENDS = 1;
layout(local_size_x = 128) in;

layout(set = 0, binding = 0, scalar) readonly buffer ViewBlock { View view; };
layout(set = 0, binding = 1, scalar) readonly buffer Ranges { uvec2 range_from_tile[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Sources { uint emitted_from_isect[]; };
layout(set = 0, binding = 3, scalar) readonly buffer Owners { uint splat_from_emitted[]; };
layout(set = 0, binding = 4, scalar) readonly buffer Shapes { vec4 ellipse_from_splat[]; };
layout(set = 0, binding = 5, scalar) readonly buffer ColorProducts { vec4 whiten_rg_from_splat[]; };
layout(set = 0, binding = 6, scalar) readonly buffer Rests { vec2 blue_depth_from_splat[]; };
layout(set = 0, binding = 7, scalar) writeonly buffer Image { float image[]; };
layout(set = 0, binding = 8, scalar) writeonly buffer Depth { float depth[]; };
layout(set = 0, binding = 9, scalar) writeonly buffer Ends { uint isect_end_from_pixel[]; };

layout(push_constant, scalar) uniform Push {
    uint tile_stride;  // workgroup g composites tile g * tile_stride mod tile count
} push;

#include "shared/primitive.glsl"

// Accumulated colour of the pixel.
vec3 color = vec3(0.0);
float transmittance = 1.0;
float far = 0.0;
uint last = 0;

// Blends one splat of the list; true if the pixel continues.
bool blend(uint isect, uvec2 in_tile, uvec2 corner) {
    uint splat = splat_from_emitted[emitted_from_isect[isect]];
    vec4 tone = whiten_rg_from_splat[splat];
    float exponent = exponent_at(in_tile, corner, ellipse_from_splat[splat], tone);
    if (exponent < -LOG2_255) return true;
    float alpha = min(exp2(exponent), ALPHA_CAP);
    float next = transmittance * (1.0 - alpha);
    if (next < T_MIN) return false;
    float weight = alpha * transmittance;
    vec2 rest = blue_depth_from_splat[splat];
    color += weight * vec3(tone.zw, rest.x);
    far += weight * depth_of(rest);
    transmittance = next;
    last = isect + 1;
    return true;
}

void composite(uint tile) {
    uint lane = gl_LocalInvocationID.x;
    uvec2 drawn = uvec2(tile % view.tiles.x, tile / view.tiles.x) * uvec2(TILE_WIDTH, TILE_HEIGHT);
    uvec2 in_tile = uvec2(lane % TILE_WIDTH, lane / TILE_WIDTH);
    uvec2 at = drawn + in_tile;
    if (any(greaterThanEqual(at, view.size))) return;
    uvec2 corner = drawn + uvec2(0, view.first_row);
    uvec2 range = range_from_tile[tile];
    // Two per iteration, to halve the iterations that a software device counts.
    for (uint isect = range.x; isect < range.y; isect += 2) {
        if (!blend(isect, in_tile, corner)) break;
        if (isect + 1 < range.y && !blend(isect + 1, in_tile, corner)) break;
    }
    uint pixels = view.size.x * view.size.y;
    uint pixel = at.y * view.size.x + at.x;
    color += transmittance * view.background;
    image[pixel] = color.r;
    image[pixels + pixel] = color.g;
    image[2 * pixels + pixel] = color.b;
    image[3 * pixels + pixel] = transmittance;
    if (WITH_ENDS != 0) isect_end_from_pixel[pixel] = last;
    if (WITH_DEPTH != 0) depth[pixel] = far;
}

void main() {
    uint tile_count = view.tiles.x * view.tiles.y;
    uint group = group_index();
    if (group >= tile_count) return;
    composite((group * push.tile_stride) % tile_count);
}
