#include "shared/math.glsl"
#include "shared/primitive.glsl"
#include "shared/plane.glsl"
#include "shared/surfel.glsl"

// Intersections of the visible splats of the current band with tiles, in depth order; included by `expand.comp` and its
// variant, which say how many lanes list those of a splat.
//
// One invocation per such splat, nearest first; a splat's intersections are contiguous. The count bounds the writes,
// and slots left over by rounding go to no tile.

layout(constant_id = 0) const uint WORKGROUP = 64;
// Log2 of the least alpha drawn; that of 1/255 (3DGS paper, appendix C).
layout(constant_id = 1) const float LOG2_ALPHA_MIN = -LOG2_255;
// Not 0: tiles by the rule of the 3DGS code.
layout(constant_id = 2) const uint INRIA = 0;
// Not 0: only tiles whose limit of depth is beyond the splat are listed, as counted by project.
layout(constant_id = 3) const uint WITH_LIMIT = 0;
// Not 0: surfels.
layout(constant_id = 4) const uint SURFEL = 0;
layout(local_size_x_id = 0) in;

layout(set = 0, binding = 0, scalar) readonly buffer ViewBlock { View view; };
layout(set = 0, binding = 1, scalar) readonly buffer Counts { uint counts[]; };
layout(set = 0, binding = 2, scalar) readonly buffer Ranks { uint splat_from_rank[]; };
layout(set = 0, binding = 3, scalar) readonly buffer Offsets { uint isect_from_rank[]; };
layout(set = 0, binding = 4, scalar) readonly buffer TileCounts { uint tile_count_from_splat[]; };
layout(set = 0, binding = 5, scalar) readonly buffer Shapes { vec4 ellipse_from_splat[]; };
layout(set = 0, binding = 6, scalar) readonly buffer ColorProducts { vec4 whiten_rg_from_splat[]; };
layout(set = 0, binding = 7, scalar) writeonly buffer Tiles { uint tile_from_isect[]; };
layout(set = 0, binding = 8, scalar) writeonly buffer Sources { uint emitted_from_isect[]; };
layout(set = 0, binding = 9, scalar) writeonly buffer Owners { uint splat_from_emitted[]; };
layout(set = 0, binding = 10, scalar) writeonly buffer Begins { uint emitted_from_splat[]; };
layout(set = 0, binding = 11, scalar) readonly buffer Rests { vec2 blue_depth_from_splat[]; };
layout(set = 0, binding = 12, scalar) readonly buffer TileLimits { float limit_from_tile[]; };
layout(set = 0, binding = 13, scalar) readonly buffer Planes { vec3 plane_from_splat[]; };

#include "shared/cover.glsl"

void list(uint isect, uint tile, uint splat) {
    tile_from_isect[isect] = tile;
    emitted_from_isect[isect] = isect;
    splat_from_emitted[isect] = splat;
}

// True if a splat of this depth may show in the tile.
bool shows(float depth, uint tile) {
    return WITH_LIMIT == 0 || depth < limit_from_tile[tile];
}

// A splat, and first and end of its intersections.
struct SplatIsects {
    uint splat;
    uint begin;
    uint end;
};

// Also stores the first, for the sums by splat.
SplatIsects isects_of(uint rank) {
    SplatIsects s;
    s.splat = splat_from_rank[rank];
    s.begin = isect_from_rank[rank] - counts[COUNT_BAND_BASE];
    s.end = s.begin + tile_count_from_splat[s.splat];
    emitted_from_splat[s.splat] = s.begin;
    return s;
}

float depth_of_splat(uint splat) {
    return WITH_LIMIT != 0 || SURFEL != 0 ? blue_depth_from_splat[splat].y : 0.0;
}

Cover cover_of_splat(uint splat, float depth, out ivec2 rows) {
    vec3 plane = vec3(0.0);
    if (SURFEL != 0) plane = plane_from_splat[splat];
    return cover_of(ellipse_from_splat[splat], whiten_rg_from_splat[splat].xy, plane, depth, rows);
}

uint first_tile_of(int row) {
    return (uint(row) - view.first_row / TILE_HEIGHT) * view.tiles.x;
}

// Lists the intersections of a splat by one invocation.
void expand_alone(SplatIsects s) {
    float depth = depth_of_splat(s.splat);
    ivec2 rows;
    Cover cover = cover_of_splat(s.splat, depth, rows);
    uint next = s.begin;
    for (int row = rows.x; row <= rows.y; ++row) {
        ivec2 columns = columns_of(cover, row);
        uint begin_of_row = first_tile_of(row);
        // Two per iteration: llvmpipe leaves loops after 65,535 iterations, and the largest image that it binds has
        // 65,536 tiles.
        for (int column = columns.x; column <= columns.y && next < s.end; column += 2) {
            uint tile = begin_of_row + uint(column);
            if (shows(depth, tile)) list(next++, tile, s.splat);
            if (column < columns.y && next < s.end && shows(depth, tile + 1)) list(next++, tile + 1, s.splat);
        }
    }
    for (; next < s.end; ++next) list(next, view.tiles.x * view.tiles.y, s.splat);
}
