// Splats on their way through a workgroup: every lane fetches one, and all lanes see each of them in turn.
// A load costs a lane as much whether the others load the same or not, so that fetching one each divides
// the loads of a splat by the number of lanes.

struct Staged {
    vec4 shape;
    vec4 tone;
    vec2 rest;
};

// The lane's number among those that stage.
uint stage_lane();
// Offers this lane's splat to the others. All lanes call it.
void stage(Staged mine);
// The splat that a lane has staged; `lane` is the same in all lanes.
Staged staged_by(uint lane);

// Makes a splat count nowhere: what pads the last batch.
void hide(inout Staged splat) {
    splat.shape.w = -1e30;
}
