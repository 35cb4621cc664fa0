// Staging through shared memory, for any subgroup size.

shared vec4 staged_shape[WORKGROUP];
shared vec4 staged_tone[WORKGROUP];
shared vec2 staged_rest[WORKGROUP];
shared vec3 staged_plane[WORKGROUP];

uint stage_lane() {
    return gl_LocalInvocationID.x;
}

void stage(Staged mine) {
    // The previous batch may still be read.
    barrier();
    staged_shape[gl_LocalInvocationID.x] = mine.shape;
    staged_tone[gl_LocalInvocationID.x] = mine.tone;
    staged_rest[gl_LocalInvocationID.x] = mine.rest;
    barrier();
}

Staged staged_by(uint lane) {
    return Staged(staged_shape[lane], staged_tone[lane], staged_rest[lane]);
}

void stage_plane(vec3 mine) {
    barrier();
    staged_plane[gl_LocalInvocationID.x] = mine;
    barrier();
}

vec3 staged_plane_by(uint lane) {
    return staged_plane[lane];
}
