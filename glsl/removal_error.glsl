// Change of a tile's pixels by the removal of each splat of its list; included by `removal_error.comp` and its
// variants, which define the lanes' votes and sums.
//
// Let C = P + R, with P the sum of the splats up to splat i and R the rest, seen through the transmittance T' behind
// splat i. Removal of splat i changes the pixel by w (R / T' - c), with its weight w and its colour c. For a pixel that
// has ended, R / T' is the background.
//
// One record per (tile, splat) pair, written once and without atomics: sums of the weights and of the squared changes,
// and a zero, since `sum_by_splat` adds up three numbers.

layout(constant_id = 0) const uint WORKGROUP = 8;
layout(constant_id = 1) const float T_MIN = TRANSMITTANCE_MIN;
layout(constant_id = 2) const float LOG2_ALPHA_MIN = -LOG2_255;
// Not 0: pixels end by the rule of the 3DGS code.
layout(constant_id = 3) const uint INRIA = 0;
// Not 0: surfels.
layout(constant_id = 4) const uint SURFEL = 0;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer ViewBlock { View view; };
layout(set = 0, binding = 1, scalar) readonly buffer Ranges { uvec2 range_from_tile[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Sources { uint emitted_from_isect[]; };
layout(set = 0, binding = 3, scalar) readonly buffer Owners { uint splat_from_emitted[]; };
layout(set = 0, binding = 4, scalar) readonly buffer Shapes { vec4 ellipse_from_splat[]; };
layout(set = 0, binding = 5, scalar) readonly buffer ColorProducts { vec4 whiten_rg_from_splat[]; };
layout(set = 0, binding = 6, scalar) readonly buffer Rests { vec2 blue_depth_from_splat[]; };
layout(set = 0, binding = 7, scalar) readonly buffer Image { float image[]; };
layout(set = 0, binding = 8, scalar) writeonly buffer Records { vec3 record_from_emitted[]; };
layout(set = 0, binding = 9, scalar) readonly buffer Planes { vec3 plane_from_splat[]; };

layout(push_constant, scalar) uniform Push {
    uint tile_stride;  // workgroup g takes tile g * tile_stride mod tile count
} push;

#include "shared/math.glsl"
#include "shared/tile.glsl"
#include "shared/primitive.glsl"
#include "shared/plane.glsl"
#include "shared/surfel.glsl"
#include "shared/surfel_column.glsl"
#include "shared/stage.glsl"
#include "shared/weights.glsl"

// Sum over the lanes (each has its own pixels). All lanes call this.
vec2 over_lanes(vec2 mine);

// The rest R of each channel at the lane's pixels.
vec4 red[QUADS];
vec4 green[QUADS];
vec4 blue[QUADS];

void load_pixels(Tile t) {
    uint pixels = view.size.x * view.size.y;
    [[unroll]] for (uint q = 0; q < QUADS; ++q) {
        red[q] = green[q] = blue[q] = vec4(0.0);
        [[unroll]] for (uint r = 0; r < 4; ++r) {
            if (!inside(t, q, view)[r]) continue;
            uint pixel = pixel_of(t, q * 4 + r, view);
            red[q][r] = image[pixel];
            green[q][r] = image[pixels + pixel];
            blue[q][r] = image[2 * pixels + pixel];
        }
    }
}

// Squared change of a channel; `rest` is R, the sum of the splats behind.
vec4 change(vec4 weight, vec4 rest, vec4 passing, float color, float background) {
    vec4 behind = mix(vec4(background), rest / max(passing, vec4(T_MIN)), greaterThanEqual(passing, vec4(T_MIN)));
    vec4 off = weight * (behind - color);
    return off * off;
}

// The lane's part for the splat staged by a lane: sums of the weights and of the squared changes.
vec2 removal_error(Tile t, uint lane) {
    Staged splat = staged_by(lane);
    WeightColumn column = weight_column_of(t, splat, lane);
    vec4 weights = vec4(0.0);
    vec4 changes = vec4(0.0);
    [[unroll]] for (uint q = 0; q < QUADS; ++q) {
        vec4 weight = weights_of(column, q);
        vec4 passing = transmittance[q];
        red[q] -= weight * splat.tone.z;
        green[q] -= weight * splat.tone.w;
        blue[q] -= weight * splat.rest.x;
        weights += weight;
        changes += change(weight, red[q], passing, splat.tone.z, view.background.r);
        changes += change(weight, green[q], passing, splat.tone.w, view.background.g);
        changes += change(weight, blue[q], passing, splat.rest.x, view.background.b);
    }
    const vec4 one = vec4(1.0);
    return vec2(dot(weights, one), dot(changes, one));
}

// Records of a batch of splats from `begin` on.
void take_batch(Tile t, uint begin, uint end) {
    uint lane = stage_lane();
    bool mine = lane < end - begin;
    uint source = emitted_from_isect[mine ? begin + lane : begin];
    uint splat = splat_from_emitted[source];
    Staged staged = Staged(ellipse_from_splat[splat], whiten_rg_from_splat[splat], blue_depth_from_splat[splat]);
    if (!mine) hide(staged);
    stage(staged);
    if (SURFEL != 0) stage_plane(plane_from_splat[splat]);
    uint count = min(WORKGROUP, end - begin);
    vec2 kept = vec2(0.0);
    uint i = 0;
    // Two per iteration, to halve the iterations that a software device counts; an odd one is paired with a hidden
    // splat.
    do {
        vec2 even = over_lanes(removal_error(t, i));
        vec2 odd = over_lanes(removal_error(t, i + 1));
        kept = lane == i ? even : lane == i + 1 ? odd : kept;
        i += 2;
    } while (i < count);
    if (mine) record_from_emitted[source] = vec3(kept, 0.0);
}

void take_tile(uint tile) {
    Tile t = tile_of(tile, view);
    begin_pixels(t);
    load_pixels(t);
    uvec2 range = range_from_tile[tile];
    uint begin = range.x;
    // Tested at the end: some software devices run a body once more, without active lanes, to find that a loop is over.
    if (begin < range.y) {
        do {
            take_batch(t, begin, range.y);
            begin += WORKGROUP;
            if (!any_open()) break;
        } while (begin < range.y);
    }
    // Records of splats behind the last one that counted, which nothing else clears.
    for (uint isect = begin + gl_LocalInvocationID.x; isect < range.y; isect += WORKGROUP) {
        record_from_emitted[emitted_from_isect[isect]] = vec3(0.0);
    }
}

void main() {
    uint tile_count = view.tiles.x * view.tiles.y;
    uint group = group_index();
    if (group >= tile_count) return;
    take_tile((group * push.tile_stride) % tile_count);
}
