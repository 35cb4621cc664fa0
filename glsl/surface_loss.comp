#version 460
#include "shared/prelude.glsl"

// Gradient of the terms of geometry by a frame's surface: of the normals' consistency with the depths, and of the
// spread of depths in a pixel.
//
// One workgroup per tile, in three sweeps: depths of the tile and of two pixels around it; the term of each pixel, and
// of those one pixel around the tile; the gradient of each pixel's depth, which enters the terms of its four
// neighbours. Depths are sums of weight * z over the coverage; where that is below 1/2 there is none. At a pixel whose
// four neighbours have depths, too, no farther from its own than SLOPE_LIMIT footprints, the normal of the depths is
// that of the vectors from neighbour to neighbour:
//   consistency: coverage * (1 - normal . normal of the depths), spread: coverage * variance of ln z,
// the coverage a constant factor.

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

// Pixels along a side of a tile's terms, and of their depths.
const uint TERMS = SURFACE_TILE + 2;
const uint DEPTHS = SURFACE_TILE + 4;

// 0 where there is none.
shared float depths[DEPTHS * DEPTHS];
// Gradient of each pixel's term by the depths of its neighbours.
shared float by_upper[TERMS * TERMS];
shared float by_lower[TERMS * TERMS];
shared float by_left[TERMS * TERMS];
shared float by_right[TERMS * TERMS];

// The view's, cached: a buffer load costs as much as several arithmetic operations.
uint width;
uint height;
vec2 focal;
vec2 center;

bool is_counted(ivec2 at) {
    return uint(at.x) < width && uint(at.y) >= push.counted.x && uint(at.y) < push.counted.y;
}

float coverage_of(uint pixel) {
    return 1.0 - image[3 * width * height + pixel];
}

// `at` may be outside the image: above or left of it, its coordinates wrap to large unsigned numbers.
float depth_of(uvec2 at) {
    if (at.x >= width || at.y >= height) return 0.0;
    uint pixel = at.y * width + at.x;
    float coverage = coverage_of(pixel);
    return coverage >= 0.5 ? surface[SURFACE_DEPTH * width * height + pixel] / coverage : 0.0;
}

// Gradient of the term of a pixel.
struct Consistency {
    vec3 normal;  // by the sum of normals
    vec4 depths;  // by the depths of the upper, lower, left and right neighbour
};

// The term of the pixel at `at`, whose depth is the one at `place`.
Consistency consistency(ivec2 at, uint place) {
    Consistency none = Consistency(vec3(0.0), vec4(0.0));
    float z = depths[place];
    vec4 around = vec4(depths[place - DEPTHS], depths[place + DEPTHS], depths[place - 1], depths[place + 1]);
    if (!(z > 0.0 && min(min(around.x, around.y), min(around.z, around.w)) > 0.0)) return none;
    vec4 steps = abs(around - z) * focal.yyxx;
    if (!(max(max(steps.x, steps.y), max(steps.z, steps.w)) <= SLOPE_LIMIT * z)) return none;
    uint pixels = width * height;
    uint pixel = uint(at.y) * width + uint(at.x);
    vec3 sum = vec3(surface[SURFACE_NORMAL * pixels + pixel], surface[(SURFACE_NORMAL + 1) * pixels + pixel],
                    surface[(SURFACE_NORMAL + 2) * pixels + pixel]);
    float coverage = coverage_of(pixel);
    float size = length(sum);
    vec3 ray = vec3((vec2(at) - center) / focal, 1.0);
    vec3 upper = vec3(ray.x, ray.y - 1.0 / focal.y, 1.0);
    vec3 lower = vec3(ray.x, ray.y + 1.0 / focal.y, 1.0);
    vec3 left = vec3(ray.x - 1.0 / focal.x, ray.y, 1.0);
    vec3 right = vec3(ray.x + 1.0 / focal.x, ray.y, 1.0);
    // In units of the depth, which the normal does not depend on.
    vec3 down = (around.y * lower - around.x * upper) / z;
    vec3 across = (around.w * right - around.z * left) / z;
    vec3 flat_normal = cross(down, across);
    float area = length(flat_normal);
    if (!(size >= NORMAL_MIN * coverage && area > 0.0)) return none;
    vec3 normal = sum / size;
    flat_normal /= area;
    float weight = push.normal_scale * coverage;
    float cosine = dot(normal, flat_normal);
    vec3 d_flat = (-weight / area) * (normal - flat_normal * cosine);
    vec3 d_down = cross(across, d_flat) / z;
    vec3 d_across = cross(d_flat, down) / z;
    return Consistency((-weight / size) * (flat_normal - normal * cosine),
                       vec4(-dot(upper, d_down), dot(lower, d_down), -dot(left, d_across), dot(right, d_across)));
}

