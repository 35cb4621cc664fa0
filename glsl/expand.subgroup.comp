#version 460
#extension GL_KHR_shader_subgroup_ballot : require
#extension GL_KHR_shader_subgroup_shuffle : require
#include "shared/prelude.glsl"

// Lists one intersection for every tile that a visible splat of the current band touches, in depth order.
//
// Each invocation lists those of its splat, if they are few; those of a splat with many tiles are listed by the whole
// subgroup, row by row, so that it does not keep the others waiting. The workgroup consists of full subgroups.

#include "expand.glsl"

// Most intersections of a splat that its invocation lists by itself.
const uint OWN_TILES = 256;

void expand_by_all(SplatIsects s) {
    float depth = depth_of_splat(s.splat);
    ivec2 rows;
    Cover cover = cover_of_splat(s.splat, depth, rows);
    uint next = s.begin;
    int lane = int(gl_SubgroupInvocationID);
    for (int row = rows.x; row <= rows.y; ++row) {
        ivec2 columns = columns_of(cover, row);
        for (int first = columns.x; first <= columns.y && next < s.end; first += int(gl_SubgroupSize)) {
            int column = first + lane;
            uint tile = first_tile_of(row) + uint(min(column, columns.y));
            uvec4 listed = subgroupBallot(column <= columns.y && shows(depth, tile));
            uint place = next + subgroupBallotExclusiveBitCount(listed);
            if (subgroupInverseBallot(listed) && place < s.end) list(place, tile, s.splat);
            next += subgroupBallotBitCount(listed);
        }
    }
    for (uint i = next + uint(lane); i < s.end; i += gl_SubgroupSize) list(i, view.tiles.x * view.tiles.y, s.splat);
}

void main() {
    uint rank = counts[COUNT_BAND_BEGIN] + global_index();
    SplatIsects own = SplatIsects(0, 0, 0);
    if (rank < counts[COUNT_BAND_END]) own = isects_of(rank);
    bool alone = own.end - own.begin <= OWN_TILES;
    if (alone && own.begin < own.end) expand_alone(own);
    uvec4 waiting = subgroupBallot(!alone);
    while (any(notEqual(waiting, uvec4(0)))) {
        uint lane = subgroupBallotFindLSB(waiting);
        expand_by_all(SplatIsects(subgroupShuffle(own.splat, lane), subgroupShuffle(own.begin, lane),
                            subgroupShuffle(own.end, lane)));
        waiting &= ~subgroupBallot(gl_SubgroupInvocationID == lane);
    }
}
