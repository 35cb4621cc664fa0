// Gradient of compositing, one tile; included by `rasterize_backward.comp` and its variants, which define the lanes'
// sums.
//
// Each lane walks its tile's list from back to front. The colour behind a splat is kept per pixel as one number, its
// projection on the pixel's upstream gradient, so that no division by 1 - alpha enters a gradient. The transmittance in
// front is recovered by dividing the forward product by its own factors, which is exact up to rounding; recovering it
// from 1 - alpha would not be.
//
// Each lane fetches one splat of a batch and shares it; in the end it holds, and stores, the record of that splat.
//
// If splats were composited in bands, a dispatch removes one band, the farthest first. It stores the transmittance in
// front of the band and the colour behind it in the image, and the next continues with exactly the values of the lane's
// registers: bands change no bit of a record.

layout(constant_id = 0) const uint WORKGROUP = 8;
layout(local_size_x_id = 0) in;

#include "shared/rasterize_backward_io.glsl"
#include "shared/tile.glsl"
#include "shared/math.glsl"
#include "shared/primitive.glsl"
#include "shared/plane.glsl"
#include "shared/surfel.glsl"
#include "shared/surfel_column.glsl"
#include "shared/plane_moments.glsl"
#include "shared/stage.glsl"
#include "shared/record.glsl"


uint max_of_lanes(uint mine);
// The workgroup's sum of `even` in the lanes with even `stage_lane`, that of `odd` in the others.
Sums sum_of_lanes(Sums even, Sums odd);
SurfelSums surfel_sum_of_lanes(SurfelSums even, SurfelSums odd);
vec4 surface_sum_of_lanes(vec4 even, vec4 odd);

// Of the lane's pixels: transmittance in front of the current splat, upstream gradient, and colour behind the splat
// projected on that gradient.
vec4 transmittance[QUADS];
vec4 d_red[QUADS];
vec4 d_green[QUADS];
vec4 d_blue[QUADS];
vec4 behind[QUADS];
// One past the last intersection that counted for a pixel.
uvec4 end[QUADS];
// Upstream gradient of the surface.
SurfaceGradient d_surface[QUADS];
// Focal length and principal point.
vec4 lens;

SurfaceGradient load_surface(Tile t, uint q) {
    SurfaceGradient d = SurfaceGradient(vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0), vec4(1.0),
                                        vec4(0.0));
    uint pixels = view.size.x * view.size.y;
    [[unroll]] for (uint r = 0; r < 4; ++r) {
        if (!inside(t, q, view)[r]) continue;
        uint pixel = pixel_of(t, q * 4 + r, view);
        d.coverage[r] = d_image[D_COVERAGE * pixels + pixel];
        d.depth[r] = d_image[D_DEPTH * pixels + pixel];
        d.normal_x[r] = d_image[D_NORMAL * pixels + pixel];
        d.normal_y[r] = d_image[(D_NORMAL + 1) * pixels + pixel];
        d.normal_z[r] = d_image[(D_NORMAL + 2) * pixels + pixel];
        if (WITH_SPREAD == 0) continue;
        d.spread[r] = d_image[D_SPREAD * pixels + pixel];
        d.center[r] = d_image[SPREAD_CENTER * pixels + pixel];
        d.variance[r] = d_image[SPREAD_OWN * pixels + pixel];
    }
    return d;
}

// Fetches the lane's pixels; returns the last `end` among them.
uint load_pixels(Tile t) {
    uint pixels = view.size.x * view.size.y;
    vec3 background = view.background;
    uint last = 0;
    [[unroll]] for (uint q = 0; q < QUADS; ++q) {
        [[unroll]] for (uint r = 0; r < 4; ++r) {
            bool mine = inside(t, q, view)[r];
            uint pixel = mine ? pixel_of(t, q * 4 + r, view) : 0;
            d_red[q][r] = mine ? d_image[pixel] : 0.0;
            d_green[q][r] = mine ? d_image[pixels + pixel] : 0.0;
            d_blue[q][r] = mine ? d_image[2 * pixels + pixel] : 0.0;
            transmittance[q][r] = mine ? image[3 * pixels + pixel] : 0.0;
            end[q][r] = mine ? isect_end_from_pixel[pixel] : 0;
            last = max(last, end[q][r]);
        }
        if (WITH_SURFACE != 0) d_surface[q] = load_surface(t, q);
        behind[q] = d_red[q] * background.r + d_green[q] * background.g + d_blue[q] * background.b;
        if (push.band < 2) continue;
        [[unroll]] for (uint r = 0; r < 4; ++r) {
            if (inside(t, q, view)[r]) behind[q][r] = image[pixel_of(t, q * 4 + r, view)];
        }
    }
    return last;
}

