#version 460
#extension GL_KHR_shader_subgroup_ballot : require
#extension GL_KHR_shader_subgroup_vote : require
#include "shared/prelude.glsl"

// Composites the sorted splats of every tile into an image, front to back.
//
// One workgroup per tile. Each subgroup composites a block of rows by itself: it passes over splats that miss the
// block, and ends with its own pixels. Not for surfaces and surfels.

layout(constant_id = 0) const uint WORKGROUP = 8;
layout(local_size_x_id = 0) in;

#include "shared/rasterize_io.glsl"
#include "shared/math.glsl"
#include "shared/primitive.glsl"
#include "shared/blocks.glsl"

// The lane's pixels: transmittance, colour and depth so far, and one past the last intersection of the band that
// counted.
float transmittance[LANE_PIXELS];
vec3 color[LANE_PIXELS];
float far[LANE_PIXELS];
uint last[LANE_PIXELS];
float limit[LANE_PIXELS];
// Slot of the last splat of the batch that counted.
uint last_slot[LANE_PIXELS];

const uint NO_SLOT = 0xffffffffu;

void blend(Tile t, uint slot) {
    vec4 tone = staged_tone[slot];
    vec2 rest = staged_rest[slot];
    Column column = staged_column(t, slot, tone);
    [[unroll]] for (uint k = 0; k < LANE_PIXELS; ++k) {
        float f;
        float exponent = exponent_in_row(column, k, f);
        bool on = exponent >= LOG2_ALPHA_MIN && transmittance[k] >= T_MIN;
        if (WITH_LIMIT != 0) on = on && depth_of(rest) < limit[k];
        float alpha = on ? min(exp2(exponent), ALPHA_MAX) : 0.0;
        float weight = alpha * transmittance[k];
        color[k] += weight * vec3(tone.zw, rest.x);
        if (WITH_DEPTH != 0) far[k] += weight * depth_of(rest);
        float through = transmittance[k] * (1.0 - alpha);
        if (WITH_IDS != 0 && transmittance[k] > 0.5 && through <= 0.5) last_slot[k] = slot;
        if (WITH_ENDS != 0 && on) last_slot[k] = slot;
        transmittance[k] = through;
    }
}

// Emitted index of an intersection before `end`.
uint emitted_by(uint isect, uint end) {
    return emitted_from_isect[min(isect, end - 1)];
}

// Blends the staged splats of the batch from `begin` on.
void blend_batch(Tile t, uint begin, uint count) {
    [[unroll]] for (uint k = 0; k < LANE_PIXELS; ++k) last_slot[k] = NO_SLOT;
    uint slot = first_slot();
    uint end = slot + count;
    // Two splats per iteration; an odd one is paired with a hidden one.
    do {
        blend(t, slot);
        blend(t, slot + 1);
        slot += 2;
    } while (slot < end);
    [[unroll]] for (uint k = 0; k < LANE_PIXELS; ++k) {
        if (last_slot[k] != NO_SLOT) last[k] = begin + staged_place[last_slot[k]] + 1;
    }
}

// True if any pixel of the block is still open.
bool any_open() {
    bool open = false;
    [[unroll]] for (uint k = 0; k < LANE_PIXELS; ++k) open = open || transmittance[k] >= T_MIN;
    return subgroupAny(open);
}

void blend_list(Tile t, uint begin, uint end) {
    const uint size = gl_SubgroupSize;
    uint isect = begin + gl_SubgroupInvocationID;
    // Each load is issued a batch before its result is needed: by the batch's splats, and by two levels of indices.
    ScreenSplat splat = fetch(splat_from_emitted[emitted_by(isect, end)]);
    uint next = splat_from_emitted[emitted_by(isect + size, end)];
    uint emitted = emitted_by(isect + 2 * size, end);
    do {
        uint count = stage(t, splat, isect < end && reaches_block(t, splat));
        splat = fetch(next);
        next = splat_from_emitted[emitted];
        emitted = emitted_by(isect + 3 * size, end);
        if (count != 0) blend_batch(t, begin, count);
        begin += size;
        isect += size;
        if (!any_open()) break;
    } while (begin < end);
}

// Loads a pixel as the previous band stored it.
void load_pixel(uint k, uint pixel) {
    uint pixels = view.size.x * view.size.y;
    color[k] = vec3(image[pixel], image[pixels + pixel], image[2 * pixels + pixel]);
    transmittance[k] = image[3 * pixels + pixel];
    if (WITH_DEPTH != 0) far[k] = depth[pixel];
}

void begin_pixels(Tile t) {
    [[unroll]] for (uint k = 0; k < LANE_PIXELS; ++k) {
        transmittance[k] = inside(t, k, view) ? 1.0 : 0.0;
        color[k] = vec3(0.0);
        far[k] = limit[k] = 0.0;
        last[k] = 0;
        if (!inside(t, k, view)) continue;
        if (WITH_LIMIT != 0) limit[k] = limit_from_pixel[pixel_of(t, k, view)];
        if (push.band != 0) load_pixel(k, pixel_of(t, k, view));
    }
}

// Adds the background after the last band only.
void store_pixel(uint k, uint pixel) {
    uint pixels = view.size.x * view.size.y;
    bool more = push.band + 1 < push.band_count && counts[COUNT_BAND_END] < counts[COUNT_VISIBLE];
    vec3 shown = color[k] + (more ? vec3(0.0) : transmittance[k] * view.background);
    image[pixel] = shown.r;
    image[pixels + pixel] = shown.g;
    image[2 * pixels + pixel] = shown.b;
    image[3 * pixels + pixel] = transmittance[k];
    if (WITH_ENDS != 0) isect_end_from_pixel[pixel] = last[k];
    if (WITH_IDS != 0) store_id(pixel, last[k]);
    if (WITH_DEPTH != 0) depth[pixel] = far[k];
}

void main() {
    uint tile_count = view.tiles.x * view.tiles.y;
    uint group = group_index();
    if (group >= tile_count) return;
    uint tile = (group * push.tile_stride) % tile_count;
    Tile t = tile_of(tile, view);
    begin_pixels(t);
    uvec2 range = range_from_tile[tile];
    if (range.x < range.y) blend_list(t, range.x, range.y);
    [[unroll]] for (uint k = 0; k < LANE_PIXELS; ++k) {
        if (inside(t, k, view)) store_pixel(k, pixel_of(t, k, view));
    }
}
