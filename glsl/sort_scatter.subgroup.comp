#version 460
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_ballot : require
#include "shared/prelude.glsl"
#include "shared/chunk.glsl"

// Second half of a pass of a stable radix sort: moves every key and value to its place.
//
// One workgroup per chunk, a block of keys at a time. A lane finds the lanes of its subgroup with the same digit by one
// ballot per bit; the number of those before it is its rank. Subgroups update the shared table of next places in order,
// which keeps the sort stable. The workgroup consists of full subgroups of any size; keys are assigned by subgroup and
// lane, so the device's mapping of invocations does not matter.

layout(constant_id = 0) const uint WORKGROUP = 8;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) readonly buffer Keys { uint keys[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Values { uint values[]; };
layout(set = 0, binding = 3, scalar) buffer Table { uint table[]; };
layout(set = 0, binding = 4, scalar) writeonly buffer KeysOut { uint keys_out[]; };
layout(set = 0, binding = 5, scalar) writeonly buffer ValuesOut { uint values_out[]; };

layout(push_constant, scalar) uniform Push {
    uint count_slot;  // slot in `counts` of the number of keys
    uint chunk_slot;  // slot in `counts` of the number of chunks
    uint shift;       // lowest bit of the digit
    uint digit_count; // a power of two, at most SORT_DIGITS_MAX
} push;

// Next place of each digit.
shared uint next_place[SORT_DIGITS_MAX];

// Active lanes of the subgroup with the same digit.
uvec4 peers_of(uint digit, bool takes_part) {
    uvec4 peers = subgroupBallot(takes_part);
    for (uint bit = 1; bit < push.digit_count; bit <<= 1) {
        bool set = (digit & bit) != 0;
        uvec4 those = subgroupBallot(set);
        peers &= set ? those : ~those;
    }
    return peers;
}

void main() {
    uint chunk = group_index();
    uint count = counts[push.count_slot];
    uint chunk_count = counts[push.chunk_slot];
    if (chunk >= chunk_count) return;
    uint size = keys_per_chunk(count, chunk_count);
    uint begin = min(chunk * size, count);
    uint end = min(begin + size, count);
    for (uint digit = gl_LocalInvocationID.x; digit < push.digit_count; digit += WORKGROUP) {
        next_place[digit] = table[digit * chunk_count + chunk];
    }
    barrier();
    uint lane = gl_SubgroupID * gl_SubgroupSize + gl_SubgroupInvocationID;
    for (uint block = begin; block < end; block += WORKGROUP) {
        uint i = block + lane;
        bool takes_part = i < end;
        uint key = takes_part ? keys[i] : 0;
        uint digit = (key >> push.shift) & (push.digit_count - 1);
        uvec4 peers = peers_of(digit, takes_part);
        uint rank = subgroupBallotExclusiveBitCount(peers);
        bool leads = takes_part && rank == 0;
        uint place = 0;
        for (uint turn = 0; turn < gl_NumSubgroups; ++turn) {
            if (turn == gl_SubgroupID) {
                place = next_place[digit] + rank;
                // All peers have read before their first one writes.
                subgroupBarrier();
                if (leads) next_place[digit] = place + subgroupBallotBitCount(peers);
            }
            barrier();
        }
        if (takes_part) {
            keys_out[place] = key;
            values_out[place] = values[i];
        }
    }
}
