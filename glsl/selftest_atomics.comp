#version 460
#include "shared/prelude.glsl"

// Self-test: atomic operations on integers, in storage and in shared memory.
//
// Every invocation draws a ticket and marks it: each must be marked exactly once. All results are integers, which do
// not depend on the order. Not used by frames or training steps.

layout(constant_id = 0) const uint WORKGROUP = 64;
layout(local_size_x_id = 0) in;

// Tickets drawn; maximum of the hashes, maximum of their complements, or of single bits, xor; then a histogram of the
// hashes' lowest bits; then the marks.
layout(set = 0, binding = 0, scalar) buffer Counts { uint counts[]; };

layout(push_constant, scalar) uniform Push {
    uint invocation_count;
} push;

const uint BINS = 16;
const uint BINS_BEGIN = 8;
const uint MARKS_BEGIN = 24;

shared uint shared_count[BINS];

void main() {
    uint index = global_index();
    bool counts_here = index < push.invocation_count;
    for (uint bin = gl_LocalInvocationID.x; bin < BINS; bin += WORKGROUP) shared_count[bin] = 0;
    barrier();
    uint hash = index * 1664525u + 1013904223u;
    hash ^= hash >> 16;
    if (counts_here) {
        uint ticket = atomicAdd(counts[0], 1);
        atomicAdd(counts[MARKS_BEGIN + min(ticket, push.invocation_count)], 1);
        atomicMax(counts[1], hash);
        atomicMax(counts[2], ~hash);
        atomicOr(counts[3], 1u << (hash & 31u));
        atomicXor(counts[4], hash);
        atomicAdd(shared_count[hash & (BINS - 1)], 1);
    }
    barrier();
    for (uint bin = gl_LocalInvocationID.x; bin < BINS; bin += WORKGROUP) {
        atomicAdd(counts[BINS_BEGIN + bin], shared_count[bin]);
    }
}