// Stores the pixels for the next band: the projected colour behind replaces red, no longer needed after the loss.
void store_pixels(Tile t) {
    uint pixels = view.size.x * view.size.y;
    [[unroll]] for (uint q = 0; q < QUADS; ++q) {
        [[unroll]] for (uint r = 0; r < 4; ++r) {
            if (!inside(t, q, view)[r]) continue;
            uint pixel = pixel_of(t, q * 4 + r, view);
            image[pixel] = behind[q][r];
            image[3 * pixels + pixel] = transmittance[q][r];
        }
    }
}

// A splat along the lane's pixels.
struct Walked {
    Column column;
    vec3 color;
    SurfelColumn surfel;
    PlaneColumn plane;
    vec3 normal;
};

// Removes one splat from the lane's pixels, from the back, and returns its contribution to the gradient; `more` is that
// of its tilt and its spot, `by_surface` that of its depth and normal.
Sums take_off(uint isect, Walked splat, out SurfelSums more, out vec4 by_surface) {
    Column column = splat.column;
    vec3 color = splat.color;
    SurfelColumn surfel = splat.surfel;
    Moments moments = Moments(vec4(0.0), vec4(0.0), vec4(0.0));
    vec4 red = vec4(0.0);
    vec4 green = vec4(0.0);
    vec4 blue = vec4(0.0);
    SurfelMoments tilted = SurfelMoments(vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0));
    PlaneMoments flat_moments = PlaneMoments(vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0));
    Hits hits;
    [[unroll]] for (uint q = 0; q < QUADS; ++q) {
        vec4 f;
        vec4 exponent = exponent_of(column, q, f);
        if (SURFEL != 0) exponent = surfel_exponent(column, surfel, q, f, hits);
        bvec4 on = both(greaterThanEqual(exponent, vec4(LOG2_ALPHA_MIN)), lessThan(uvec4(isect), end[q]));
        vec4 raw = exp2(exponent);
        vec4 alpha = mix(vec4(0.0), min(raw, vec4(ALPHA_MAX)), on);
        transmittance[q] /= vec4(1.0) - alpha;
        vec4 weight = alpha * transmittance[q];
        vec4 ahead = d_red[q] * color.r + d_green[q] * color.g + d_blue[q] * color.b;
        if (WITH_SURFACE != 0) {
            PlaneDepths at = SURFEL != 0 ? plane_depths(splat.plane, hits, view.near_plane)
                                         : plane_depths(splat.plane, q);
            vec4 by_depth;
            ahead += ahead_of(d_surface[q], at.depth, splat.normal, WITH_SPREAD != 0, by_depth);
            add_plane_moments(flat_moments, splat.plane, q, weight, weight * by_depth, at, d_surface[q]);
        }
        // No gradient where alpha is capped.
        vec4 here = mix(vec4(0.0), weight * (ahead - behind[q]), lessThan(raw, vec4(ALPHA_MAX)));
        behind[q] = mix(behind[q], ahead, alpha);
        red += weight * d_red[q];
        green += weight * d_green[q];
        blue += weight * d_blue[q];
        if (SURFEL != 0) add_surfel_moments(moments, tilted, surfel, q, here, f, hits);
        else add_moments(moments, here, f);
    }
    const vec4 one = vec4(1.0);
    Sums sums = sums_of(moments, column);
    if (SURFEL != 0) {
        sums.shape.x = dot(tilted.s, one);
        more = surfel_sums_of(tilted, surfel);
    }
    if (WITH_SURFACE != 0) {
        vec3 tilt = tilt_of(flat_moments, splat.plane);
        if (SURFEL != 0) more.tilt += tilt;
        else more = SurfelSums(tilt, vec2(0.0));
        by_surface = surface_of(flat_moments);
    }
    sums.tone = vec4(sums.tone.xy, dot(red, one), dot(green, one));
    sums.rest = dot(blue, one);
    return sums;
}

Sums take_off_staged(Tile t, uint isect, uint lane, out SurfelSums more, out vec4 by_surface) {
    Staged splat = staged_by(lane);
    Walked walked;
    vec3 plane;
    if (TILTED) plane = staged_plane_by(lane);
    vec2 whiten = splat.tone.xy;
    if (SURFEL != 0) walked.surfel = surfel_column_of(t, splat.shape, whiten, plane, depth_of(splat.rest), view);
    if (WITH_SURFACE != 0) {
        vec3 drawn = SURFEL != 0 ? drawn_plane(splat.shape, whiten, plane) : plane;
        walked.plane = plane_column_of(t, drawn, splat.shape.xy, depth_of(splat.rest));
        walked.normal = normal_of(plane, splat.shape.xy, lens);
    }
    walked.column = column_of(t, splat.shape, splat.tone);
    walked.color = vec3(splat.tone.zw, splat.rest.x);
    return take_off(isect, walked, more, by_surface);
}

