// For each pixel, the highest prune rank with a summed weight within the budget, one digit per dispatch; included by
// `prune_limit.comp` and its variants, which define the lanes' vote on stopping.
//
// A pixel without the splats of ranks 0 to r loses the sum of their weights, which grows with r. `limit` is the largest
// r known to be within the budget; a dispatch tries limit + step, + 2 step and + 3 step. With steps of 64, 16, 4 and 1
// from a limit of 0 it ends at the largest of 255 ranks. Sums of fewer of the same terms in the same order are never
// larger in floats either, so that every subset of ranks up to the limit is within the budget.

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
layout(set = 0, binding = 6, scalar) readonly buffer Ranking { float rank_from_splat[]; };
layout(set = 0, binding = 7, scalar) buffer Limits { float limit_from_pixel[]; };
layout(set = 0, binding = 8, scalar) writeonly buffer Spending { float spent_from_pixel[]; };
layout(set = 0, binding = 9, scalar) readonly buffer Rests { vec2 blue_depth_from_splat[]; };
layout(set = 0, binding = 10, scalar) readonly buffer Planes { vec3 plane_from_splat[]; };

layout(push_constant, scalar) uniform Push {
    uint tile_stride;  // workgroup g takes tile g * tile_stride mod tile count
    float step;        // distance of two tried ranks
    float budget;      // largest sum of removed weights of a pixel
} push;

#include "shared/math.glsl"
#include "shared/tile.glsl"
#include "shared/primitive.glsl"
#include "shared/plane.glsl"
#include "shared/surfel.glsl"
#include "shared/surfel_column.glsl"
#include "shared/stage.glsl"
#include "shared/weights.glsl"

// Of the lane's pixels: the limit so far, the summed weight of rank 0, and those up to each tried rank.
vec4 limit[QUADS];
vec4 spent[QUADS];
vec4 first[QUADS];
vec4 second[QUADS];
vec4 third[QUADS];

void begin_sums(Tile t) {
    [[unroll]] for (uint q = 0; q < QUADS; ++q) {
        spent[q] = first[q] = second[q] = third[q] = limit[q] = vec4(0.0);
        [[unroll]] for (uint r = 0; r < 4; ++r) {
            if (inside(t, q, view)[r]) limit[q][r] = limit_from_pixel[pixel_of(t, q * 4 + r, view)];
        }
    }
}

// Adds the splat staged by a lane.
void add(Tile t, uint lane) {
    Staged splat = staged_by(lane);
    WeightColumn column = weight_column_of(t, splat, lane);
    vec4 rank = vec4(splat.rest.x);
    [[unroll]] for (uint q = 0; q < QUADS; ++q) {
        vec4 weight = weights_of(column, q);
        vec4 beyond = rank - limit[q];
        spent[q] += mix(vec4(0.0), weight, equal(rank, vec4(0.0)));
        first[q] += mix(vec4(0.0), weight, lessThanEqual(beyond, vec4(push.step)));
        second[q] += mix(vec4(0.0), weight, lessThanEqual(beyond, vec4(2.0 * push.step)));
        third[q] += mix(vec4(0.0), weight, lessThanEqual(beyond, vec4(3.0 * push.step)));
    }
}

// Fetches the splats from `begin` on, one per lane, with their ranks; returns their number.
uint stage_batch(uint begin, uint end) {
    uint isect = begin + stage_lane();
    uint splat = splat_from_emitted[emitted_from_isect[min(isect, end - 1)]];
    Staged mine = Staged(ellipse_from_splat[splat], whiten_rg_from_splat[splat], vec2(rank_from_splat[splat], 0.0));
    if (SURFEL != 0) mine.rest.y = blue_depth_from_splat[splat].y;
    if (isect >= end) hide(mine);
    stage(mine);
    if (SURFEL != 0) stage_plane(plane_from_splat[splat]);
    return min(WORKGROUP, end - begin);
}

// Two splats per iteration, to halve the iterations that a software device counts; an odd one is paired with a hidden
// splat.
void add_list(Tile t, uint begin, uint end) {
    do {
        uint count = stage_batch(begin, end);
        uint i = 0;
        do {
            add(t, i);
            add(t, i + 1);
            i += 2;
        } while (i < count);
        begin += WORKGROUP;
        if (!any_open()) break;
    } while (begin < end);
}

void store_pixels(Tile t) {
    vec4 budget = vec4(push.budget);
    [[unroll]] for (uint q = 0; q < QUADS; ++q) {
        vec4 steps = mix(vec4(0.0), vec4(1.0), lessThanEqual(first[q], budget))
                   + mix(vec4(0.0), vec4(1.0), lessThanEqual(second[q], budget))
                   + mix(vec4(0.0), vec4(1.0), lessThanEqual(third[q], budget));
        [[unroll]] for (uint r = 0; r < 4; ++r) {
            if (!inside(t, q, view)[r]) continue;
            uint pixel = pixel_of(t, q * 4 + r, view);
            limit_from_pixel[pixel] = limit[q][r] + push.step * steps[r];
            spent_from_pixel[pixel] = spent[q][r];
        }
    }
}

void main() {
    uint tile_count = view.tiles.x * view.tiles.y;
    uint group = group_index();
    if (group >= tile_count) return;
    uint tile = (group * push.tile_stride) % tile_count;
    Tile t = tile_of(tile, view);
    begin_pixels(t);
    begin_sums(t);
    uvec2 range = range_from_tile[tile];
    if (range.x < range.y) add_list(t, range.x, range.y);
    store_pixels(t);
}
