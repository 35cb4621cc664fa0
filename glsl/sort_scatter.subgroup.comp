#version 460
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_ballot : require
#include "shared/prelude.glsl"
#include "shared/chunk.glsl"

// Second half of a pass of a stable radix sort: moves every key and value to its place.
//
// One workgroup per chunk, a block of LANE_KEYS keys per lane at a time; a subgroup has consecutive keys. A lane finds
// the lanes of its subgroup with the same digit by one ballot per bit; the number of those before it is its rank.
// Subgroups update the shared table of next places in order, which keeps the sort stable. The workgroup consists of
// full subgroups of any size; keys are assigned by subgroup and lane, so the device's mapping of invocations does not
// matter.

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

const uint LANE_KEYS = 8;

// Next place of each digit.
shared uint next_place[SORT_DIGITS_MAX];

uint digit_of(uint key) {
    return (key >> push.shift) & (push.digit_count - 1);
}

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

// Moves the keys of a block; those of a lane are `first` and every one a subgroup further. All lanes call it.
void move_block(uint first, uint end) {
    uint key[LANE_KEYS];
    uint rank[LANE_KEYS];
    // Number of peers, of the first of them; 0 of others.
    uint led[LANE_KEYS];
    [[unroll]] for (uint k = 0; k < LANE_KEYS; ++k) {
        uint i = first + k * gl_SubgroupSize;
        key[k] = i < end ? keys[i] : 0;
        uvec4 peers = peers_of(digit_of(key[k]), i < end);
        rank[k] = subgroupBallotExclusiveBitCount(peers);
        led[k] = i < end && rank[k] == 0 ? subgroupBallotBitCount(peers) : 0;
    }
    for (uint turn = 0; turn < gl_NumSubgroups; ++turn) {
        if (turn == gl_SubgroupID) {
            [[unroll]] for (uint k = 0; k < LANE_KEYS; ++k) {
                uint digit = digit_of(key[k]);
                rank[k] += next_place[digit];
                // All peers have read before their first one writes, and it has before they read again.
                subgroupBarrier();
                if (led[k] != 0) next_place[digit] = rank[k] + led[k];
                subgroupBarrier();
            }
        }
        barrier();
    }
    [[unroll]] for (uint k = 0; k < LANE_KEYS; ++k) {
        uint i = first + k * gl_SubgroupSize;
        if (i >= end) continue;
        keys_out[rank[k]] = key[k];
        values_out[rank[k]] = values[i];
    }
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
    for (uint block = begin; block < end; block += LANE_KEYS * WORKGROUP) {
        move_block(block + gl_SubgroupID * LANE_KEYS * gl_SubgroupSize + gl_SubgroupInvocationID, end);
    }
}
