#include "shared/math.glsl"
#include "shared/primitive.glsl"
#include "shared/plane.glsl"
#include "shared/surfel.glsl"
#include "shared/plane_backward.glsl"
#include "shared/sh.glsl"

// Gradient of every splat; included by `project_backward.comp` and its variant, which define the sum of a splat's
// records.
//
// One invocation per splat, given by its slot among the parameters. A splat's records are contiguous and are summed in
// a fixed order, so that the result is the same in every run. The projection is recomputed, not stored. Also updates
// the statistics for density control. If the frame took several bands, the records are those of one band, with all
// records of its splats; splats of other bands are skipped. If the picture is in parts, the sums of records are kept in
// the place of the gradient until all parts are added.

layout(constant_id = 0) const uint WORKGROUP = 64;
layout(constant_id = 1) const uint SH_DEGREE = 3;
// Not 0: slots are not in splat order; the index gives each slot's splat.
layout(constant_id = 2) const uint INDEXED = 0;
// SURFEL_NONE, SURFEL_ANY or SURFEL_MIP; surfels have longer records.
layout(constant_id = 3) const uint SURFEL = 0;
// Not 0: gradients by depths and normals as well, with longer records.
layout(constant_id = 4) const uint WITH_SURFACE = 0;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer ViewBlock { View view; };
layout(set = 0, binding = 1, scalar) readonly buffer Counts { uint counts[]; };
layout(set = 0, binding = 2, scalar) readonly buffer ParamsBlock { vec4 params[]; };
layout(set = 0, binding = 3, scalar) readonly buffer TileCounts { uint tile_count_from_splat[]; };
layout(set = 0, binding = 4, scalar) readonly buffer Begins { uint emitted_from_splat[]; };
layout(set = 0, binding = 5, scalar) readonly buffer Shapes { vec4 ellipse_from_splat[]; };
layout(set = 0, binding = 6, scalar) readonly buffer ColorProducts { vec4 whiten_rg_from_splat[]; };
layout(set = 0, binding = 7, scalar) readonly buffer Rests { vec2 blue_depth_from_splat[]; };
layout(set = 0, binding = 8, scalar) readonly buffer ShapeGradients { vec4 d_shape_from_source[]; };
layout(set = 0, binding = 9, scalar) readonly buffer ToneGradients { vec4 d_tone_from_source[]; };
layout(set = 0, binding = 10, scalar) readonly buffer RestGradients { float d_rest_from_source[]; };
layout(set = 0, binding = 11, scalar) buffer Gradients { vec4 d_params[]; };
layout(set = 0, binding = 12, scalar) buffer Statistics { vec4 statistics[]; };
layout(set = 0, binding = 13, scalar) readonly buffer Index { uint splat_from_slot[]; };

layout(push_constant, scalar) uniform Push {
    uint splat_count;       // splats of this dispatch
    uint stride;            // elements between two planes of parameters
    float opacity_penalty;  // added to dL/d opacity of every splat
    float scale_penalty;    // added to dL/d scale of every splat and axis
    float size_penalty;     // times the scale, likewise: the derivative of half the squared scale
    uint banded;            // not 0: a visible splat with begin NOT_LISTED belongs to another band
    uint part;              // PART_*
} push;

struct Gradient {
    vec3 mean;
    float opacity_logit;
    vec4 quaternion;
    vec3 log_scale;
};

// Gradient of a splat's colour and its viewing direction; zero if it is not visible.
struct ColorGradient {
    bool is_visible;
    vec3 direction;
    float distance;
    vec3 d_color;
};

#include "shared/record.glsl"

// dL/d direction, before the projection on the sphere's tangent. Invisible splats take the same path, because software
// devices walk both sides of a branch.
vec3 direction_backward(uint slot, bool is_visible, vec3 direction, vec3 d_color) {
    vec3 slope[16];
    sh_basis_gradient(SH_DEGREE, direction, slope);
    uint terms = (SH_DEGREE + 1) * (SH_DEGREE + 1);
    vec3 d_direction = vec3(0.0);
    [[unroll]] for (uint plane = 0; plane < (terms * 3 + 3) / 4; ++plane) {
        uint place = (GEOMETRY_PLANES + plane) * push.stride + slot;
        vec4 coefficients = vec4(0.0);
        if (is_visible) coefficients = params[place];
        [[unroll]] for (uint lane = 0; lane < 4; ++lane) {
            uint k = plane * 4 + lane;
            if (k < terms * 3) d_direction += slope[k / 3] * (coefficients[lane] * d_color[k % 3]);
        }
    }
    return d_direction;
}

