// Constants, buffers and parameters of compositing; included by `rasterize.comp` and its variants.

layout(constant_id = 1) const float T_MIN = TRANSMITTANCE_MIN;
layout(constant_id = 2) const float LOG2_ALPHA_MIN = -LOG2_255;
layout(constant_id = 3) const uint WITH_DEPTH = 0;
// 0: the pixels' ends, which training needs, are not computed, for fewer registers and less memory.
layout(constant_id = 4) const uint WITH_ENDS = 1;
// Not 0: depths and normals of the splats' planes.
layout(constant_id = 5) const uint WITH_SURFACE = 0;
// Not 0: splats at a pixel's limit of depth or beyond do not count.
layout(constant_id = 6) const uint WITH_LIMIT = 0;
// SURFEL_NONE, SURFEL_ANY or SURFEL_MIP.
layout(constant_id = 7) const uint SURFEL = 0;
// Not 0: the splat at which each pixel's transmittance falls to 1/2, in place of its end.
layout(constant_id = 8) const uint WITH_IDS = 0;
// Not 0: sums for the spread of the planes' depths as well.
layout(constant_id = 9) const uint WITH_SPREAD = 0;

layout(set = 0, binding = 0, scalar) readonly buffer ViewBlock { View view; };
layout(set = 0, binding = 1, scalar) readonly buffer Counts { uint counts[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Ranges { uvec2 range_from_tile[]; };
layout(set = 0, binding = 3, scalar) readonly buffer Sources { uint emitted_from_isect[]; };
layout(set = 0, binding = 4, scalar) readonly buffer Owners { uint splat_from_emitted[]; };
layout(set = 0, binding = 5, scalar) readonly buffer Shapes { vec4 ellipse_from_splat[]; };
layout(set = 0, binding = 6, scalar) readonly buffer ColorProducts { vec4 whiten_rg_from_splat[]; };
layout(set = 0, binding = 7, scalar) readonly buffer Rests { vec2 blue_depth_from_splat[]; };
layout(set = 0, binding = 8, scalar) buffer Image { float image[]; };
layout(set = 0, binding = 9, scalar) buffer Depth { float depth[]; };
layout(set = 0, binding = 10, scalar) writeonly buffer Ends { uint isect_end_from_pixel[]; };
layout(set = 0, binding = 11, scalar) readonly buffer Planes { vec3 plane_from_splat[]; };
// Planes of one float a pixel: SURFACE_DEPTH and so on.
layout(set = 0, binding = 12, scalar) buffer Surface { float surface[]; };
layout(set = 0, binding = 13, scalar) readonly buffer Limits { float limit_from_pixel[]; };

layout(push_constant, scalar) uniform Push {
    uint tile_stride;  // workgroup g composites tile g * tile_stride mod tile count
    uint band;         // bands composited before
    uint band_count;   // recorded bands
} push;

// Stores the splat of the intersection before `end`, if there is one; a band without leaves that of a nearer band.
void store_id(uint pixel, uint end) {
    if (end != 0) {
        isect_end_from_pixel[pixel] = splat_from_emitted[emitted_from_isect[end - 1]];
    } else if (push.band == 0) {
        isect_end_from_pixel[pixel] = NO_SPLAT;
    }
}
