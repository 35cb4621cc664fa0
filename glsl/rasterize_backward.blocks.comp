#version 460
#extension GL_KHR_shader_subgroup_arithmetic : require
#extension GL_KHR_shader_subgroup_ballot : require
#extension GL_KHR_shader_subgroup_shuffle : require
#include "shared/prelude.glsl"

// Gradient of every (tile, splat) pair from the gradient of the image.
//
// One workgroup per tile. Each subgroup has a block of rows, and passes over splats that miss it. For some splats at a
// time, lanes first leave each pixel's weight and gradient by the exponent in shared memory; then each lane sums those
// of one splat over some of the block's rows, so that few sums cross lanes. The blocks' sums are added in a fixed
// order, to one record per pair, without atomics. Not for surfaces and surfels.

layout(constant_id = 0) const uint WORKGROUP = 8;
layout(local_size_x_id = 0) in;

#include "shared/rasterize_backward_io.glsl"
#include "shared/math.glsl"
#include "shared/primitive.glsl"
#include "shared/blocks.glsl"
#include "shared/record.glsl"
#include "shared/across.glsl"

// Splats that are taken off between two sums.
const uint GROUP = 8;
// Most subgroups of a workgroup, of 8 lanes each.
const uint BLOCKS_MAX = WORKGROUP / TILE_WIDTH;

// Of each block, splat of a group, and pixel, those of all lanes in turn: weight, and gradient by the exponent. A
// splat's pixels are padded by one, so that lanes with different splats do not wait for the same memory.
shared vec2 weight_slope[(TILE_PIXELS + BLOCKS_MAX) * GROUP];
// Upstream gradient of each pixel, likewise.
shared vec4 d_color[TILE_PIXELS];
// Of each block, by the splat's place in the batch.
shared vec4 block_shape[WORKGROUP];
shared vec4 block_tone[WORKGROUP];
shared float block_rest[WORKGROUP];
shared uint block_last[BLOCKS_MAX];

// Of the lane's pixels: transmittance in front of the current splat, upstream gradient, colour behind the splat
// projected on that gradient, and one past the last intersection that counted.
float transmittance[LANE_PIXELS];
vec3 d_pixel[LANE_PIXELS];
float behind[LANE_PIXELS];
uint pixel_end[LANE_PIXELS];

// Fetches the lane's pixels; returns the last end among them.
uint load_pixels(Tile t) {
    uint pixels = view.size.x * view.size.y;
    uint last = 0;
    [[unroll]] for (uint k = 0; k < LANE_PIXELS; ++k) {
        bool mine = inside(t, k, view);
        uint pixel = mine ? pixel_of(t, k, view) : 0;
        d_pixel[k] = mine ? vec3(d_image[pixel], d_image[pixels + pixel], d_image[2 * pixels + pixel]) : vec3(0.0);
        transmittance[k] = mine ? image[3 * pixels + pixel] : 0.0;
        pixel_end[k] = mine ? isect_end_from_pixel[pixel] : 0;
        behind[k] = push.band < 2 || !mine ? dot(d_pixel[k], view.background) : image[pixel];
        d_color[first_slot() * LANE_PIXELS + k * gl_SubgroupSize + gl_SubgroupInvocationID] = vec4(d_pixel[k], 0.0);
        last = max(last, pixel_end[k]);
    }
    return last;
}

// Stores the pixels for the next band: the projected colour behind replaces red, no longer needed after the loss.
void store_pixels(Tile t) {
    [[unroll]] for (uint k = 0; k < LANE_PIXELS; ++k) {
        if (!inside(t, k, view)) continue;
        uint pixel = pixel_of(t, k, view);
        image[pixel] = behind[k];
        image[3 * view.size.x * view.size.y + pixel] = transmittance[k];
    }
}

// First element of a splat of the current group in `weight_slope`.
uint row_of(uint splat) {
    return (gl_SubgroupID * GROUP + splat) * (gl_SubgroupSize * LANE_PIXELS + 1);
}

