#version 460
#include "shared/prelude.glsl"

// Turns a count that only the device knows into dispatch sizes, and notices what does not fit.
//
// One invocation. Stage 0 runs when the visible splats are counted, stage 1 when the intersections are.
// A frame that wants more intersections than the capacity sets COUNT_FAILED and plans nothing; while
// that stands every later frame plans nothing either, so that the host can grow the buffers and go on
// exactly where it left off.

layout(local_size_x = 1) in;

layout(set = 0, binding = 0, scalar) buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) writeonly buffer Args { DispatchArgs args[]; };

layout(push_constant, scalar) uniform Push {
    uint stage;            // 0: visible splats, 1: intersections
    uint isect_capacity;   // intersections the buffers hold
    uint chunk;            // keys per chunk of the radix sort
    uint chunks_per_group; // chunks one workgroup of the sort handles
    uint digit_count;      // entries of a digit table
    uint workgroup;        // invocations per workgroup of the elementwise and scan kernels
    uint group_limit;      // workgroups the device takes in one dimension
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

void main() {
    if (push.stage == 0) {
        uint count = counts[COUNT_VISIBLE];
        if (counts[COUNT_FAILED] != 0) count = 0;
        uint chunks = divide_up(count, push.chunk);
        counts[COUNT_VISIBLE] = count;
        counts[COUNT_VISIBLE_CHUNK] = chunks;
        counts[COUNT_VISIBLE_TABLE] = chunks * push.digit_count;
        write_args(ARGS_VISIBLE, divide_up(count, push.workgroup));
        write_args(ARGS_VISIBLE_CHUNK, divide_up(chunks, push.chunks_per_group));
        write_args(ARGS_VISIBLE_TABLE, divide_up(divide_up(chunks * push.digit_count, SCAN_CHUNK), push.workgroup));
        write_args(ARGS_VISIBLE_SCAN, divide_up(divide_up(count, SCAN_CHUNK), push.workgroup));
    } else {
        uint wanted = counts[COUNT_ISECT];
        bool fits = wanted <= push.isect_capacity;
        if (counts[COUNT_FAILED] == 0) counts[COUNT_ISECT_WANTED] = wanted;
        if (!fits) counts[COUNT_FAILED] = 1;
        uint count = counts[COUNT_FAILED] != 0 ? 0 : wanted;
        uint chunks = divide_up(count, push.chunk);
        counts[COUNT_ISECT] = count;
        counts[COUNT_ISECT_CHUNK] = chunks;
        counts[COUNT_ISECT_TABLE] = chunks * push.digit_count;
        write_args(ARGS_EXPAND, count == 0 ? 0 : divide_up(counts[COUNT_VISIBLE], push.workgroup));
        write_args(ARGS_ISECT, divide_up(count, push.workgroup));
        write_args(ARGS_ISECT_CHUNK, divide_up(chunks, push.chunks_per_group));
        write_args(ARGS_ISECT_TABLE, divide_up(divide_up(chunks * push.digit_count, SCAN_CHUNK), push.workgroup));
    }
}
