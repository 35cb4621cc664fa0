#version 460
#extension GL_KHR_shader_subgroup_arithmetic : require
#extension GL_KHR_shader_subgroup_ballot : require
#extension GL_KHR_shader_subgroup_shuffle : require
#extension GL_KHR_shader_subgroup_vote : require
#include "shared/prelude.glsl"

// Self-test: communication between the lanes of a workgroup by subgroup operations.
//
// As the base variant; the workgroup is one subgroup, as in the engine's compositing and sort by such operations.

layout(constant_id = 0) const uint WORKGROUP = 8;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) writeonly buffer Found { uint found[]; };

layout(push_constant, scalar) uniform Push {
    uint rounds;
} push;

const uint RESULTS = 8;

void main() {
    uint lane = gl_SubgroupInvocationID;
    uint number = lane * 2654435761u + 12345u;
    uint folded[RESULTS] = uint[RESULTS](0, 0, 0, 0, 0, 0, 0, 0);
    for (uint round = 0; round < push.rounds; ++round) {
        number = number * 1664525u + 1013904223u;
        uint value = number >> 12;
        uvec4 odd = subgroupBallot((value & 1u) != 0u);
        uint results[RESULTS] = uint[RESULTS](
            subgroupAdd(value),
            subgroupMax(value),
            uint(subgroupAdd(float(value & 1023u))),
            subgroupShuffle(value, (lane * 5u + round) % WORKGROUP),
            subgroupShuffleXor(value, 1u),
            subgroupBallotBitCount(odd),
            subgroupBallotExclusiveBitCount(odd),
            (subgroupAny(value % 61u == 0u) ? 1u : 0u) | (subgroupElect() ? 2u : 0u)
        );
        for (uint i = 0; i < RESULTS; ++i) folded[i] = folded[i] * 31u + results[i];
    }
    for (uint i = 0; i < RESULTS; ++i) found[lane * RESULTS + i] = folded[i];
}
