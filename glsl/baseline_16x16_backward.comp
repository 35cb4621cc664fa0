#version 460
#extension GL_KHR_shader_subgroup_arithmetic : require
#extension GL_KHR_shader_subgroup_vote : require
#extension GL_EXT_shader_atomic_float : require
#include "shared/prelude.glsl"

// Baseline, not used in training: the backward pass of `baseline_16x16`, pixel by pixel from back to front.
//
// One workgroup per tile of 16x16 pixels and one pixel per invocation. If any pixel of a subgroup blends a splat, the
// subgroup adds up its nine sums and one invocation adds them to the splat's, atomically and so in no fixed order. It
// needs atomic float addition, which it does not emulate.

layout(local_size_x = 256) in;

layout(set = 0, binding = 0, scalar) readonly buffer ViewBlock { View view; };
layout(set = 0, binding = 1, scalar) readonly buffer Ranges { uvec2 range_from_tile[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Isects { uint splat_from_isect[]; };
layout(set = 0, binding = 3, scalar) readonly buffer Shapes { vec4 ellipse_from_splat[]; };
layout(set = 0, binding = 4, scalar) readonly buffer ColorProducts { vec4 whiten_rg_from_splat[]; };
layout(set = 0, binding = 5, scalar) readonly buffer Rests { vec2 blue_depth_from_splat[]; };
layout(set = 0, binding = 6, scalar) readonly buffer Image { float image[]; };
layout(set = 0, binding = 7, scalar) readonly buffer ImageGradient { float d_image[]; };
layout(set = 0, binding = 8, scalar) readonly buffer Ends { uint isect_end_from_pixel[]; };
// Nine sums a splat: s, s f_x, s f_y, s f_x^2, s f_x f_y, s f_y^2, red, green, blue.
layout(set = 0, binding = 9, scalar) buffer Sums { float sum_from_splat[]; };

#include "shared/baseline_16x16.glsl"

shared uint batch_splat[BASELINE_BATCH];
shared uint last_of_tile;

// Of the pixel: transmittance in front of the current splat, upstream gradient, and colour behind the splat projected
// on it.
float transmittance;
vec3 d_color;
float behind;

// Removes a splat from the pixel; returns s and the blending weight.
vec2 take_off(uint slot, float exponent) {
    float raw = exp2(exponent);
    float alpha = min(raw, ALPHA_MAX);
    transmittance /= 1.0 - alpha;
    float weight = alpha * transmittance;
    float ahead = dot(d_color, vec3(batch_tone[slot].zw, batch_blue[slot]));
    // No gradient where alpha is capped.
    float s = raw < ALPHA_MAX ? weight * (ahead - behind) : 0.0;
    behind = mix(behind, ahead, alpha);
    return vec2(s, weight);
}

void add(uint splat, float s, vec2 f, float weight) {
    vec3 shape = subgroupAdd(vec3(s, s * f));
    vec3 second = subgroupAdd(s * vec3(f.x * f.x, f.x * f.y, f.y * f.y));
    vec3 color = subgroupAdd(weight * d_color);
    if (!subgroupElect()) return;
    uint base = 9 * splat;
    [[unroll]] for (uint i = 0; i < 3; ++i) {
        atomicAdd(sum_from_splat[base + i], shape[i]);
        atomicAdd(sum_from_splat[base + 3 + i], second[i]);
        atomicAdd(sum_from_splat[base + 6 + i], color[i]);
    }
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
    uint pixels = view.size.x * view.size.y;
    uint pixel = inside ? at.y * view.size.x + at.x : 0;
    d_color = inside ? vec3(d_image[pixel], d_image[pixels + pixel], d_image[2 * pixels + pixel]) : vec3(0.0);
    transmittance = inside ? image[3 * pixels + pixel] : 0.0;
    behind = dot(d_color, view.background);
    uint end = inside ? isect_end_from_pixel[pixel] : 0;

    // Splats behind the last one of all pixels need not be fetched.
    if (lane == 0) last_of_tile = 0;
    barrier();
    atomicMax(last_of_tile, end);
    barrier();
    uint first = range_from_tile[tile].x;
    for (uint rest = max(last_of_tile, first); rest > first;) {
        uint count = min(BASELINE_BATCH, rest - first);
        rest -= count;
        barrier();
        if (lane < count) {
            batch_splat[lane] = splat_from_isect[rest + lane];
            fetch(lane, batch_splat[lane], corner);
        }
        barrier();
        for (uint slot = count; slot-- > 0;) {
            vec2 f;
            float exponent = baseline_exponent(slot, vec2(offset) + 0.5, f);
            bool on = rest + slot < end && exponent >= -LOG2_255;
            if (!subgroupAny(on)) continue;
            vec2 taken = on ? take_off(slot, exponent) : vec2(0.0);
            add(batch_splat[slot], taken.x, f, taken.y);
        }
    }
}
