// Front-to-back compositing of one tile; included by `rasterize.comp` and its variants, which define the lanes' vote on
// stopping.
//
// A lane owns LANE_PIXELS pixels of one column, four to a vec4. Each lane fetches one splat of a batch and shares it.
// Loops test at their end: some software devices run a body once more, without active lanes, to find that it is over. A
// splat counts for a pixel while the transmittance in front of it is at least T_MIN ("include last"), so that the
// truncation error is at most T_MIN of the colour range.
//
// Splats may come in bands, nearest first, one band per dispatch: each continues from the stored image with exactly the
// values of the lane's registers, and the background is added after the last. So bands change no bit.

layout(constant_id = 0) const uint WORKGROUP = 8;
layout(local_size_x_id = 0) in;

#include "shared/rasterize_io.glsl"
#include "shared/math.glsl"
#include "shared/tile.glsl"
#include "shared/primitive.glsl"
#include "shared/plane.glsl"
#include "shared/surfel.glsl"
#include "shared/surfel_column.glsl"
#include "shared/stage.glsl"

bool any_lane(bool mine);

// The lane's pixels: transmittance, colour and depth so far, and one past the last intersection of the band that
// counted.
vec4 transmittance[QUADS];
vec4 red[QUADS];
vec4 green[QUADS];
vec4 blue[QUADS];
vec4 far[QUADS];
uvec4 last[QUADS];
// Of the splats' planes: sums of weighted depths and normals, depth where the transmittance falls to 1/2, and sum of
// depths by their parts between transmittances of 3/4 and 1/4.
vec4 plane_depth[QUADS];
vec4 median[QUADS];
vec4 normal_x[QUADS];
vec4 normal_y[QUADS];
vec4 normal_z[QUADS];
vec4 interquartile[QUADS];
// Depth of the first plane, and sums of the logarithms of depths over it.
vec4 first[QUADS];
vec4 log_sum[QUADS];
vec4 log_square[QUADS];
// Focal length and principal point.
vec4 lens;
// Limits of depth.
vec4 limit[QUADS];

// True if any pixel of the workgroup is still open.
bool any_open() {
    bool open = false;
    [[unroll]] for (uint q = 0; q < QUADS; ++q) {
        open = open || any(greaterThanEqual(transmittance[q], vec4(T_MIN)));
    }
    return any_lane(open);
}

// Whether an alpha takes the transmittance from above 1/2 to 1/2 or below; the same product as the next transmittance.
bvec4 passes_half(uint q, vec4 alpha) {
    return both(greaterThan(transmittance[q], vec4(0.5)),
                lessThanEqual(transmittance[q] * (vec4(1.0) - alpha), vec4(0.5)));
}

// Adds the logarithm of a plane's depth to the pixels of quad `q`: over the first one's, so that squares keep their
// digits.
void add_log(uint q, vec4 alpha, vec4 depths) {
    bvec4 counts = greaterThan(alpha, vec4(0.0));
    first[q] = mix(first[q], depths, both(counts, equal(first[q], vec4(0.0))));
    vec4 m = mix(vec4(0.0), log(depths / first[q]), counts);
    vec4 weight = alpha * transmittance[q];
    log_sum[q] += weight * m;
    log_square[q] += weight * m * m;
}

// Part of an alpha's weight that is between transmittances of 3/4 and 1/4.
vec4 interquartile_part(uint q, vec4 alpha) {
    vec4 behind = transmittance[q] * (vec4(1.0) - alpha);
    return clamp(transmittance[q], vec4(0.25), vec4(0.75)) - clamp(behind, vec4(0.25), vec4(0.75));
}

// Adds a splat's plane to the pixels of quad `q`, where it has this alpha.
void add_plane(uint q, vec4 alpha, vec4 depths, vec3 normal) {
    vec4 weight = alpha * transmittance[q];
    plane_depth[q] += weight * depths;
    normal_x[q] += weight * normal.x;
    normal_y[q] += weight * normal.y;
    normal_z[q] += weight * normal.z;
    median[q] = mix(median[q], depths, passes_half(q, alpha));
    interquartile[q] += interquartile_part(q, alpha) * depths;
}

