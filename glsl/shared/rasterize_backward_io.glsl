// Constants, buffers and parameters of compositing's gradient; included by `rasterize_backward.comp` and its variants.

layout(constant_id = 1) const float LOG2_ALPHA_MIN = -LOG2_255;
// SURFEL_NONE, SURFEL_ANY or SURFEL_MIP; surfels have longer records.
layout(constant_id = 2) const uint SURFEL = 0;
// Not 0: gradients by the planes' depths and normals as well, with longer records.
layout(constant_id = 3) const uint WITH_SURFACE = 0;
// Not 0: and by the spread of the depths.
layout(constant_id = 4) const uint WITH_SPREAD = 0;

layout(set = 0, binding = 0, scalar) readonly buffer ViewBlock { View view; };
layout(set = 0, binding = 1, scalar) readonly buffer Ranges { uvec2 range_from_tile[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Sources { uint emitted_from_isect[]; };
layout(set = 0, binding = 3, scalar) readonly buffer Owners { uint splat_from_emitted[]; };
layout(set = 0, binding = 4, scalar) readonly buffer Shapes { vec4 ellipse_from_splat[]; };
layout(set = 0, binding = 5, scalar) readonly buffer ColorProducts { vec4 whiten_rg_from_splat[]; };
layout(set = 0, binding = 6, scalar) readonly buffer Rests { vec2 blue_depth_from_splat[]; };
layout(set = 0, binding = 7, scalar) buffer Image { float image[]; };
// Planes of one float a pixel: by red, green and blue, and D_COVERAGE and so on.
layout(set = 0, binding = 8, scalar) readonly buffer ImageGradient { float d_image[]; };
layout(set = 0, binding = 9, scalar) readonly buffer Ends { uint isect_end_from_pixel[]; };
layout(set = 0, binding = 10, scalar) writeonly buffer ShapeGradients { vec4 d_shape_from_source[]; };
layout(set = 0, binding = 11, scalar) writeonly buffer ToneGradients { vec4 d_tone_from_source[]; };
layout(set = 0, binding = 12, scalar) writeonly buffer RestGradients { float d_rest_from_source[]; };
layout(set = 0, binding = 13, scalar) readonly buffer Planes { vec3 plane_from_splat[]; };

layout(push_constant, scalar) uniform Push {
    uint tile_stride;  // workgroup g takes tile g * tile_stride mod tile count
    uint band;         // 0: all splats at once, 1: the farthest band, 2: a nearer one
} push;
