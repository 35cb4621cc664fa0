// Exchange of splats in a workgroup: every lane fetches one, and all lanes process each of them in turn. A load costs a
// lane the same even if others load the same address, so this divides the loads of a splat by the number of lanes.

struct Staged {
    vec4 shape;
    vec4 tone;
    vec2 rest;
};

// Index of the lane among those that stage.
uint stage_lane();
// Shares this lane's splat with the others. All lanes call it.
void stage(Staged mine);
// The splat staged by a lane; `lane` is the same in all lanes.
Staged staged_by(uint lane);

// The same for the splat's plane, in frames with surfaces.
void stage_plane(vec3 mine);
vec3 staged_plane_by(uint lane);

// Makes a splat count nowhere, to pad the last batch.
void hide(inout Staged splat) {
    splat.shape.w = -1e30;
}