// dL/d quaternion before normalisation, from dL/d rotation matrix (columns) at the unit quaternion.
vec4 quaternion_backward(vec4 unit, float q_length, mat3 d) {
    float w = unit.x, x = unit.y, y = unit.z, z = unit.w;
    vec4 g;
    g.x = 2.0 * (z * (d[0][1] - d[1][0]) + y * (d[2][0] - d[0][2]) + x * (d[1][2] - d[2][1]));
    g.y = 2.0 * (y * (d[0][1] + d[1][0]) + z * (d[0][2] + d[2][0]) + w * (d[1][2] - d[2][1]))
        - 4.0 * x * (d[1][1] + d[2][2]);
    g.z = 2.0 * (x * (d[0][1] + d[1][0]) + z * (d[1][2] + d[2][1]) + w * (d[2][0] - d[0][2]))
        - 4.0 * y * (d[0][0] + d[2][2]);
    g.w = 2.0 * (x * (d[0][2] + d[2][0]) + y * (d[1][2] + d[2][1]) + w * (d[0][1] - d[1][0]))
        - 4.0 * z * (d[0][0] + d[1][1]);
    return (g - unit * dot(unit, g)) / q_length;
}

void add_record(uint source, inout Sums sum, inout SurfelSums more, inout vec4 by_surface) {
    sum.shape += d_shape_from_source[source];
    sum.tone += d_tone_from_source[source];
    uint rest = source * REST_WIDTH;
    sum.rest += d_rest_from_source[rest++];
    if (TILTED) {
        [[unroll]] for (uint i = 0; i < REST_TILT; ++i) more.tilt[i] += d_rest_from_source[rest++];
    }
    if (SURFEL == SURFEL_ANY) {
        [[unroll]] for (uint i = 0; i < REST_SPOT; ++i) more.spot[i] += d_rest_from_source[rest++];
    }
    if (WITH_SURFACE != 0) {
        [[unroll]] for (uint i = 0; i < REST_SURFACE; ++i) by_surface[i] += d_rest_from_source[rest++];
    }
}

// Sums of a splat's records so far, in the place of its gradient.
Sums kept_sums(uint slot, out SurfelSums more, out vec4 by_surface) {
    vec4 rest = d_params[2 * push.stride + slot];
    more = SurfelSums(rest.yzw, d_params[3 * push.stride + slot].xy);
    by_surface = d_params[4 * push.stride + slot];
    return Sums(d_params[slot], d_params[push.stride + slot], rest.x);
}

void keep_sums(uint slot, Sums sum, SurfelSums more, vec4 by_surface) {
    d_params[slot] = sum.shape;
    d_params[push.stride + slot] = sum.tone;
    d_params[2 * push.stride + slot] = vec4(sum.rest, more.tilt);
    d_params[3 * push.stride + slot] = vec4(more.spot, 0.0, 0.0);
    d_params[4 * push.stride + slot] = by_surface;
}

// Adds a splat's records to a sum. All lanes of a workgroup call it.
void add_records(uint splat, uint tile_count, inout Sums sum, inout SurfelSums more, inout vec4 by_surface);

// A splat's records, summed; all lanes of a workgroup call it.
Sums sum_of_records(uint slot, uint splat, uint tile_count, out SurfelSums more, out vec4 by_surface) {
    Sums sum = Sums(vec4(0.0), vec4(0.0), 0.0);
    more = SurfelSums(vec3(0.0), vec2(0.0));
    by_surface = vec4(0.0);
    if (push.part >= PART_NEXT && tile_count != 0) sum = kept_sums(slot, more, by_surface);
    if (push.part != PART_END) add_records(splat, tile_count, sum, more, by_surface);
    return sum;
}

// dL/d mean in view space, from the Jacobian's rows (fx/z)(1, 0, -x/z) and (fy/z)(0, 1, -y/z) with gradients g_x and
// g_y in view space, and from the mean's pixel.
vec3 mean_view_backward(vec3 mean_view, Jacobian j, vec3 g_x, vec3 g_y, vec2 d_mean_pixel) {
    vec2 focal = view.focal;
    vec2 scale = focal / mean_view.z;
    vec3 d;
    d.z = -(scale.x * (g_x.x - j.slope.x * g_x.z) + scale.y * (g_y.y - j.slope.y * g_y.z)) / mean_view.z;
    // A clamped slope is a constant: no gradient through it, and the z-derivative above is then exact.
    vec2 d_slope = mix(vec2(0.0), -scale * vec2(g_x.z, g_y.z), j.inside) + focal * d_mean_pixel;
    d.xy = d_slope / mean_view.z;
    d.z -= dot(d_slope, mean_view.xy / mean_view.z) / mean_view.z;
    return d;
}