void blend(Tile t, uint isect, Staged splat, vec3 plane) {
    Column column = column_of(t, splat.shape, splat.tone);
    PlaneColumn plane_column;
    vec3 normal;
    if (WITH_SURFACE != 0) {
        vec3 drawn = SURFEL != 0 ? drawn_plane(splat.shape, splat.tone.xy, plane) : plane;
        plane_column = plane_column_of(t, drawn, splat.shape.xy, splat.rest.y);
        normal = normal_of(plane, splat.shape.xy, lens);
    }
    SurfelColumn surfel;
    Hits hits;
    if (SURFEL != 0) surfel = surfel_column_of(t, splat.shape, splat.tone.xy, plane, depth_of(splat.rest), view);
    [[unroll]] for (uint q = 0; q < QUADS; ++q) {
        vec4 f;
        vec4 exponent = exponent_of(column, q, f);
        if (SURFEL != 0) exponent = surfel_exponent(column, surfel, q, f, hits);
        bvec4 on = both(greaterThanEqual(exponent, vec4(LOG2_ALPHA_MIN)),
                        greaterThanEqual(transmittance[q], vec4(T_MIN)));
        if (WITH_LIMIT != 0) on = both(on, lessThan(vec4(depth_of(splat.rest)), limit[q]));
        vec4 alpha = mix(vec4(0.0), min(exp2(exponent), vec4(ALPHA_MAX)), on);
        vec4 weight = alpha * transmittance[q];
        red[q] += weight * splat.tone.z;
        green[q] += weight * splat.tone.w;
        blue[q] += weight * splat.rest.x;
        if (WITH_DEPTH != 0) far[q] += weight * depth_of(splat.rest);
        if (WITH_SURFACE != 0) {
            vec4 depths;
            if (SURFEL != 0) depths = depth_of_hits(plane_column, hits, view.near_plane);
            else depths = depth_of(plane_column, q);
            add_plane(q, alpha, depths, normal);
            if (WITH_SPREAD != 0) add_log(q, alpha, depths);
        }
        if (WITH_IDS != 0) last[q] = mix(last[q], uvec4(isect + 1), passes_half(q, alpha));
        transmittance[q] *= vec4(1.0) - alpha;
        if (WITH_ENDS != 0) last[q] = mix(last[q], uvec4(isect + 1), on);
    }
}

// Fetches the splats from `begin` on, one per lane; returns their number.
uint stage_batch(uint begin, uint end) {
    uint isect = begin + stage_lane();
    uint splat = splat_from_emitted[emitted_from_isect[min(isect, end - 1)]];
    Staged mine = Staged(ellipse_from_splat[splat], whiten_rg_from_splat[splat], blue_depth_from_splat[splat]);
    if (isect >= end) hide(mine);
    stage(mine);
    if (WITH_SURFACE != 0 || SURFEL != 0) stage_plane(plane_from_splat[splat]);
    return min(WORKGROUP, end - begin);
}

// The plane staged by a lane; zero where none is needed.
vec3 plane_by(uint lane) {
    if (WITH_SURFACE == 0 && SURFEL == 0) return vec3(0.0);
    return staged_plane_by(lane);
}

// Two splats per iteration, to halve the iterations that a software device counts; an odd one is paired with a hidden
// splat.
void blend_list(Tile t, uint begin, uint end) {
    do {
        uint count = stage_batch(begin, end);
        uint i = 0;
        do {
            blend(t, begin + i, staged_by(i), plane_by(i));
            blend(t, begin + i + 1, staged_by(i + 1), plane_by(i + 1));
            i += 2;
        } while (i < count);
        begin += WORKGROUP;
        if (!any_open()) break;
    } while (begin < end);
}

void begin_pixels(Tile t) {
    if (WITH_SURFACE != 0) lens = vec4(view.focal, view.center);
    [[unroll]] for (uint q = 0; q < QUADS; ++q) {
        transmittance[q] = mix(vec4(0.0), vec4(1.0), inside(t, q, view));
        red[q] = green[q] = blue[q] = far[q] = vec4(0.0);
        last[q] = uvec4(0);
        plane_depth[q] = median[q] = normal_x[q] = normal_y[q] = normal_z[q] = vec4(0.0);
        interquartile[q] = vec4(0.0);
        first[q] = log_sum[q] = log_square[q] = vec4(0.0);
    }
}

