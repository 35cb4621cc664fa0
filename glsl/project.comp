#version 460
#include "shared/prelude.glsl"
#include "shared/math.glsl"
#include "shared/primitive.glsl"
#include "shared/plane.glsl"
#include "shared/surfel.glsl"
#include "shared/random.glsl"
#include "shared/sh.glsl"

// Projects splats: ellipse, colour and depth on the screen, and number of tiles touched.
//
// One invocation per splat, given by its slot among the parameters. An invisible splat (behind the near plane, off the
// screen, too faint, dropped, or not finite in any parameter) gets the tile count 0, and the rest of its record is not
// read. Dropped splats are a random share; the others are more opaque for it, so that the expected optical depth of
// faint splats stays the same. Surfels are not drawn edge-on either, unless as spots.

layout(constant_id = 0) const uint WORKGROUP = 64;
layout(constant_id = 1) const uint SH_DEGREE = 3;
// Log2 of the least alpha drawn; that of 1/255 (3DGS paper, appendix C).
layout(constant_id = 2) const float LOG2_ALPHA_MIN = -LOG2_255;
// Not 0: tiles by the rule of the 3DGS code.
layout(constant_id = 3) const uint INRIA = 0;
// Storage of parameters: 0: floats; 1: SH as pairs of halves; 2: all but means as halves.
layout(constant_id = 4) const uint PRECISION = 0;
// Not 0: slots are not in splat order; the index gives each slot's splat.
layout(constant_id = 5) const uint INDEXED = 0;
// Not 0: the splats' planes as well.
layout(constant_id = 6) const uint WITH_PLANES = 0;
// Not 0: only tiles whose limit of depth is beyond the splat count.
layout(constant_id = 7) const uint WITH_LIMIT = 0;
// Not 0: surfels; their planes are written, too.
layout(constant_id = 8) const uint SURFEL = 0;
// Not 0: the model is an instance; its place and looks are in the push constants, and take the place of the view's.
layout(constant_id = 9) const uint INSTANCED = 0;
// Not 0: depth is the distance from the camera's centre, which turns of the camera leave alone to the bit.
layout(constant_id = 10) const uint BY_DISTANCE = 0;
// Not 0: an orthographic projection, whose focal lengths are pixels per world unit.
layout(constant_id = 11) const uint ORTHOGRAPHIC = 0;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer ViewBlock { View view; };
layout(set = 0, binding = 1, scalar) readonly buffer ParamsBlock { vec4 params[]; };
// Projected splats as separate arrays: a binding then reaches several million splats.
layout(set = 0, binding = 2, scalar) writeonly buffer Shapes { vec4 ellipse_from_splat[]; };
layout(set = 0, binding = 3, scalar) writeonly buffer ColorProducts { vec4 whiten_rg_from_splat[]; };
layout(set = 0, binding = 4, scalar) writeonly buffer Rests { vec2 blue_depth_from_splat[]; };
layout(set = 0, binding = 5, scalar) writeonly buffer TileCounts { uint tile_count_from_splat[]; };
layout(set = 0, binding = 6, scalar) readonly buffer Index { uint splat_from_slot[]; };
layout(set = 0, binding = 7, scalar) writeonly buffer Planes { vec3 plane_from_splat[]; };
layout(set = 0, binding = 8, scalar) readonly buffer TileLimits { float limit_from_tile[]; };

layout(push_constant, scalar) uniform Push {
    uint splat_count;  // splats of this dispatch
    uint stride;       // elements between two planes of parameters
    mat3 view_from_model;  // of instances, as all below
    vec3 position;         // camera centre in the model
    mat3 cube_from_model;  // clip box as the cube from -1 to 1: its linear part
    vec3 cube_origin;      // and its origin
    vec3 tint;             // factors of the colour
    float log_opacity;     // log2 of the opacities' factor
    float dilation;        // as of the view
    uint flags;            // INSTANCE_*
} push;

#include "shared/cover.glsl"

// A stored splat without its SH coefficients.
struct Stored {
    vec4 mean;      // xyz and the opacity's logit
    vec4 rotation;
    vec4 shaping;   // log-scale and the standard deviation of the 3D smoothing filter
};