Sums either(Sums a, Sums b, bool second) {
    bvec4 four = bvec4(second);
    return Sums(mix(a.shape, b.shape, four), mix(a.tone, b.tone, four), second ? b.rest : a.rest);
}

SurfelSums surfel_either(SurfelSums a, SurfelSums b, bool second) {
    return SurfelSums(mix(a.tilt, b.tilt, bvec3(second)), mix(a.spot, b.spot, bvec2(second)));
}

void store(uint source, Sums sums, SurfelSums more, vec4 by_surface) {
    d_shape_from_source[source] = sums.shape;
    d_tone_from_source[source] = sums.tone;
    uint rest = source * REST_WIDTH;
    d_rest_from_source[rest++] = sums.rest;
    if (TILTED) {
        [[unroll]] for (uint i = 0; i < REST_TILT; ++i) d_rest_from_source[rest++] = more.tilt[i];
    }
    if (SURFEL == SURFEL_ANY) {
        [[unroll]] for (uint i = 0; i < REST_SPOT; ++i) d_rest_from_source[rest++] = more.spot[i];
    }
    if (WITH_SURFACE != 0) {
        [[unroll]] for (uint i = 0; i < REST_SURFACE; ++i) d_rest_from_source[rest++] = by_surface[i];
    }
}

// Removes a batch, the last before `end` first; returns its number of splats.
uint take_off_batch(Tile t, uint begin, uint end) {
    uint lane = stage_lane();
    bool mine = lane < end - begin;
    uint source = emitted_from_isect[mine ? end - 1 - lane : begin];
    uint splat = splat_from_emitted[source];
    Staged staged = Staged(ellipse_from_splat[splat], whiten_rg_from_splat[splat], blue_depth_from_splat[splat]);
    if (!mine) hide(staged);
    stage(staged);
    if (TILTED) stage_plane(plane_from_splat[splat]);
    uint count = min(WORKGROUP, end - begin);
    Sums kept = Sums(vec4(0.0), vec4(0.0), 0.0);
    SurfelSums more_kept = SurfelSums(vec3(0.0), vec2(0.0));
    vec4 surface_kept = vec4(0.0);
    uint i = 0;
    // Two at a time: their sums over the lanes share the first step. An odd one is paired with a hidden splat.
    do {
        SurfelSums more_even, more_odd;
        vec4 surface_even, surface_odd;
        Sums even = take_off_staged(t, end - 1 - i, i, more_even, surface_even);
        Sums odd = take_off_staged(t, end - 2 - i, i + 1, more_odd, surface_odd);
        bool mine_now = lane / 2 == i / 2;
        kept = either(kept, sum_of_lanes(even, odd), mine_now);
        if (TILTED) more_kept = surfel_either(more_kept, surfel_sum_of_lanes(more_even, more_odd), mine_now);
        if (WITH_SURFACE != 0) {
            vec4 total = surface_sum_of_lanes(surface_even, surface_odd);
            surface_kept = mix(surface_kept, total, bvec4(mine_now));
        }
        i += 2;
    } while (i < count);
    if (mine) store(source, kept, more_kept, surface_kept);
    return count;
}

void differentiate(uint tile) {
    Tile t = tile_of(tile, view);
    if (WITH_SURFACE != 0) lens = vec4(view.focal, view.center);
    uvec2 range = range_from_tile[tile];
    // The ends of a tile without splats in this band are those of another band.
    uint last = max(min(max_of_lanes(load_pixels(t)), range.y), range.x);
    uint end = last;
    // Tested at the end: some software devices run a body once more, without active lanes, to find that a loop is over.
    if (end > range.x) {
        do {
            end -= take_off_batch(t, range.x, end);
        } while (end > range.x);
    }
    // Records of splats behind the last one that counted, which nothing else clears.
    for (uint isect = last + gl_LocalInvocationID.x; isect < range.y; isect += WORKGROUP) {
        SurfelSums nothing = SurfelSums(vec3(0.0), vec2(0.0));
        store(emitted_from_isect[isect], Sums(vec4(0.0), vec4(0.0), 0.0), nothing, vec4(0.0));
    }
    if (push.band != 0) store_pixels(t);
}

void main() {
    uint tile_count = view.tiles.x * view.tiles.y;
    uint group = group_index();
    if (group >= tile_count) return;
    differentiate((group * push.tile_stride) % tile_count);
}