void store(uint plane, uint pixel, float value) {
    d_image[plane * width * height + pixel] = value;
}

// Variance of ln z, and depth at its mean: all that compositing backwards needs of the spread.
void store_spread(uint pixel, float coverage) {
    uint pixels = width * height;
    float first = surface[SURFACE_FIRST * pixels + pixel];
    bool has = coverage >= 0.5 && first > 0.0;
    float mean = has ? surface[SURFACE_LOG * pixels + pixel] / coverage : 0.0;
    float square = has ? surface[SURFACE_LOG_SQUARE * pixels + pixel] / coverage : 0.0;
    // The coverage of the pixel, its weight, and that of each splat, its share of the coverage, cancel.
    store(D_SPREAD, pixel, has ? push.spread_scale : 0.0);
    store(SPREAD_CENTER, pixel, has ? first * exp(mean) : 1.0);
    store(SPREAD_OWN, pixel, max(square - mean * mean, 0.0));
}

// Rows that do not count.
void store_nothing(uint pixel) {
    [[unroll]] for (uint axis = 0; axis < 3; ++axis) store(D_NORMAL + axis, pixel, 0.0);
    store(D_COVERAGE, pixel, 0.0);
    store(D_DEPTH, pixel, 0.0);
    if (WITH_SPREAD == 0) return;
    store(D_SPREAD, pixel, 0.0);
    store(SPREAD_CENTER, pixel, 1.0);
    store(SPREAD_OWN, pixel, 0.0);
}

void differentiate(ivec2 corner, uint term) {
    ivec2 place = ivec2(term % TERMS, term / TERMS);
    ivec2 at = corner + place - 1;
    Consistency c = consistency(at, (uint(place.y) + 1) * DEPTHS + uint(place.x) + 1);
    by_upper[term] = c.depths.x;
    by_lower[term] = c.depths.y;
    by_left[term] = c.depths.z;
    by_right[term] = c.depths.w;
    ivec2 inner = place - 1;
    if (min(inner.x, inner.y) < 0 || max(inner.x, inner.y) >= int(SURFACE_TILE) || !is_counted(at)) return;
    uint pixel = uint(at.y) * width + uint(at.x);
    [[unroll]] for (uint axis = 0; axis < 3; ++axis) store(D_NORMAL + axis, pixel, c.normal[axis]);
}

void finish(ivec2 corner, uint inner) {
    uvec2 place = uvec2(inner % SURFACE_TILE, inner / SURFACE_TILE);
    ivec2 at = corner + ivec2(place);
    if (uint(at.x) >= width || uint(at.y) >= height) return;
    uint pixel = uint(at.y) * width + uint(at.x);
    if (!is_counted(at)) {
        store_nothing(pixel);
        return;
    }
    uint term = (place.y + 1) * TERMS + place.x + 1;
    float depth = depths[(place.y + 2) * DEPTHS + place.x + 2];
    float d_depth = by_lower[term - TERMS] + by_upper[term + TERMS] + by_right[term - 1] + by_left[term + 1];
    float coverage = coverage_of(pixel);
    d_depth = depth > 0.0 ? d_depth / coverage : 0.0;
    store(D_COVERAGE, pixel, -d_depth * depth);
    store(D_DEPTH, pixel, d_depth);
    if (WITH_SPREAD != 0) store_spread(pixel, coverage);
}

void main() {
    width = view.size.x;
    height = view.size.y;
    focal = view.focal;
    center = view.center - 0.5 - vec2(0, view.first_row);
    uint columns = (width + SURFACE_TILE - 1) / SURFACE_TILE;
    uint tile = group_index();
    if (tile >= columns * ((height + SURFACE_TILE - 1) / SURFACE_TILE)) return;
    ivec2 corner = ivec2(tile % columns, tile / columns) * int(SURFACE_TILE);
    uint lane = gl_LocalInvocationID.x;
    uint i = lane;
    do {
        if (i < DEPTHS * DEPTHS) depths[i] = depth_of(uvec2(corner + ivec2(i % DEPTHS, i / DEPTHS) - 2));
        i += WORKGROUP;
    } while (i < DEPTHS * DEPTHS);
    barrier();
    i = lane;
    do {
        if (i < TERMS * TERMS) differentiate(corner, i);
        i += WORKGROUP;
    } while (i < TERMS * TERMS);
    barrier();
    i = lane;
    do {
        if (i < SURFACE_TILE * SURFACE_TILE) finish(corner, i);
        i += WORKGROUP;
    } while (i < SURFACE_TILE * SURFACE_TILE);
}
