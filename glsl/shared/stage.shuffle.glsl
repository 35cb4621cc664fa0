// Staging by shuffles, for workgroups in one subgroup.

Staged held;
vec3 held_plane;

uint stage_lane() {
    return gl_SubgroupInvocationID;
}

void stage(Staged mine) {
    held = mine;
}

vec4 shuffled(vec4 v, uint lane) {
    return vec4(subgroupShuffle(v.x, lane), subgroupShuffle(v.y, lane), subgroupShuffle(v.z, lane),
                subgroupShuffle(v.w, lane));
}

Staged staged_by(uint lane) {
    vec2 rest = vec2(subgroupShuffle(held.rest.x, lane), subgroupShuffle(held.rest.y, lane));
    return Staged(shuffled(held.shape, lane), shuffled(held.tone, lane), rest);
}

void stage_plane(vec3 mine) {
    held_plane = mine;
}

vec3 staged_plane_by(uint lane) {
    return vec3(subgroupShuffle(held_plane.x, lane), subgroupShuffle(held_plane.y, lane),
                subgroupShuffle(held_plane.z, lane));
}
