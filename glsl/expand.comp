#version 460
#include "shared/prelude.glsl"

// Lists one intersection for every tile that a visible splat of the current band touches, in depth order.
//
// Each invocation lists those of its splat.

#include "expand.glsl"

void main() {
    uint rank = counts[COUNT_BAND_BEGIN] + global_index();
    if (rank < counts[COUNT_BAND_END]) expand_alone(isects_of(rank));
}
