#version 460
#include "shared/prelude.glsl"

// Second half of a pass of a stable radix sort: every key and value to its place.
//
// One invocation per chunk, as in sort_count; it walks its keys in order, so equal digits stay in order.
// The table's entries are the places to write next, counted up as they are used.

layout(constant_id = 0) const uint WORKGROUP = 8;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) readonly buffer Keys { uint keys[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Values { uint values[]; };
layout(set = 0, binding = 3, scalar) buffer Table { uint table[]; };
layout(set = 0, binding = 4, scalar) writeonly buffer KeysOut { uint keys_out[]; };
layout(set = 0, binding = 5, scalar) writeonly buffer ValuesOut { uint values_out[]; };

layout(push_constant, scalar) uniform Push {
    uint count_slot;  // where in `counts` the number of keys stands
    uint chunk;       // keys per chunk
    uint shift;       // lowest bit of the digit
    uint digit_count; // a power of two
} push;

void main() {
    uint chunk = global_index();
    uint count = counts[push.count_slot];
    uint begin = chunk * push.chunk;
    if (begin >= count) return;
    uint end = min(begin + push.chunk, count);
    uint chunk_count = (count + push.chunk - 1) / push.chunk;
    for (uint i = begin; i < end; ++i) {
        uint key = keys[i];
        uint slot = ((key >> push.shift) & (push.digit_count - 1)) * chunk_count + chunk;
        uint place = table[slot];
        table[slot] = place + 1;
        keys_out[place] = key;
        values_out[place] = values[i];
    }
}