// Adds to dL/dV the gradient through the opacity's compensation, from dL/d ln(opacity): the logarithm is half of ln det
// without minus ln det with dilation, and the difference of their reciprocals has a form that does not cancel.
void compensation_backward(Footprint f, float d_log_opacity, inout vec3 d_v_x, inout vec3 d_v_y) {
    float det = dot(f.minors, f.minors);
    float apart = d_log_opacity * ((f.det - det) / f.det) / det;
    float outward = d_log_opacity * view.dilation / f.det;
    d_v_x += apart * cross(f.v_y, f.minors) - outward * f.v_x;
    d_v_y += apart * cross(f.minors, f.v_x) - outward * f.v_y;
}

// Completes the gradient of a surfel's footprint, and finds that by its tilt and normal. A surfel that is only a spot
// has none but that of its place.
FootprintGradient surfel_backward(uint splat, vec3 mean_view, vec3 normal_world, float along, Footprint f,
                                  SurfelSums more, vec3 d_normal, FootprintGradient d, out TiltGradient tilt) {
    tilt = TiltGradient(vec3(0.0), vec3(0.0));
    if (whiten_rg_from_splat[splat].x == SPOT_WHITEN) {
        return FootprintGradient(2.0 * more.spot, vec3(0.0), vec3(0.0));
    }
    vec3 normal = view.view_from_world * normal_world;
    vec2 slant = mean_view.z / along * normal.xy / view.focal;
    vec2 d_slant = filter_backward(view, f, slant, more.tilt.yz, d);
    tilt = tilt_backward(view, normal, mean_view, along, d_slant);
    if (WITH_SURFACE != 0) tilt.normal += toward_backward(normal, along, d_normal);
    vec2 drawn = filtered_tilt(slant, view.dilation, f.slope, WHITEN * whitening(f));
    d.mean_pixel += 2.0 * more.spot - drawn * more.tilt.x;
    return d;
}

// Adds the gradient of a visible splat's geometry; `scale` is before smoothing. Returns dL/d mean_pixel.
vec2 visible_backward(uint slot, uint splat, vec3 scale, Sums records, SurfelSums more, vec4 by_surface,
                      inout Gradient gradient, out ColorGradient by_color) {
    vec4 mean = params[slot];
    vec4 rotation = params[push.stride + slot];
    vec3 offset = mean.xyz - view.position;
    vec3 mean_view = view.view_from_world * offset;
    float q_length = quaternion_length(rotation);
    vec4 unit = rotation / q_length;
    mat3 axes = rotation_matrix(unit);
    Jacobian j = jacobian(view, mean_view);
    vec3 local_x = j.row_x * axes;
    vec3 local_y = j.row_y * axes;
    Smoothed s = smoothed(scale, params[2 * push.stride + slot].w);
    if (SURFEL != 0) flatten(s);
    Footprint f = footprint(local_x * s.scale, local_y * s.scale, view.dilation);
    float along = dot(axes[2], offset);
    if (SURFEL != 0) f = surfel_footprint(view, f.v_x, f.v_y, s.scale, mean_view.z, along);

    gradient.opacity_logit += records.shape.x * sigmoid(-mean.w);
    FootprintGradient d = footprint_backward(f, records);
    TiltGradient tilt = TiltGradient(vec3(0.0), vec3(0.0));
    PlaneGradient plane = PlaneGradient(mat3(0.0), vec3(0.0), vec3(0.0), vec3(0.0), vec2(0.0));
    if (SURFEL != 0) {
        d = surfel_backward(splat, mean_view, axes[2], along, f, more, by_surface.yzw, d, tilt);
    } else if (WITH_SURFACE != 0) {
        plane = plane_backward(view, axes, s.scale, offset, mean_view, more.tilt, by_surface.yzw);
        d.mean_pixel += plane.mean_pixel;
    }
    if (view.compensate != 0) compensation_backward(f, records.shape.x, d.v_x, d.v_y);
    // Smoothed variances are s^2 + sigma^2, and ln(opacity) contains half of ln(s^2 / (s^2 + sigma^2)) per axis.
    gradient.log_scale += (d.v_x * local_x + d.v_y * local_y) * s.scale * s.own + records.shape.x * s.added;
    if (SURFEL == 0 && WITH_SURFACE != 0) gradient.log_scale += plane.log_scale * s.own;
    vec3 d_local_x = d.v_x * s.scale;
    vec3 d_local_y = d.v_y * s.scale;
    // local = row * axes, component k = dot(row, axes[k]).
    mat3 d_axes = outerProduct(j.row_x, d_local_x) + outerProduct(j.row_y, d_local_y);
    if (SURFEL != 0) d_axes[2] += tilt.normal * view.view_from_world;
    if (SURFEL == 0 && WITH_SURFACE != 0) d_axes += plane.axes;
    gradient.quaternion += quaternion_backward(unit, q_length, d_axes);
    vec3 g_x = view.view_from_world * (axes * d_local_x);
    vec3 g_y = view.view_from_world * (axes * d_local_y);
    vec3 d_mean_view = mean_view_backward(mean_view, j, g_x, g_y, d.mean_pixel);
    if (SURFEL != 0) d_mean_view += tilt.mean;
    if (SURFEL == 0 && WITH_SURFACE != 0) d_mean_view += plane.mean_view;
    if (WITH_SURFACE != 0) d_mean_view.z += by_surface.x;
    gradient.mean += d_mean_view * view.view_from_world;
    if (SURFEL == 0 && WITH_SURFACE != 0) gradient.mean += plane.mean;

    vec3 color = vec3(whiten_rg_from_splat[splat].zw, blue_depth_from_splat[splat].x);
    by_color.is_visible = true;
    by_color.distance = vector_length(offset);
    by_color.direction = offset / by_color.distance;
    by_color.d_color = mix(vec3(0.0), vec3(records.tone.zw, records.rest), greaterThan(color, vec3(0.0)));
    return d.mean_pixel;
}