Stored stored(uint slot) {
    vec4 mean = params[slot];
    vec4 next = params[push.stride + slot];
    if (PRECISION < 2) return Stored(mean, next, params[2 * push.stride + slot]);
    uvec4 words = floatBitsToUint(next);
    vec2 last = unpackHalf2x16(words.w);
    vec4 rotation = vec4(unpackHalf2x16(words.x), unpackHalf2x16(words.y));
    return Stored(vec4(mean.xyz, last.y), rotation, vec4(unpackHalf2x16(words.z), last.x, 0.0));
}

vec3 color_toward(uint slot, vec3 direction, inout bool sound) {
    float basis[16];
    sh_basis(SH_DEGREE, direction, basis);
    uint terms = (SH_DEGREE + 1) * (SH_DEGREE + 1);
    precise float sum[3] = float[](0.5, 0.5, 0.5);
    // Numbers per vec4.
    const uint each = PRECISION == 0 ? 4 : 8;
    const uint first = PRECISION == 2 ? HALF_GEOMETRY_PLANES : GEOMETRY_PLANES;
    [[unroll]] for (uint plane = 0; plane < (terms * 3 + each - 1) / each; ++plane) {
        vec4 four = params[(first + plane) * push.stride + slot];
        [[unroll]] for (uint i = 0; i < each; ++i) {
            uint k = plane * each + i;
            float value = PRECISION == 0 ? four[i % 4] : unpackHalf2x16(floatBitsToUint(four[i / 2]))[i % 2];
            if (k < terms * 3) sum[k % 3] += value * basis[k / 3];
        }
    }
    vec3 color = vec3(sum[0], sum[1], sum[2]);
    sound = sound && is_finite(color);
    return clamp(color, vec3(0.0), vec3(COLOR_MAX));
}

// Number of a row's tiles whose limits are beyond a depth.
uint tiles_before(float depth, uint begin_of_row, ivec2 columns) {
    uint count = 0;
    // Two per iteration, as in expand.
    for (int column = columns.x; column <= columns.y; column += 2) {
        if (depth < limit_from_tile[begin_of_row + uint(column)]) ++count;
        if (column < columns.y && depth < limit_from_tile[begin_of_row + uint(column) + 1]) ++count;
    }
    return count;
}

// Number of tiles that a splat touches.
uint tiles_of(vec4 shape, vec2 whiten, vec3 plane, float depth) {
    ivec2 rows;
    Cover cover = cover_of(shape, whiten, plane, depth, rows);
    uint count = 0;
    for (int row = rows.x; row <= rows.y; ++row) {
        ivec2 columns = columns_of(cover, row);
        if (WITH_LIMIT == 0) {
            count += uint(columns.y - columns.x + 1);
        } else {
            count += tiles_before(depth, (uint(row) - view.first_row / TILE_HEIGHT) * view.tiles.x, columns);
        }
    }
    return count;
}

// The view, from within an instance's model.
View view_of_model() {
    View own = view;
    if (INSTANCED != 0) {
        own.view_from_world = push.view_from_model;
        own.position = push.position;
        own.dilation = push.dilation;
        own.compensate = push.flags & INSTANCE_COMPENSATE;
    }
    return own;
}

// True for means that the instance's clip box leaves.
bool within_clip(vec3 mean) {
    vec3 cube = abs(push.cube_from_model * mean + push.cube_origin);
    bool inside = max(max(cube.x, cube.y), cube.z) <= 1.0;
    return (push.flags & (inside ? INSTANCE_CUT : INSTANCE_KEEP)) == 0;
}

// log2 of a splat's opacity, under smoothing, the screen filter, the instance and dropout.
float log_opacity_of(View view, float logit, float smoothing, Smoothed s, Footprint f) {
    // log2 of the sigmoid; exp(-u) may overflow to infinity, then the splat is invisible as it should.
    float log_opacity = -log2(1.0 + exp(-logit));
    if (smoothing > 0.0) log_opacity += log_smoothing(s);
    if (view.compensate != 0) log_opacity += log_compensation(f);
    if (INSTANCED != 0) log_opacity += push.log_opacity;
    if (view.dropout != 0) log_opacity -= log2(1.0 - view.dropout * (1.0 / 4294967296.0));
    return log_opacity;
}

