#version 460
#include "shared/prelude.glsl"

// Planes of one block after a refinement: each slot gets the numbers of its origin in an earlier block.
//
// One invocation per slot. Slots with an origin in another block stay as they are: a dispatch per pair of blocks writes
// each slot once.

layout(constant_id = 0) const uint WORKGROUP = 64;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer Index { uint origin_from_slot[]; };
layout(set = 0, binding = 1, scalar) readonly buffer Source { vec4 before[]; };
layout(set = 0, binding = 2, scalar) writeonly buffer Target { vec4 after[]; };

layout(push_constant, scalar) uniform Push {
    uint slot_count;    // slots of the block
    uint stride;        // elements between two of its planes
    uint source_first;  // first slot of the earlier block among all
    uint source_count;  // slots of the earlier block
    uint source_stride; // elements between two of its planes
    uint plane_first;   // first plane to write
    uint plane_count;   // planes of a block
    uint moments;       // not 0: zeros for splats marked as new
    uint fade;          // not 0: the last number of plane 0, the moment of the opacity, becomes 0
} push;

void main() {
    uint slot = global_index();
    if (slot >= push.slot_count) return;
    uint origin = origin_from_slot[slot];
    // Below the first slot the difference wraps around and is beyond the count.
    uint source = (origin & ~ORIGIN_IS_NEW) - push.source_first;
    if (source >= push.source_count) return;
    bool is_zero = push.moments != 0 && (origin & ORIGIN_IS_NEW) != 0;
    for (uint plane = push.plane_first; plane < push.plane_count; plane++) {
        vec4 four = is_zero ? vec4(0) : before[plane * push.source_stride + source];
        if (push.fade != 0 && plane == 0) four.w = 0;
        after[plane * push.stride + slot] = four;
    }
}
