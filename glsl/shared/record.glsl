// Length of a gradient record beside shape and tone, of SURFEL and WITH_SURFACE: blue, then the sums of tilts, of
// spots, and of depths and normals, as far as there are any.

const bool TILTED = SURFEL != 0 || WITH_SURFACE != 0;
const uint REST_WIDTH = 1 + (TILTED ? REST_TILT : 0) + (SURFEL == SURFEL_ANY ? REST_SPOT : 0)
    + (WITH_SURFACE != 0 ? REST_SURFACE : 0);
