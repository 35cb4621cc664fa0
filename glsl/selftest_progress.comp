#version 460
#include "shared/prelude.glsl"

// Self-test: every workgroup runs once, and all its lanes reach every barrier.
//
// Lanes run different numbers of iterations before each barrier and exchange their numbers with their neighbours there.
// As in all kernels, nothing waits for another workgroup. Not used by frames or training steps.

layout(constant_id = 0) const uint WORKGROUP = 16;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) writeonly buffer Found { uint found[]; };

layout(push_constant, scalar) uniform Push {
    uint group_count;
    uint rounds;
} push;

shared uint numbers[WORKGROUP];

void main() {
    uint group = group_index();
    uint lane = gl_LocalInvocationID.x;
    if (group >= push.group_count) return;
    uint number = group * WORKGROUP + lane;
    for (uint round = 0; round < push.rounds; ++round) {
        uint turns = (number >> 7) % 23u;
        for (uint turn = 0; turn < turns; ++turn) number = number * 1664525u + 1013904223u;
        numbers[lane] = number;
        barrier();
        number ^= numbers[(lane + 1u) % WORKGROUP] >> 1;
        barrier();
    }
    numbers[lane] = number;
    barrier();
    if (lane != 0) return;
    uint sum = 0;
    for (uint other = 0; other < WORKGROUP; ++other) sum += numbers[other];
    found[group] = sum;
    atomicAdd(counts[group], 1);
}
