// Finite tests, lengths and rotations.

bool is_finite(float x) {
    // Integer arithmetic: a compiler may assume that floats are never NaN.
    return (floatBitsToUint(x) & 0x7f800000u) != 0x7f800000u;
}

bool is_finite(vec3 v) {
    return is_finite(v.x) && is_finite(v.y) && is_finite(v.z);
}

bool is_finite(vec4 v) {
    return is_finite(v.xyz) && is_finite(v.w);
}

// 1 / (1 + exp(-u)) without overflow at either end.
float sigmoid(float u) {
    float e = exp(-abs(u));
    return (u >= 0.0 ? 1.0 : e) / (1.0 + e);
}

// Length of a quaternion, safe over the whole range of floats.
float quaternion_length(vec4 q) {
    float m = max(max(abs(q.x), abs(q.y)), max(abs(q.z), abs(q.w)));
    return m > 0.0 ? m * length(q / m) : 0.0;
}

// Length of a vector, safe over the whole range of floats. The scale is a power of two, so that the result equals the
// plain length bit for bit unless that overflows or underflows.
float vector_length(vec3 v) {
    float m = max(max(abs(v.x), abs(v.y)), abs(v.z));
    float unit = uintBitsToFloat(floatBitsToUint(m) & 0x7f800000u);
    return unit > 0.0 ? unit * length(v / unit) : 0.0;
}

// Rotation matrix of a unit quaternion (w, x, y, z); columns are the local axes in the world.
mat3 rotation_matrix(vec4 q) {
    float w = q.x, x = q.y, y = q.z, z = q.w;
    return mat3(
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y),
        2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x),
        2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y));
}
