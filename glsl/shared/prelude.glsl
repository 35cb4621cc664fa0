// Common extensions of all kernels: scalar block layout (so that a vec3 in a buffer is three floats), loop-unrolling
// hints, and texels without samplers.
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_EXT_samplerless_texture_functions : require
#include "shared/constants.glsl"
#include "shared/types.glsl"

// Linear index of this workgroup; the host may have folded the dispatch into two dimensions.
uint group_index() {
    return gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
}

// Linear index of this invocation. A macro, because glslang takes gl_WorkGroupSize for 1 before the kernel's
// local_size_x_id.
#define global_index() (group_index() * gl_WorkGroupSize.x + gl_LocalInvocationID.x)