void main() {
    uint slot = global_index();
    bool is_active = slot < push.splat_count && counts[COUNT_FAILED] == 0;
    uint splat = slot;
    if (INDEXED != 0 && is_active) splat = splat_from_slot[slot];
    uint tile_count = is_active ? tile_count_from_splat[splat] : 0;
    if (push.banded != 0 && tile_count != 0 && emitted_from_splat[splat] == NOT_LISTED) {
        is_active = false;
        tile_count = 0;
    }
    SurfelSums more;
    vec4 by_surface;
    Sums records = sum_of_records(slot, splat, tile_count, more, by_surface);
    if (!is_active) return;
    if (push.part == PART_FIRST || push.part == PART_NEXT) {
        if (tile_count != 0 || push.part == PART_FIRST) keep_sums(slot, records, more, by_surface);
        return;
    }
    vec3 scale = exp(params[2 * push.stride + slot].xyz);
    if (SURFEL != 0) scale.z = 0.0;
    float opacity = sigmoid(params[slot].w);
    // A splat that is not finite is not drawn, and gets no gradient from penalties.
    bool sound = is_finite(params[slot].w) && is_finite(scale);

    Gradient gradient;
    gradient.mean = vec3(0.0);
    gradient.opacity_logit = sound ? push.opacity_penalty * opacity * sigmoid(-params[slot].w) : 0.0;
    gradient.quaternion = vec4(0.0);
    gradient.log_scale = sound ? (push.scale_penalty + push.size_penalty * scale) * scale : vec3(0.0);

    ColorGradient by_color = ColorGradient(false, vec3(0.0, 0.0, 1.0), 1.0, vec3(0.0));
    if (tile_count != 0) {
        vec2 d_mean_pixel = visible_backward(slot, splat, scale, records, more, by_surface, gradient, by_color);
        vec4 known = statistics[splat];
        // Half the image size turns pixels into normalised device coordinates.
        float pull = length(d_mean_pixel * 0.5 * vec2(view.size));
        if (is_finite(pull)) known.x += pull;
        known.y += 1.0;
        // The extent in the statistics is independent of the alpha threshold of drawing.
        Ellipse e = ellipse(ellipse_from_splat[splat], whiten_rg_from_splat[splat].xy, -LOG2_255);
        known.z = max(known.z, max(e.extent.x, e.extent.y));
        statistics[splat] = known;
    }
    vec3 d_direction = direction_backward(slot, by_color.is_visible, by_color.direction, by_color.d_color);
    vec3 along = by_color.direction * dot(by_color.direction, d_direction);
    if (by_color.is_visible) gradient.mean += (d_direction - along) / by_color.distance;
    d_params[slot] = vec4(gradient.mean, gradient.opacity_logit);
    d_params[push.stride + slot] = gradient.quaternion;
    d_params[2 * push.stride + slot] = vec4(gradient.log_scale, 0.0);
    d_params[D_COLOR_PLANE * push.stride + slot] = vec4(by_color.d_color, 0.0);
    d_params[DIRECTION_PLANE * push.stride + slot] = vec4(by_color.direction, 0.0);
}
