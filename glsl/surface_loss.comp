#version 460
#include "shared/prelude.glsl"

// Gradient of the terms of geometry by a frame's surface: of the normals' consistency with the depths, and of the
// spread of depths in a pixel.
//
// One invocation per pixel. Depths are sums of weight * z over the coverage; where that is below 1/2 there is none. At
// a pixel whose four neighbours have depths, too, no farther from its own than SLOPE_LIMIT footprints, the normal of
// the depths is that of the vectors from neighbour to neighbour:
//   consistency: coverage * (1 - normal . normal of the depths), spread: coverage * variance of ln z,
// the coverage a constant factor. A pixel's depth enters the terms of its four neighbours, which are computed again
// here: nothing is added atomically.

layout(constant_id = 0) const uint WORKGROUP = 64;
// Not 0: the spread as well.
layout(constant_id = 1) const uint WITH_SPREAD = 0;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer ViewBlock { View view; };
layout(set = 0, binding = 1, scalar) readonly buffer Image { float image[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Surface { float surface[]; };
layout(set = 0, binding = 3, scalar) buffer ImageGradient { float d_image[]; };

layout(push_constant, scalar) uniform Push {
    float normal_scale;  // weight of the consistency of a pixel
    float spread_scale;  // weight of the spread of a pixel
    uvec2 counted;       // drawn rows that count, and the end of those; the gradient of others is 0
} push;

// Largest step of depth to a neighbour, in footprints (depth / focal length): surfaces at up to 80.5 degrees.
const float SLOPE_LIMIT = 6.0;
// Smallest length of the sum of normals over the coverage: shorter ones have hardly a direction.
const float NORMAL_MIN = 0.1;

// Depths of the pixels within two steps, 0 where there are none: [y][x] from the upper left.
float depths[5][5];

float coverage_of(ivec2 at) {
    return 1.0 - image[3 * view.size.x * view.size.y + uint(at.y) * view.size.x + uint(at.x)];
}

float depth_of(ivec2 at) {
    if (any(lessThan(at, ivec2(0))) || any(greaterThanEqual(at, ivec2(view.size)))) return 0.0;
    float coverage = coverage_of(at);
    if (!(coverage >= 0.5)) return 0.0;
    return surface[SURFACE_DEPTH * view.size.x * view.size.y + uint(at.y) * view.size.x + uint(at.x)] / coverage;
}

vec3 ray_of(ivec2 at) {
    return vec3((vec2(at + ivec2(0, view.first_row)) + 0.5 - view.center) / view.focal, 1.0);
}

// Gradients of the term of the pixel `c` steps from this one.
struct Consistency {
    vec3 normal;     // by the sum of normals
    vec3 down;       // by the vector from the upper to the lower neighbour
    vec3 across;     // by that from the left to the right one
};

Consistency consistency(ivec2 pixel, ivec2 c) {
    Consistency none = Consistency(vec3(0.0), vec3(0.0), vec3(0.0));
    ivec2 at = pixel + c;
    ivec2 o = c + 2;
    float z = depths[o.y][o.x];
    vec4 around = vec4(depths[o.y - 1][o.x], depths[o.y + 1][o.x], depths[o.y][o.x - 1], depths[o.y][o.x + 1]);
    if (!(z > 0.0 && min(min(around.x, around.y), min(around.z, around.w)) > 0.0)) return none;
    vec4 steps = abs(around - z) * view.focal.yyxx;
    if (!(max(max(steps.x, steps.y), max(steps.z, steps.w)) <= SLOPE_LIMIT * z)) return none;
    uint pixels = view.size.x * view.size.y;
    uint index = uint(at.y) * view.size.x + uint(at.x);
    vec3 sum = vec3(surface[SURFACE_NORMAL * pixels + index], surface[(SURFACE_NORMAL + 1) * pixels + index],
                    surface[(SURFACE_NORMAL + 2) * pixels + index]);
    float coverage = coverage_of(at);
    float size = length(sum);
    // In units of the depth, which the normal does not depend on.
    vec3 down = (around.y * ray_of(at + ivec2(0, 1)) - around.x * ray_of(at - ivec2(0, 1))) / z;
    vec3 across = (around.w * ray_of(at + ivec2(1, 0)) - around.z * ray_of(at - ivec2(1, 0))) / z;
    vec3 flat_normal = cross(down, across);
    float area = length(flat_normal);
    if (!(size >= NORMAL_MIN * coverage && area > 0.0)) return none;
    vec3 normal = sum / size;
    flat_normal /= area;
    float weight = push.normal_scale * coverage;
    float cosine = dot(normal, flat_normal);
    vec3 d_flat = (-weight / area) * (normal - flat_normal * cosine);
    return Consistency((-weight / size) * (flat_normal - normal * cosine), cross(across, d_flat) / z,
                       cross(d_flat, down) / z);
}

void store(uint plane, uint pixel, float value) {
    d_image[plane * view.size.x * view.size.y + pixel] = value;
}

// Variance of ln z, and depth at its mean: all that compositing backwards needs of the spread.
void store_spread(uint pixel, float coverage) {
    uint pixels = view.size.x * view.size.y;
    float first = surface[SURFACE_FIRST * pixels + pixel];
    bool has = coverage >= 0.5 && first > 0.0;
    float mean = has ? surface[SURFACE_LOG * pixels + pixel] / coverage : 0.0;
    float square = has ? surface[SURFACE_LOG_SQUARE * pixels + pixel] / coverage : 0.0;
    // The coverage of the pixel, its weight, and that of each splat, its share of the coverage, cancel.
    store(D_SPREAD, pixel, has ? push.spread_scale : 0.0);
    store(SPREAD_CENTER, pixel, has ? first * exp(mean) : 1.0);
    store(SPREAD_OWN, pixel, max(square - mean * mean, 0.0));
}

void store_nothing(uint pixel) {
    store(D_COVERAGE, pixel, 0.0);
    store(D_DEPTH, pixel, 0.0);
    [[unroll]] for (uint axis = 0; axis < 3; ++axis) store(D_NORMAL + axis, pixel, 0.0);
    if (WITH_SPREAD == 0) return;
    store(D_SPREAD, pixel, 0.0);
    store(SPREAD_CENTER, pixel, 1.0);
    store(SPREAD_OWN, pixel, 0.0);
}

void main() {
    uint index = global_index();
    if (index >= view.size.x * view.size.y) return;
    ivec2 pixel = ivec2(index % view.size.x, index / view.size.x);
    if (uint(pixel.y) < push.counted.x || uint(pixel.y) >= push.counted.y) {
        store_nothing(index);
        return;
    }
    [[unroll]] for (int y = -2; y <= 2; ++y) {
        [[unroll]] for (int x = -2; x <= 2; ++x) {
            depths[y + 2][x + 2] = abs(x) + abs(y) <= 2 ? depth_of(pixel + ivec2(x, y)) : 0.0;
        }
    }
    Consistency here = consistency(pixel, ivec2(0));
    vec3 d_place = consistency(pixel, ivec2(0, -1)).down - consistency(pixel, ivec2(0, 1)).down
        + consistency(pixel, ivec2(-1, 0)).across - consistency(pixel, ivec2(1, 0)).across;
    float depth = depths[2][2];
    float coverage = coverage_of(pixel);
    float d_depth = depth > 0.0 ? dot(ray_of(pixel), d_place) / coverage : 0.0;
    store(D_COVERAGE, index, -d_depth * depth);
    store(D_DEPTH, index, d_depth);
    [[unroll]] for (uint axis = 0; axis < 3; ++axis) store(D_NORMAL + axis, index, here.normal[axis]);
    if (WITH_SPREAD != 0) store_spread(index, coverage);
}
