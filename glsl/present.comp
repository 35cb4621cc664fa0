#version 460
#include "shared/prelude.glsl"

// Writes a composited image into a rectangle of the host's storage image: colour, and opacity as alpha.
//
// One invocation per pixel of an 8x8 block. The colour includes the background.

layout(local_size_x = 8, local_size_y = 8) in;

layout(set = 0, binding = 0, scalar) readonly buffer ViewBlock { View view; };
layout(set = 0, binding = 1, scalar) readonly buffer Image { float image[]; };
layout(set = 0, binding = 2) writeonly uniform image2D target;

layout(push_constant, scalar) uniform Push {
    uvec2 origin;  // the target's pixel at the image's first
} push;

void main() {
    uvec2 at = gl_GlobalInvocationID.xy;
    if (any(greaterThanEqual(at, view.size))) return;
    uint pixels = view.size.x * view.size.y;
    uint pixel = at.y * view.size.x + at.x;
    vec3 color = vec3(image[pixel], image[pixels + pixel], image[2 * pixels + pixel]);
    imageStore(target, ivec2(push.origin + at), vec4(color, 1.0 - image[3 * pixels + pixel]));
}
