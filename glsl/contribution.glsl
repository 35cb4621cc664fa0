// Contribution of each splat of a tile's list to the tile's pixels; included by `contribution.comp` and its variants,
// which define the lanes' votes and sums.
//
// One record per (tile, splat) pair, written once and without atomics. Each lane fetches one splat of a batch and
// shares it; in the end it holds, and stores, the record of that splat.

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
layout(set = 0, binding = 6, scalar) readonly buffer Spending { float spent_from_pixel[]; };
layout(set = 0, binding = 7, scalar) readonly buffer Limits { float limit_from_pixel[]; };
layout(set = 0, binding = 8, scalar) writeonly buffer Records { vec3 record_from_emitted[]; };
layout(set = 0, binding = 9, scalar) readonly buffer Rests { vec2 blue_depth_from_splat[]; };
layout(set = 0, binding = 10, scalar) readonly buffer Planes { vec3 plane_from_splat[]; };

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

// Reduction over all lanes, of the pixels where a splat counts: the maximum of budget spent plus weight, the sum of the
// weights, and the lowest limit. All lanes call this with their own pixels' part.
vec3 over_lanes(vec3 mine);

// Record of a splat that counts nowhere.
const vec3 NOTHING = vec3(0.0, 0.0, 3.4e38);

vec4 spent[QUADS];
vec4 limit[QUADS];

void load_pixels(Tile t) {
    [[unroll]] for (uint q = 0; q < QUADS; ++q) {
        spent[q] = limit[q] = vec4(0.0);
        [[unroll]] for (uint r = 0; r < 4; ++r) {
            if (!inside(t, q, view)[r]) continue;
            uint pixel = pixel_of(t, q * 4 + r, view);
            spent[q][r] = spent_from_pixel[pixel];
            limit[q][r] = limit_from_pixel[pixel];
        }
    }
}

vec3 both_of(vec3 a, vec3 b) {
    return vec3(max(a.x, b.x), a.y + b.y, min(a.z, b.z));
}

// The lane's part for the splat staged by a lane.
vec3 contribution(Tile t, uint lane) {
    WeightColumn column = weight_column_of(t, staged_by(lane), lane);
    vec4 most = vec4(NOTHING.x);
    vec4 sum = vec4(NOTHING.y);
    vec4 least = vec4(NOTHING.z);
    [[unroll]] for (uint q = 0; q < QUADS; ++q) {
        vec4 weight = weights_of(column, q);
        bvec4 on = greaterThan(weight, vec4(0.0));
        most = max(most, mix(vec4(0.0), spent[q] + weight, on));
        sum += weight;
        least = min(least, mix(vec4(NOTHING.z), limit[q], on));
    }
    return both_of(both_of(vec3(most.x, sum.x, least.x), vec3(most.y, sum.y, least.y)),
                   both_of(vec3(most.z, sum.z, least.z), vec3(most.w, sum.w, least.w)));
}

// Contributions of a batch of splats from `begin` on.
void weigh_batch(Tile t, uint begin, uint end) {
    uint lane = stage_lane();
    bool mine = lane < end - begin;
    uint source = emitted_from_isect[mine ? begin + lane : begin];
    uint splat = splat_from_emitted[source];
    Staged staged = Staged(ellipse_from_splat[splat], whiten_rg_from_splat[splat], vec2(0.0));
    if (SURFEL != 0) staged.rest = blue_depth_from_splat[splat];
    if (!mine) hide(staged);
    stage(staged);
    if (SURFEL != 0) stage_plane(plane_from_splat[splat]);
    uint count = min(WORKGROUP, end - begin);
    vec3 kept = NOTHING;
    uint i = 0;
    // Two per iteration, to halve the iterations that a software device counts; an odd one is paired with a hidden
    // splat.
    do {
        vec3 even = over_lanes(contribution(t, i));
        vec3 odd = over_lanes(contribution(t, i + 1));
        kept = lane == i ? even : lane == i + 1 ? odd : kept;
        i += 2;
    } while (i < count);
    if (mine) record_from_emitted[source] = kept;
}

void weigh_tile(uint tile) {
    Tile t = tile_of(tile, view);
    begin_pixels(t);
    load_pixels(t);
    uvec2 range = range_from_tile[tile];
    uint begin = range.x;
    // Tested at the end: some software devices run a body once more, without active lanes, to find that a loop is over.
    if (begin < range.y) {
        do {
            weigh_batch(t, begin, range.y);
            begin += WORKGROUP;
            if (!any_open()) break;
        } while (begin < range.y);
    }
    // Records of splats behind the last one that counted, which nothing else clears.
    for (uint isect = begin + gl_LocalInvocationID.x; isect < range.y; isect += WORKGROUP) {
        record_from_emitted[emitted_from_isect[isect]] = NOTHING;
    }
}

void main() {
    uint tile_count = view.tiles.x * view.tiles.y;
    uint group = group_index();
    if (group >= tile_count) return;
    weigh_tile((group * push.tile_stride) % tile_count);
}
