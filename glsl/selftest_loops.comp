#version 460
#include "shared/prelude.glsl"

// Self-test: whether loops run to their end.
//
// One invocation per chain of numbers, each the congruence of the one before, which no compiler can foretell; where
// a chain has got to tells how many turns there were. Some drivers leave loops after many turns and say nothing.
// No frame and no training step runs this.

layout(constant_id = 0) const uint WORKGROUP = 8;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) writeonly buffer Found { uint found[]; };

layout(push_constant, scalar) uniform Push {
    uint turns;
} push;

void main() {
    uint number = global_index();
    for (uint turn = 0; turn < push.turns; ++turn) number = number * 1664525u + 1013904223u;
    found[global_index()] = number;
}