// Removes the splat in a slot, of the batch before `end`, from the pixels, and leaves its weights and slopes.
void take_off(Tile t, uint end, uint slot, uint row) {
    vec4 tone = staged_tone[slot];
    float blue = staged_rest[slot].x;
    uint isect = end - 1 - staged_place[slot];
    Column column = staged_column(t, slot, tone);
    [[unroll]] for (uint k = 0; k < LANE_PIXELS; ++k) {
        float f;
        float exponent = exponent_in_row(column, k, f);
        bool on = exponent >= LOG2_ALPHA_MIN && isect < pixel_end[k];
        float raw = exp2(exponent);
        float alpha = on ? min(raw, ALPHA_MAX) : 0.0;
        transmittance[k] /= 1.0 - alpha;
        float weight = alpha * transmittance[k];
        float ahead = d_pixel[k].r * tone.z + d_pixel[k].g * tone.w + d_pixel[k].b * blue;
        // No gradient where alpha is capped.
        float here = raw < ALPHA_MAX ? weight * (ahead - behind[k]) : 0.0;
        behind[k] = mix(behind[k], ahead, alpha);
        weight_slope[row + k * gl_SubgroupSize + gl_SubgroupInvocationID] = vec2(weight, here);
    }
}

// Moments of slopes along a row of the tile, from its middle, and weighted gradient.
struct RowSums {
    vec3 moments;
    vec3 color;
};

// Sums over a row, of the lanes from `lane` on, each with its pixel `k`.
RowSums sum_row(uint row, uint lane, uint k) {
    RowSums sums = RowSums(vec3(0.0), vec3(0.0));
    uint at = k * gl_SubgroupSize + lane;
    [[unroll]] for (uint i = 0; i < TILE_WIDTH; ++i) {
        vec2 both = weight_slope[row + at + i];
        float x = float(i) - 0.5 * float(TILE_WIDTH - 1);
        float first = both.y * x;
        sums.moments += vec3(both.y, first, first * x);
        sums.color += both.x * d_color[first_slot() * LANE_PIXELS + at + i].rgb;
    }
    return sums;
}

// Sum of the splat in a slot over the rows of the lanes from `lane` on. Residuals are linear along a row; with a
// dilation of 0.1 px^2 or more, they change by 2.7 a pixel at most, and sums by moments round 20 times as much.
Sums sum_rows(uint slot, uint row, uint lane) {
    vec4 shape = staged_shape[slot];
    vec2 whiten = staged_tone[slot].xy;
    float dx = 0.5 * float(TILE_WIDTH) - shape.x;
    vec2 step = vec2(whiten.x, -shape.z * whiten.y);
    Sums sum = Sums(vec4(0.0), vec4(0.0), 0.0);
    [[unroll]] for (uint k = 0; k < LANE_PIXELS; ++k) {
        float y = float((first_slot() + lane) / TILE_WIDTH * LANE_PIXELS + k) + 0.5;
        vec2 f = vec2(dx * whiten.x, (y - (shape.y + shape.z * dx)) * whiten.y);
        RowSums sums = sum_row(row, lane, k);
        vec3 m = sums.moments;
        // Sums of s f, and of s x f.
        vec2 s_f = f * m.x + step * m.y;
        vec2 s_xf = f * m.y + step * m.z;
        sum.shape += vec4(m.x, s_f, f.x * s_f.x + step.x * s_xf.x);
        sum.tone += vec4(f.y * s_f.x + step.y * s_xf.x, f.y * s_f.y + step.y * s_xf.y, sums.color.rg);
        sum.rest += sums.color.b;
    }
    return sum;
}

void add_across(inout Sums sum, uint mask) {
    sum.shape += from_across(sum.shape, mask);
    sum.tone += from_across(sum.tone, mask);
    sum.rest += subgroupShuffleXor(sum.rest, mask);
}

// Removes the staged splats from `slot` on, and keeps the block's sums of those before `end_slot`.
void take_off_group(Tile t, uint end, uint slot, uint end_slot) {
    [[unroll]] for (uint i = 0; i < GROUP; ++i) take_off(t, end, slot + i, row_of(i));
    subgroupMemoryBarrierShared();
    subgroupBarrier();
    uint splat = gl_SubgroupInvocationID % GROUP;
    uint lane = gl_SubgroupInvocationID / GROUP * GROUP;
    Sums sum = sum_rows(slot + splat, row_of(splat), lane);
    if (gl_SubgroupSize > 8) add_across(sum, 8);
    if (gl_SubgroupSize > 16) add_across(sum, 16);
    if (gl_SubgroupSize > 32) add_across(sum, 32);
    if (gl_SubgroupSize > 64) add_across(sum, 64);
    if (lane == 0 && slot + splat < end_slot) {
        uint place = first_slot() + staged_place[slot + splat];
        block_shape[place] = sum.shape;
        block_tone[place] = sum.tone;
        block_rest[place] = sum.rest;
    }
    subgroupBarrier();
}

