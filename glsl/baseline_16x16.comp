#version 460
#include "shared/prelude.glsl"

// Baseline, not used in rendering: compositing as in the 3DGS paper (Kerbl et al. 2023, section 6).
//
// One workgroup per tile of 16x16 pixels and one pixel per invocation. The workgroup fetches batches of 256 splats into
// shared memory; a tile ends when all of its pixels vote so. Its lists are per tile of its own size; its result is that
// of `rasterize`.

layout(local_size_x = 256) in;

layout(set = 0, binding = 0, scalar) readonly buffer ViewBlock { View view; };
layout(set = 0, binding = 1, scalar) readonly buffer Ranges { uvec2 range_from_tile[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Isects { uint splat_from_isect[]; };
layout(set = 0, binding = 3, scalar) readonly buffer Shapes { vec4 ellipse_from_splat[]; };
layout(set = 0, binding = 4, scalar) readonly buffer ColorProducts { vec4 whiten_rg_from_splat[]; };
layout(set = 0, binding = 5, scalar) readonly buffer Rests { vec2 blue_depth_from_splat[]; };
layout(set = 0, binding = 6, scalar) writeonly buffer Image { float image[]; };
layout(set = 0, binding = 7, scalar) writeonly buffer Ends { uint isect_end_from_pixel[]; };

#include "shared/baseline_16x16.glsl"

const float T_MIN = TRANSMITTANCE_MIN;

shared uint votes;

bool any_lane(bool mine) {
    barrier();
    if (gl_LocalInvocationID.x == 0) votes = 0;
    barrier();
    if (mine) votes = 1;
    barrier();
    return votes != 0;
}

void main() {
    uvec2 tiles = (view.size + BASELINE_TILE - 1) / BASELINE_TILE;
    uint tile = group_index();
    if (tile >= tiles.x * tiles.y) return;
    uint lane = gl_LocalInvocationID.x;
    uvec2 corner = uvec2(tile % tiles.x, tile / tiles.x) * BASELINE_TILE;
    uvec2 offset = uvec2(lane % BASELINE_TILE, lane / BASELINE_TILE);
    uvec2 at = corner + offset;
    bool inside = all(lessThan(at, view.size));
    bool done = !inside;
    float transmittance = 1.0;
    vec3 color = vec3(0.0);
    uint last = 0;

    uvec2 range = range_from_tile[tile];
    for (uint begin = range.x; begin < range.y; begin += BASELINE_BATCH) {
        if (!any_lane(!done)) break;
        if (begin + lane < range.y) fetch(lane, splat_from_isect[begin + lane], corner);
        barrier();
        uint count = min(BASELINE_BATCH, range.y - begin);
        for (uint slot = 0; slot < count && !done; ++slot) {
            vec2 f;
            float exponent = baseline_exponent(slot, vec2(offset) + 0.5, f);
            if (exponent < -LOG2_255) continue;
            float alpha = min(exp2(exponent), ALPHA_MAX);
            color += alpha * transmittance * vec3(batch_tone[slot].zw, batch_blue[slot]);
            transmittance *= 1.0 - alpha;
            last = begin + slot + 1;
            done = transmittance < T_MIN;
        }
    }

    if (!inside) return;
    uint pixels = view.size.x * view.size.y;
    uint pixel = at.y * view.size.x + at.x;
    color += transmittance * view.background;
    image[pixel] = color.r;
    image[pixels + pixel] = color.g;
    image[2 * pixels + pixel] = color.b;
    image[3 * pixels + pixel] = transmittance;
    isect_end_from_pixel[pixel] = last;
}
