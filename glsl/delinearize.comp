#version 460
#include "shared/prelude.glsl"

// Depth of the splat at which the coverage of each pixel reaches 1/2, as a distance along z; and this depth or the mean
// by weight, in a host's code, nearer surfaces of the host before it.
//
// One invocation per pixel. Depths are those of the splats' means, by which they are sorted.

layout(constant_id = 0) const uint WORKGROUP = 64;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer Ids { uint id_from_pixel[]; };
layout(set = 0, binding = 1, scalar) readonly buffer Rests { vec2 blue_depth_from_splat[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Limits { float limit_from_pixel[]; };
layout(set = 0, binding = 3, scalar) writeonly buffer Depths { float depth_from_pixel[]; };
layout(set = 0, binding = 4, scalar) writeonly buffer Stored { float stored_from_pixel[]; };
// Sum of weight times depth of each pixel; read for means only.
layout(set = 0, binding = 5, scalar) readonly buffer Sums { float sum_from_pixel[]; };
layout(set = 0, binding = 6, scalar) readonly buffer Image { float image[]; };

layout(push_constant, scalar) uniform Push {
    float a;          // stored depth is a + b / z
    float b;
    uint linear;      // not 0: it is a + b * z
    float empty;      // value where there is nothing
    uint limited;     // not 0: the host has surfaces at `limit_from_pixel`
    uint mean;        // not 0: stored is the mean depth where the coverage is 1/2 at least
    uint pixels;
} push;

void main() {
    uint pixel = global_index();
    if (pixel >= push.pixels) return;
    float infinite = uintBitsToFloat(0x7f800000);
    uint id = id_from_pixel[pixel];
    float z = infinite;
    if (id != NO_SPLAT) z = blue_depth_from_splat[id].y;
    depth_from_pixel[pixel] = z;
    if (push.mean != 0) {
        float through = image[3 * push.pixels + pixel];
        z = through <= 0.5 ? sum_from_pixel[pixel] / (1.0 - through) : infinite;
    }
    if (push.limited != 0) z = min(z, limit_from_pixel[pixel]);
    float stored = push.linear != 0 ? push.a + push.b * z : push.a + push.b / z;
    stored_from_pixel[pixel] = isinf(z) ? push.empty : stored;
}