// Emitted index of the lane's intersection in a batch, with so many between that batch and `end`.
uint emitted_by(uint begin, uint end, uint between) {
    return emitted_from_isect[end - min(end - begin, between + gl_SubgroupInvocationID + 1)];
}

// Removes a batch of `count` splats, the last before `end` first, from the block's pixels, as far as they reach it.
void take_off_batch(Tile t, uint end, uint count, uint block_end, ScreenSplat splat) {
    uint lane = gl_SubgroupInvocationID;
    bool mine = lane < count && end - 1 - lane < block_end && reaches_block(t, splat);
    if (!mine) {
        block_shape[first_slot() + lane] = block_tone[first_slot() + lane] = vec4(0.0);
        block_rest[first_slot() + lane] = 0.0;
    }
    uint end_slot = first_slot() + stage(t, splat, mine);
    for (uint slot = first_slot(); slot < end_slot; slot += GROUP) take_off_group(t, end, slot, end_slot);
}

// Adds up the blocks' sums of one splat of a batch, by its place there; stores one part of its record.
void store_part(uint source, uint place, uint part) {
    vec4 sum = vec4(0.0);
    // Unrolled, because iterations would count towards the limit that some devices have over all loops.
    [[unroll]] for (uint block = 0; block < BLOCKS_MAX; ++block) {
        if (block >= gl_NumSubgroups) continue;
        uint from = block * gl_SubgroupSize + place;
        if (part == 0) sum += block_shape[from];
        else if (part == 1) sum += block_tone[from];
        else sum.x += block_rest[from];
    }
    if (part == 0) d_shape_from_source[source] = sum;
    else if (part == 1) d_tone_from_source[source] = sum;
    else d_rest_from_source[source * REST_WIDTH] = sum.x;
}

// Stores the records of a batch of `count` splats, the last before `end` first.
void store_batch(uint end, uint count) {
    barrier();
    uint place = gl_SubgroupInvocationID;
    [[unroll]] for (uint round = 0; round < 3; ++round) {
        uint part = gl_SubgroupID + round * gl_NumSubgroups;
        if (part < 3 && place < count) store_part(emitted_from_isect[end - 1 - place], place, part);
    }
    barrier();
}

// Largest value of the workgroup's subgroups.
uint max_of_blocks(uint mine) {
    block_last[gl_SubgroupID] = mine;
    barrier();
    uint most = 0;
    for (uint block = 0; block < gl_NumSubgroups; ++block) most = max(most, block_last[block]);
    return most;
}

// Clears the records of splats behind the last one that counted.
void clear_records(uint begin, uint end) {
    for (uint isect = begin + gl_LocalInvocationID.x; isect < end; isect += WORKGROUP) {
        uint source = emitted_from_isect[isect];
        d_shape_from_source[source] = d_tone_from_source[source] = vec4(0.0);
        d_rest_from_source[source * REST_WIDTH] = 0.0;
    }
}

void differentiate(uint tile) {
    Tile t = tile_of(tile, view);
    uint block_end = subgroupMax(load_pixels(t));
    uvec2 range = range_from_tile[tile];
    // The ends of a tile without splats in this band are those of another band.
    uint last = max(min(max_of_blocks(block_end), range.y), range.x);
    uint end = last;
    if (end > range.x) {
        const uint size = gl_SubgroupSize;
        // Each load is issued a batch before its result is needed: by the batch's splats, and by two levels of indices.
        ScreenSplat next_splat = fetch(splat_from_emitted[emitted_by(range.x, end, 0)]);
        uint next = splat_from_emitted[emitted_by(range.x, end, size)];
        uint emitted = emitted_by(range.x, end, 2 * size);
        do {
            uint count = min(size, end - range.x);
            ScreenSplat splat = next_splat;
            next_splat = fetch(next);
            next = splat_from_emitted[emitted];
            emitted = emitted_by(range.x, end, 3 * size);
            take_off_batch(t, end, count, block_end, splat);
            store_batch(end, count);
            end -= count;
        } while (end > range.x);
    }
    clear_records(last, range.y);
    if (push.band != 0) store_pixels(t);
}

void main() {
    uint tile_count = view.tiles.x * view.tiles.y;
    uint group = group_index();
    if (group >= tile_count) return;
    differentiate((group * push.tile_stride) % tile_count);
}
