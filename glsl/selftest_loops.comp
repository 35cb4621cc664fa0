#version 460
#include "shared/prelude.glsl"

// Self-test: completion of long loops.
//
// One invocation per chain of numbers of a linear congruential generator, which no compiler can predict; the end of a
// chain shows the number of iterations. Some drivers leave loops after many iterations without an error. Not used by
// frames or training steps.

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
