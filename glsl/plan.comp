#version 460
#include "shared/prelude.glsl"

// Turns a count that only the device knows into dispatch sizes, and notices what does not fit.
//
// One invocation. Stage 0 runs when the visible splats are counted, stage 1 when their intersections are: it thresholds
// off a band, as many splats in depth order as the buffers have room for. Bands are composited one over the
// other, so that a frame may want more intersections than there is room for. A frame that is not done with the last
// band recorded sets COUNT_FAILED, and one with a single band plans nothing then; while that stands every later
// frame plans nothing either, so that the host can grow the buffers and go on exactly where it left off. Stage 2
// plans a band again of which the host has put back where it begins and ends.

layout(local_size_x = 1) in;

layout(set = 0, binding = 0, scalar) buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) writeonly buffer Args { DispatchArgs args[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Offsets { uint isect_from_rank[]; };

layout(push_constant, scalar) uniform Push {
    uint stage;            // 0: visible splats, 1: the next band, 2: a band once more
    uint isect_capacity;   // intersections the buffers hold
    uint chunk;            // least keys of a chunk of the radix sort, where there are many
    uint chunks_per_group; // chunks one workgroup of the sort handles
    uint digit_count;      // entries of a digit table
    uint workgroup;        // invocations per workgroup of the elementwise and scan kernels
    uint group_limit;      // workgroups the device takes in one dimension
    uint tile_count;       // tiles of the image
    uint band;             // the band to plan
    uint band_count;       // bands that are recorded
    uint rank_limit;       // splats that a band may hold
} push;

// `count` workgroups, folded into two dimensions where one does not hold them.
void write_args(uint slot, uint count) {
    uint x = min(count, push.group_limit);
    args[slot].x = x;
    args[slot].y = x == 0 ? 0 : (count + x - 1) / x;
    args[slot].z = 1;
}

uint divide_up(uint a, uint b) {
    return a / b + (a % b != 0 ? 1 : 0);
}

// Chunks of a sort: whole workgroups, so that no lane is idle, and an even number of them, so that neither of a
// software device's two threads is.
uint chunks_of(uint count) {
    uint twice = 2 * push.chunks_per_group;
    return count == 0 ? 0 : twice * max(count / (twice * push.chunk), 1);
}

void plan_visible() {
    uint count = counts[COUNT_VISIBLE];
    if (counts[COUNT_FAILED] != 0) count = 0;
    uint chunks = chunks_of(count);
    counts[COUNT_VISIBLE] = count;
    counts[COUNT_VISIBLE_CHUNK] = chunks;
    counts[COUNT_VISIBLE_TABLE] = chunks * push.digit_count;
    write_args(ARGS_VISIBLE, divide_up(count, push.workgroup));
    write_args(ARGS_VISIBLE_CHUNK, divide_up(chunks, push.chunks_per_group));
    write_args(ARGS_VISIBLE_TABLE, divide_up(divide_up(chunks * push.digit_count, SCAN_CHUNK), push.workgroup));
    write_args(ARGS_VISIBLE_SCAN, divide_up(divide_up(count, SCAN_CHUNK), push.workgroup));
}

uint visible;

// Intersections of the splats before one.
uint isects_before(uint rank) {
    return rank < visible ? isect_from_rank[rank] : counts[COUNT_ISECT_WANTED];
}

// The end of the longest band from `begin` on that there is room for.
uint end_of_band(uint begin) {
    uint base = isects_before(begin);
    uint beyond = begin + min(visible - begin, push.rank_limit);
    if (isects_before(beyond) - base <= push.isect_capacity) return beyond;
    uint end = begin;
    while (beyond - end > 1) {
        uint middle = end + (beyond - end) / 2;
        if (isects_before(middle) - base <= push.isect_capacity) end = middle;
        else beyond = middle;
    }
    return end;
}

void plan_band(uint begin, uint end, bool drawn) {
    uint base = isects_before(begin);
    uint count = drawn ? isects_before(end) - base : 0;
    uint chunks = chunks_of(count);
    counts[COUNT_BAND_BEGIN] = begin;
    counts[COUNT_BAND_END] = end;
    counts[COUNT_BAND_BASE] = base;
    counts[COUNT_ISECT] = count;
    counts[COUNT_ISECT_CHUNK] = chunks;
    counts[COUNT_ISECT_TABLE] = chunks * push.digit_count;
    write_args(ARGS_EXPAND, count == 0 ? 0 : divide_up(end - begin, push.workgroup));
    write_args(ARGS_ISECT, divide_up(count, push.workgroup));
    write_args(ARGS_ISECT_CHUNK, divide_up(chunks, push.chunks_per_group));
    write_args(ARGS_ISECT_TABLE, divide_up(divide_up(chunks * push.digit_count, SCAN_CHUNK), push.workgroup));
    write_args(ARGS_TILE, begin < end ? push.tile_count : 0);
}

void plan_next() {
    bool failed = counts[COUNT_FAILED] != 0;
    if (push.band == 0 && !failed) counts[COUNT_ISECT_WANTED] = counts[COUNT_ISECT];
    uint begin = push.band == 0 ? 0 : counts[COUNT_BAND_END];
    uint end = visible;
    if (!failed) {
        // A total that has met the largest number stands for a larger one, and offsets have lost their meaning.
        bool countable = counts[COUNT_ISECT_WANTED] != ~0u;
        if (countable) end = end_of_band(begin);
        bool enough = countable && (end == visible || push.band + 1 < push.band_count);
        if (!enough) {
            counts[COUNT_FAILED] = 1;
            failed = !countable || push.band == 0;
        }
    }
    // Nothing is left to draw behind a failure.
    if (failed) end = visible;
    plan_band(begin, end, !failed);
}

void main() {
    visible = counts[COUNT_VISIBLE];
    if (push.stage == 0) {
        plan_visible();
    } else if (push.stage == 1) {
        plan_next();
    } else {
        plan_band(counts[COUNT_BAND_BEGIN], counts[COUNT_BAND_END], counts[COUNT_FAILED] == 0);
    }
}
