#version 460
#include "shared/prelude.glsl"

// Dispatch sizes from counts on the device, and detection of full buffers.
//
// One invocation. Stage 0 runs once the visible splats are counted, stage 1 once their intersections are: it cuts off a
// band, the most splats in depth order that fit the buffers. Bands are composited one over the other, so that a frame
// may have more intersections than the buffers hold. A frame that is unfinished after the last recorded band sets
// COUNT_FAILED (and plans nothing if it has a single band); while it is set, later frames plan nothing either, so that
// the host can grow the buffers and resume exactly there. Stage 2 plans a band again after the host has restored its
// begin and end.

layout(local_size_x = 1) in;

layout(set = 0, binding = 0, scalar) buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) writeonly buffer Args { DispatchArgs args[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Offsets { uint isect_from_rank[]; };

layout(push_constant, scalar) uniform Push {
    uint stage;            // 0: visible splats, 1: the next band, 2: a band again
    uint isect_capacity;   // capacity of the buffers in intersections
    uint chunk;            // least keys of a chunk of the radix sort, beyond two workgroups of chunks
    uint chunks_per_group; // chunks one workgroup of the sort handles
    uint digit_count;      // entries of a digit table
    uint workgroup;        // invocations per workgroup of the elementwise kernels
    uint scanned_per_group; // chunks of a scan that one of its workgroups handles
    uint group_limit;      // most workgroups in one dimension
    uint tile_count;       // tiles of the image
    uint band;             // the band to plan
    uint band_count;       // recorded bands
    uint rank_limit;       // most splats of a band
} push;

// `count` workgroups, folded into two dimensions beyond the limit of one.
void write_args(uint slot, uint count) {
    uint x = min(count, push.group_limit);
    args[slot].x = x;
    args[slot].y = x == 0 ? 0 : (count + x - 1) / x;
    args[slot].z = 1;
}

uint divide_up(uint a, uint b) {
    return a / b + (a % b != 0 ? 1 : 0);
}

// Chunks of a sort: whole workgroups, so that all lanes are busy, and an even number of them, for both of a software
// device's two threads.
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
    write_args(ARGS_VISIBLE_TABLE, divide_up(divide_up(chunks * push.digit_count, SCAN_CHUNK), push.scanned_per_group));
    write_args(ARGS_VISIBLE_SCAN, divide_up(divide_up(count, SCAN_CHUNK), push.scanned_per_group));
}

uint visible;

// Number of intersections of the splats before `rank`.
uint isects_before(uint rank) {
    return rank < visible ? isect_from_rank[rank] : counts[COUNT_ISECT_WANTED];
}

// End of the longest band from `begin` on that fits the buffers.
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
    write_args(ARGS_ISECT_TABLE, divide_up(divide_up(chunks * push.digit_count, SCAN_CHUNK), push.scanned_per_group));
    write_args(ARGS_TILE, begin < end ? push.tile_count : 0);
}

void plan_next() {
    bool failed = counts[COUNT_FAILED] != 0;
    if (push.band == 0 && !failed) counts[COUNT_ISECT_WANTED] = counts[COUNT_ISECT];
    uint begin = push.band == 0 ? 0 : counts[COUNT_BAND_END];
    uint end = visible;
    if (!failed) {
        // A total saturated at 2^32 - 1 may stand for a larger one, and offsets are then invalid.
        bool countable = counts[COUNT_ISECT_WANTED] != ~0u;
        if (countable) end = end_of_band(begin);
        bool enough = countable && (end == visible || push.band + 1 < push.band_count);
        if (!enough) {
            counts[COUNT_FAILED] = 1;
            failed = !countable || push.band == 0;
        }
    }
    // After a failure nothing is left to draw.
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
