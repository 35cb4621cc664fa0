// Structs of several includes; those in buffers are shared with the host.

// Camera and other parameters of one frame.
struct View {
    mat3 view_from_world;
    vec3 position;     // camera centre, world units
    vec2 focal;        // pixels
    vec2 center;       // principal point, pixels
    vec4 limit;        // x_min, x_max, y_min, y_max of x/z and y/z inside the Jacobian
    uvec2 size;        // pixels, of the drawn rows
    uvec2 tiles;       // tiles per row and column, of the drawn rows
    float near_plane;  // world units along z
    float dilation;    // added to the screen covariance, px^2
    uint compensate;   // not 0: opacities compensate the dilation (Mip-Splatting, section 5.2)
    vec3 background;
    uint dropout;      // share of dropped splats, times 2^32; 0: none
    uint dropout_key;  // of the step's random numbers
    uint first_row;    // first drawn row of the picture, a multiple of TILE_HEIGHT
};

// A projected splat, the input of compositing, is stored in three arrays:
//   vec4 shape  mean.xy in pixels, slope b/a, log2 of the opacity
//   vec4 tone   whitening factors of x and of y (times WHITEN), red, green
//   vec2 rest   blue, depth

// Arguments of an indirect dispatch.
struct DispatchArgs {
    uint x;
    uint y;
    uint z;
};

// A tile, and the column of pixels of this lane.
struct Tile {
    uvec2 corner;  // the tile's first pixel in the picture
    uint x;        // this lane's column, from the corner
    uint y;        // this lane's first row, from the corner
};
