#version 460
#include "shared/prelude.glsl"

// Last of three passes of an exclusive prefix sum: every value's offset.
//
// One invocation per chunk of SCAN_CHUNK consecutive values, as in scan_reduce.

layout(constant_id = 0) const uint WORKGROUP = 64;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) readonly buffer Values { uint values[]; };
layout(set = 0, binding = 1, scalar) readonly buffer ValuesByFour { uvec4 values_by_four[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Sums { uint sum_from_chunk[]; };
layout(set = 0, binding = 3, scalar) writeonly buffer Offsets { uint offsets[]; };
layout(set = 0, binding = 3, scalar) writeonly buffer OffsetsByFour { uvec4 offsets_by_four[]; };

layout(push_constant, scalar) uniform Push {
    uint count_slot;  // slot in `counts` of the number of values
    uint flags;       // sum "is not 0" instead of the values
} push;

void main() {
    uint chunk = global_index();
    uint count = counts[push.count_slot];
    uint begin = chunk * SCAN_CHUNK;
    if (begin >= count) return;
    uint end = min(begin + SCAN_CHUNK, count);
    uint quads = begin + (end - begin) / 4 * 4;
    uint sum = sum_from_chunk[chunk];
    uint i = begin;
    for (; i < quads; i += 4) {
        uvec4 value = values_by_four[i / 4];
        value = push.flags != 0 ? min(value, uvec4(1)) : value;
        uvec4 offset;
        [[unroll]] for (uint k = 0; k < 4; ++k) {
            offset[k] = sum;
            sum += value[k];
        }
        offsets_by_four[i / 4] = offset;
    }
    for (; i < end; ++i) {
        uint value = values[i];
        offsets[i] = sum;
        sum += push.flags != 0 ? min(value, 1u) : value;
    }
}
