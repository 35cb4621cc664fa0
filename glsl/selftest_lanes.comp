#version 460
#include "shared/prelude.glsl"

// Self-test: communication between the lanes of a workgroup through shared memory.
//
// One workgroup, one invocation per lane. In every round each lane has a number; sums, votes, ballots and exchanges of
// these are folded into the lane's results, so that an error of any round shows. Lane 0 counts as the elected one. Not
// used by frames or training steps.

layout(constant_id = 0) const uint WORKGROUP = 8;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) writeonly buffer Found { uint found[]; };

layout(push_constant, scalar) uniform Push {
    uint rounds;
} push;

const uint RESULTS = 8;

shared uint numbers[WORKGROUP];

void main() {
    uint lane = gl_LocalInvocationID.x;
    uint number = lane * 2654435761u + 12345u;
    uint folded[RESULTS] = uint[RESULTS](0, 0, 0, 0, 0, 0, 0, 0);
    for (uint round = 0; round < push.rounds; ++round) {
        number = number * 1664525u + 1013904223u;
        uint value = number >> 12;
        barrier();
        numbers[lane] = value;
        barrier();
        uint results[RESULTS] = uint[RESULTS](0, 0, 0, 0, 0, 0, 0, 0);
        float total = 0.0;
        for (uint other = 0; other < WORKGROUP; ++other) {
            uint theirs = numbers[other];
            results[0] += theirs;
            results[1] = max(results[1], theirs);
            total += float(theirs & 1023u);
            results[5] += theirs & 1u;
            results[6] += other < lane ? theirs & 1u : 0u;
            results[7] |= theirs % 61u == 0u ? 1u : 0u;
        }
        results[2] = uint(total);
        results[3] = numbers[(lane * 5u + round) % WORKGROUP];
        results[4] = numbers[lane ^ 1u];
        results[7] |= lane == 0 ? 2u : 0u;
        for (uint i = 0; i < RESULTS; ++i) folded[i] = folded[i] * 31u + results[i];
    }
    for (uint i = 0; i < RESULTS; ++i) found[lane * RESULTS + i] = folded[i];
}
