#version 460
#include "shared/prelude.glsl"

// Lays a composited image without background over a rectangle of a host's pixels, in the host's image.
//
// One invocation per pixel of an 8x8 block, which reads and writes this pixel alone. A pixel without splats is not
// written.

layout(local_size_x = 8, local_size_y = 8) in;

layout(set = 0, binding = 0, scalar) readonly buffer ViewBlock { View view; };
layout(set = 0, binding = 1, scalar) readonly buffer Image { float image[]; };
// The target's pixels.
layout(set = 0, binding = 2) uniform texture2D below;
layout(set = 0, binding = 3) writeonly uniform image2D target;

layout(push_constant, scalar) uniform Push {
    uint linear;  // not 0: the host's pixels are linear light; else display values, as the splats' colours
    float gain;   // linear light of a display value of 1
    uvec2 origin; // the target's pixel at the image's first
} push;

// Linear light of display values (IEC 61966-2-1).
vec3 decoded(vec3 color) {
    vec3 curve = pow((color + 0.055) / 1.055, vec3(2.4));
    return mix(curve, color / 12.92, lessThanEqual(color, vec3(0.04045)));
}

void main() {
    uvec2 at = gl_GlobalInvocationID.xy;
    if (any(greaterThanEqual(at, view.size))) return;
    uint pixels = view.size.x * view.size.y;
    uint pixel = at.y * view.size.x + at.x;
    float through = image[3 * pixels + pixel];
    if (through == 1.0) return;
    vec3 color = vec3(image[pixel], image[pixels + pixel], image[2 * pixels + pixel]);
    float alpha = 1.0 - through;
    if (push.linear != 0) color = alpha * push.gain * decoded(color / alpha);
    ivec2 pixel_below = ivec2(push.origin + at);
    imageStore(target, pixel_below, vec4(color, alpha) + through * texelFetch(below, pixel_below, 0));
}
