#version 460
#include "shared/prelude.glsl"
#include "shared/math.glsl"
#include "shared/random.glsl"

// MCMC's exploration: moves every mean by noise with the splat's own covariance, less with higher opacity (3DGS as
// Markov Chain Monte Carlo, equation 9).
//
// One invocation per splat. Random numbers are a function of (seed, step, splat) alone.

layout(constant_id = 0) const uint WORKGROUP = 64;
// Not 0: surfels, which also move a little out of their planes.
layout(constant_id = 1) const uint SURFEL = 0;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer Counts { uint counts[]; };
layout(set = 0, binding = 1, scalar) buffer ParamsBlock { vec4 params[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Index { uint splat_from_slot[]; };

layout(push_constant, scalar) uniform Push {
    uint first_splat; // index of the first splat of this dispatch, for the random numbers
    uint splat_count; // splats of this dispatch
    uint stride;      // elements between two planes
    uint seed;
    uint step;
    float amplitude;  // noise scale times the learning rate of the means
    uint indexed;     // not 0: slots are not in splat order; the index gives each slot's splat
} push;

// Standard deviation of a surfel's noise along its normal, as a share of its smaller scale: with none it could never
// leave its plane.
const float SURFEL_NOISE = 0.1;

// Uniform in (0, 1): never 0, as its logarithm is infinite.
float uniform_of(uint splat, uint draw) {
    uint word = scramble(scramble(scramble(scramble(push.seed) ^ push.step) ^ splat) ^ draw);
    return (float(word >> 9) + 0.5) * (1.0 / 8388608.0);
}

vec3 normals_of(uint splat) {
    const float TURN = 6.283185307179586;
    float first = sqrt(-2.0 * log(uniform_of(splat, 0)));
    float angle = TURN * uniform_of(splat, 1);
    float second = sqrt(-2.0 * log(uniform_of(splat, 2)));
    return vec3(first * cos(angle), first * sin(angle), second * cos(TURN * uniform_of(splat, 3)));
}

void main() {
    uint slot = global_index();
    if (slot >= push.splat_count || counts[COUNT_FAILED] != 0) return;
    uint splat = push.first_splat + slot;
    if (push.indexed != 0) splat = splat_from_slot[slot];
    vec4 mean = params[slot];
    vec4 rotation = params[push.stride + slot];
    vec3 scale = exp(params[2 * push.stride + slot].xyz);
    if (SURFEL != 0) scale.z = SURFEL_NOISE * min(scale.x, scale.y);
    mat3 axes = rotation_matrix(rotation / quaternion_length(rotation));
    float weight = sigmoid(100.0 * (0.005 - sigmoid(mean.w))) * push.amplitude;
    vec3 local = (normals_of(splat) * axes) * scale * scale;
    mean.xyz += axes * local * weight;
    if (is_finite(mean)) params[slot] = mean;
}