void load_surface(uint q, uint r, uint pixel, uint pixels) {
    plane_depth[q][r] = surface[SURFACE_DEPTH * pixels + pixel];
    median[q][r] = surface[SURFACE_MEDIAN * pixels + pixel];
    normal_x[q][r] = surface[SURFACE_NORMAL * pixels + pixel];
    normal_y[q][r] = surface[(SURFACE_NORMAL + 1) * pixels + pixel];
    normal_z[q][r] = surface[(SURFACE_NORMAL + 2) * pixels + pixel];
    interquartile[q][r] = surface[SURFACE_INTERQUARTILE * pixels + pixel];
    if (WITH_SPREAD == 0) return;
    first[q][r] = surface[SURFACE_FIRST * pixels + pixel];
    log_sum[q][r] = surface[SURFACE_LOG * pixels + pixel];
    log_square[q][r] = surface[SURFACE_LOG_SQUARE * pixels + pixel];
}

void store_surface(uint q, uint r, uint pixel, uint pixels) {
    surface[SURFACE_DEPTH * pixels + pixel] = plane_depth[q][r];
    surface[SURFACE_MEDIAN * pixels + pixel] = median[q][r];
    surface[SURFACE_NORMAL * pixels + pixel] = normal_x[q][r];
    surface[(SURFACE_NORMAL + 1) * pixels + pixel] = normal_y[q][r];
    surface[(SURFACE_NORMAL + 2) * pixels + pixel] = normal_z[q][r];
    surface[SURFACE_INTERQUARTILE * pixels + pixel] = interquartile[q][r];
    if (WITH_SPREAD == 0) return;
    surface[SURFACE_FIRST * pixels + pixel] = first[q][r];
    surface[SURFACE_LOG * pixels + pixel] = log_sum[q][r];
    surface[SURFACE_LOG_SQUARE * pixels + pixel] = log_square[q][r];
}

// Loads the pixels as the previous band stored them.
void load_pixels(Tile t) {
    uint pixels = view.size.x * view.size.y;
    [[unroll]] for (uint q = 0; q < QUADS; ++q) {
        [[unroll]] for (uint r = 0; r < 4; ++r) {
            if (!inside(t, q, view)[r]) continue;
            uint pixel = pixel_of(t, q * 4 + r, view);
            red[q][r] = image[pixel];
            green[q][r] = image[pixels + pixel];
            blue[q][r] = image[2 * pixels + pixel];
            transmittance[q][r] = image[3 * pixels + pixel];
            if (WITH_DEPTH != 0) far[q][r] = depth[pixel];
            if (WITH_SURFACE != 0) load_surface(q, r, pixel, pixels);
        }
    }
}

// Adds the background after the last band only.
void store_pixels(Tile t) {
    uint pixels = view.size.x * view.size.y;
    bool more = push.band + 1 < push.band_count && counts[COUNT_BAND_END] < counts[COUNT_VISIBLE];
    vec3 background = more ? vec3(0.0) : view.background;
    [[unroll]] for (uint q = 0; q < QUADS; ++q) {
        [[unroll]] for (uint r = 0; r < 4; ++r) {
            if (!inside(t, q, view)[r]) continue;
            uint pixel = pixel_of(t, q * 4 + r, view);
            float through = transmittance[q][r];
            image[pixel] = red[q][r] + through * background.r;
            image[pixels + pixel] = green[q][r] + through * background.g;
            image[2 * pixels + pixel] = blue[q][r] + through * background.b;
            image[3 * pixels + pixel] = through;
            if (WITH_ENDS != 0) isect_end_from_pixel[pixel] = last[q][r];
            if (WITH_IDS != 0) store_id(pixel, last[q][r]);
            if (WITH_DEPTH != 0) depth[pixel] = far[q][r];
            if (WITH_SURFACE != 0) store_surface(q, r, pixel, pixels);
        }
    }
}

void load_limits(Tile t) {
    [[unroll]] for (uint q = 0; q < QUADS; ++q) {
        limit[q] = vec4(0.0);
        [[unroll]] for (uint r = 0; r < 4; ++r) {
            if (inside(t, q, view)[r]) limit[q][r] = limit_from_pixel[pixel_of(t, q * 4 + r, view)];
        }
    }
}

void composite(uint tile) {
    Tile t = tile_of(tile, view);
    begin_pixels(t);
    if (WITH_LIMIT != 0) load_limits(t);
    if (push.band != 0) load_pixels(t);
    uvec2 range = range_from_tile[tile];
    if (range.x < range.y) blend_list(t, range.x, range.y);
    store_pixels(t);
}

void main() {
    uint tile_count = view.tiles.x * view.tiles.y;
    uint group = group_index();
    if (group >= tile_count) return;
    composite((group * push.tile_stride) % tile_count);
}