// Unit vector from the camera to a splat, at which harmonics are taken.
vec3 direction_of(View view, vec3 offset, float distance) {
    if (ORTHOGRAPHIC == 0) return offset / distance;
    vec3 along_z = transpose(view.view_from_world)[2];
    return along_z / vector_length(along_z);
}

// Writes the splat's record and returns its number of tiles.
uint project(uint slot, uint splat) {
    View view = view_of_model();
    Stored own = stored(slot);
    vec4 mean = own.mean, rotation = own.rotation, shaping = own.shaping;
    vec3 log_scale = shaping.xyz;
    if (SURFEL != 0) log_scale.z = 0.0;
    vec3 scale = exp(log_scale);

    vec3 offset = mean.xyz - view.position;
    vec3 mean_view = view.view_from_world * offset;
    float q_length = quaternion_length(rotation);
    bool sound = is_finite(mean) && is_finite(rotation) && is_finite(log_scale) && is_finite(scale);
    sound = sound && is_finite(mean_view) && mean_view.z >= view.near_plane && q_length > QUATERNION_MIN;

    Jacobian j = jacobian(view, mean_view);
    if (ORTHOGRAPHIC != 0) j = parallel_jacobian(view);
    mat3 axes = rotation_matrix(rotation / q_length);
    Smoothed s = smoothed(scale, shaping.w);
    if (SURFEL != 0) flatten(s);
    vec3 v_x = (j.row_x * axes) * s.scale;
    vec3 v_y = (j.row_y * axes) * s.scale;
    Footprint f = footprint(v_x, v_y, view.dilation);
    vec3 plane = vec3(0.0);
    float along = 0.0;
    if (SURFEL != 0) {
        along = dot(axes[2], offset);
        f = surfel_footprint(view, v_x, v_y, s.scale, mean_view.z, along);
        plane = surfel_plane(view, view.view_from_world * axes[2], mean_view.z, along);
    }
    bool shaped = is_finite(f.a) && is_finite(f.det) && f.det > 0.0;
    vec2 whiten = WHITEN * whitening(f);
    float distance = vector_length(offset);
    if (SURFEL != 0) {
        bool spot = !shaped || !is_finite(plane) || is_spot(whiten, along, distance);
        shaped = !spot || view.compensate == 0 && is_finite(f.a);
        if (spot) {
            whiten = vec2(SPOT_WHITEN);
            f.slope = 0.0;
            plane = vec3(0.0);
        }
    }
    sound = sound && shaped;

    vec2 mean_pixel = view.focal * mean_view.xy / mean_view.z + view.center;
    if (ORTHOGRAPHIC != 0) mean_pixel = view.focal * mean_view.xy + view.center;
    float log_opacity = log_opacity_of(view, mean.w, shaping.w, s, f);
    if (INSTANCED != 0) sound = sound && within_clip(mean.xyz);
    if (view.dropout != 0) sound = sound && scramble(view.dropout_key ^ splat) >= view.dropout;
    sound = sound && log_opacity >= LOG2_ALPHA_MIN && is_finite(vec3(mean_pixel, 0.0));
    sound = sound && is_finite(vec3(whiten, f.slope)) && whiten.x > 0.0 && whiten.y > 0.0;

    vec3 color = color_toward(slot, direction_of(view, offset, distance), sound);
    if (INSTANCED != 0) color = min(color * push.tint, COLOR_MAX);
    if (!sound) return 0;

    vec4 shape = vec4(mean_pixel, f.slope, log_opacity);
    ellipse_from_splat[splat] = shape;
    whiten_rg_from_splat[splat] = vec4(whiten, color.rg);
    float depth = mean_view.z;
    // Lengths in an instance's model are not those of the world.
    if (BY_DISTANCE != 0) depth = INSTANCED != 0 ? vector_length(mean_view) : distance;
    blue_depth_from_splat[splat] = vec2(color.b, depth);
    if (SURFEL != 0) {
        plane_from_splat[splat] = plane;
    } else if (WITH_PLANES != 0) {
        plane_from_splat[splat] = plane_of(view, axes, s.scale, offset, mean_view.z, f);
    }

    return tiles_of(shape, whiten, plane, mean_view.z);
}

void main() {
    uint slot = global_index();
    if (slot >= push.splat_count) return;
    uint splat = slot;
    if (INDEXED != 0) splat = splat_from_slot[slot];
    tile_count_from_splat[splat] = project(slot, splat);
}
