// Blocks: the lanes of each subgroup of a workgroup have some of the tile's rows. They fetch a splat each, and share
// those that reach the block, in the order of the list. For subgroups of 8 lanes or more, all of them full.

#include "shared/tile_lane.glsl"

// Batch of splats in shared memory: each subgroup has as many slots as lanes, from `first_slot`. Means are relative to
// the tile's corner.
shared vec4 staged_shape[WORKGROUP];
shared vec4 staged_tone[WORKGROUP];
shared vec2 staged_rest[WORKGROUP];
// The splat's place in the batch.
shared uint staged_place[WORKGROUP];

// First slot of the subgroup.
uint first_slot() {
    return gl_SubgroupID * gl_SubgroupSize;
}

// The tile, with the pixels of this lane, which lie below each other.
Tile tile_of(uint tile, View view) {
    return tile_of_lane(tile, first_slot() + gl_SubgroupInvocationID, view);
}

// True if pixel `k` of the lane is among the drawn rows.
bool inside(Tile t, uint k, View view) {
    return t.corner.x + t.x < view.size.x && t.corner.y + t.y + k < view.first_row + view.size.y;
}

// A splat in a lane's registers.
struct ScreenSplat {
    vec4 shape;
    vec4 tone;
    vec2 rest;
};

ScreenSplat fetch(uint splat) {
    return ScreenSplat(ellipse_from_splat[splat], whiten_rg_from_splat[splat], blue_depth_from_splat[splat]);
}

// True if a splat's alpha may reach the threshold in the subgroup's block.
bool reaches_block(Tile t, ScreenSplat splat) {
    uint begin = first_slot();
    uint last = begin + gl_SubgroupSize - 1;
    vec2 low = vec2(t.corner + uvec2(0, begin / TILE_WIDTH * LANE_PIXELS)) + 0.5;
    vec2 high = vec2(t.corner + uvec2(TILE_WIDTH - 1, last / TILE_WIDTH * LANE_PIXELS + LANE_PIXELS - 1)) + 0.5;
    Ellipse e = ellipse(splat.shape, splat.tone.xy, LOG2_ALPHA_MIN);
    vec2 strip = strip_of(e, low.y, high.y);
    vec2 sides = sides_in(e, strip);
    return strip.x <= strip.y && sides.x <= high.x && sides.y >= low.x;
}

// Shares the splats of the lanes with `mine`; returns their number. The slots behind them are hidden, for loops by
// several.
uint stage(Tile t, ScreenSplat splat, bool mine) {
    // The previous batch may still be read.
    subgroupBarrier();
    uint lane = gl_SubgroupInvocationID;
    uvec4 ballot = subgroupBallot(mine);
    uint count = subgroupBallotBitCount(ballot);
    uint before = subgroupBallotExclusiveBitCount(ballot);
    uint slot = first_slot() + (mine ? before : count + lane - before);
    precise vec2 mean = splat.shape.xy - vec2(t.corner);
    staged_shape[slot] = mine ? vec4(mean, splat.shape.zw) : vec4(0.0, 0.0, 0.0, -1e30);
    staged_tone[slot] = mine ? splat.tone : vec4(0.0);
    staged_rest[slot] = mine ? splat.rest : vec2(0.0);
    staged_place[slot] = lane;
    subgroupMemoryBarrierShared();
    subgroupBarrier();
    return count;
}

// A staged splat along the column of a lane.
Column staged_column(Tile t, uint slot, vec4 tone) {
    return column_of(Tile(uvec2(0), t.x, t.y), staged_shape[slot], tone);
}
