#version 460
#include "shared/prelude.glsl"

// Self-test: the functions used in projection and compositing, for arguments from the host.
//
// One invocation per argument. Not used by frames or training steps.

layout(constant_id = 0) const uint WORKGROUP = 64;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer Arguments { float arguments[]; };
// [function][argument]: exp, exp2, log2, sqrt, inversesqrt, 1 / x.
layout(set = 0, binding = 1, scalar) writeonly buffer Found { float found[]; };

layout(push_constant, scalar) uniform Push {
    uint argument_count;
} push;

void main() {
    uint index = global_index();
    uint count = push.argument_count;
    if (index >= count) return;
    float x = arguments[index];
    found[index] = exp(x);
    found[count + index] = exp2(x);
    found[2 * count + index] = log2(x);
    found[3 * count + index] = sqrt(x);
    found[4 * count + index] = inversesqrt(x);
    found[5 * count + index] = 1.0 / x;
}
