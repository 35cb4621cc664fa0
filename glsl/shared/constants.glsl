// Constants shared by host and shaders; the build exports them to Rust.

// Tile size in pixels. One workgroup composites one tile; a lane owns a piece of one column.
const uint TILE_WIDTH = 8;
const uint TILE_HEIGHT = 16;
const uint TILE_PIXELS = 128;

// Width and height of a tile of the compositing baselines, pixels.
const uint BASELINE_TILE = 16;

// Tile of the loss in pixels. Tall, because each row of a tile's halo costs as much as one of the tile; the height is
// limited by the shared memory of every device.
const uint LOSS_TILE_WIDTH = 16;
const uint LOSS_TILE_HEIGHT = 48;

// Width and height of a tile of the terms of geometry, pixels.
const uint SURFACE_TILE = 16;

// Kinds of a kernel's splats: 3D Gaussians, surfels, and surfels of mip mode alone, which are never spots.
const uint SURFEL_NONE = 0;
const uint SURFEL_ANY = 1;
const uint SURFEL_MIP = 2;

// Pixels that a workgroup adds up for the gains of a photograph.
const uint EXPOSURE_PIXELS = 1024;

// Planes of vec4 before the spherical harmonics: mean + opacity, quaternion, log-scale + smoothing filter.
const uint GEOMETRY_PLANES = 3;
// The same with all but means as halves: mean; quaternion, log-scale and opacity.
const uint HALF_GEOMETRY_PLANES = 2;

// Planes of vec4 of a splat's gradient: those of its geometry, dL/d colour, and the direction from the camera, of which
// the gradient of the harmonics is the product.
const uint D_COLOR_PLANE = 3;
const uint DIRECTION_PLANE = 4;
const uint GRADIENT_PLANES = 5;

// Most steps whose gradients of colours wait for one update of the harmonics.
const uint COLOR_STEPS = 4;

// Parts of a picture whose records are summed one after the other: all at once, the first, a further one, and none, for
// the gradient from the sums.
const uint PART_ALL = 0;
const uint PART_FIRST = 1;
const uint PART_NEXT = 2;
const uint PART_END = 3;

// Largest alpha, below 1 so that transmittance stays positive: 1 - 2^-16.
const float ALPHA_MAX = 0.9999847412109375;

// sqrt(log2(e) / 2): turns a whitened residual e into f with exp(-e^2 / 2) = exp2(-f^2).
const float WHITEN = 0.8493218002880191;

// log2(255): splats and pixels with alpha under 1/255 are skipped (3DGS paper, appendix C).
const float LOG2_255 = 7.994353436858858;

// Transmittance under which a pixel ends (3DGS paper, appendix C).
const float TRANSMITTANCE_MIN = 1e-4;

// Shortest quaternion length with a direction: splats with shorter ones are not drawn.
const float QUATERNION_MIN = 1e-18;

// Largest colour of a splat, on a display of 0 to 1: sums and squares of such colours, and gradients by them, stay
// finite for all coefficients.
const float COLOR_MAX = 1e6;

// Planes of a frame's surfaces, of one float a pixel: sum of weight * z; z of the splat that takes the transmittance
// from above 1/2 to 1/2 or below, else 0; sums of weight * unit normal toward the camera, in view axes x, y, z; sum of
// z times the part of the weight that is between transmittances of 3/4 and 1/4.
const uint SURFACE_DEPTH = 0;
const uint SURFACE_MEDIAN = 1;
const uint SURFACE_NORMAL = 2;
const uint SURFACE_INTERQUARTILE = 5;
const uint SURFACE_PLANES = 6;
// Further planes for the spread of depths in a pixel: depth of its first splat, else 0; sums of weight * m and weight *
// m^2 with m = ln(z / that depth).
const uint SURFACE_FIRST = 6;
const uint SURFACE_LOG = 7;
const uint SURFACE_LOG_SQUARE = 8;
const uint SPREAD_PLANES = 9;

// Planes of the gradient of a frame after those by red, green and blue: by the coverage, by the sum of weight * z, and
// by the sums of weight * normal.
const uint D_COVERAGE = 3;
const uint D_DEPTH = 4;
const uint D_NORMAL = 5;
const uint D_SURFACE_PLANES = 8;
// Further planes for the spread of depths: derivative by the variance of ln z times the coverage; depth with the mean
// of ln z; the variance.
const uint D_SPREAD = 8;
const uint SPREAD_CENTER = 9;
const uint SPREAD_OWN = 10;
const uint D_SPREAD_PLANES = 11;

// Floats of a gradient record beside shape, tone and blue: sums for the tilt of planes and of surfels; for the spot of
// surfels; for depths and normals, where they have gradients.
const uint REST_TILT = 3;
const uint REST_SPOT = 2;
const uint REST_SURFACE = 4;

// Slots of the `counts` buffer.
const uint COUNT_SPLAT = 0;
const uint COUNT_VISIBLE = 1;
const uint COUNT_VISIBLE_CHUNK = 2;
const uint COUNT_VISIBLE_TABLE = 3;
const uint COUNT_ISECT = 4;
const uint COUNT_ISECT_CHUNK = 5;
const uint COUNT_ISECT_TABLE = 6;
// Intersections of the whole frame, beyond the buffers' capacity too.
const uint COUNT_ISECT_WANTED = 7;
// Non-zero once a frame did not fit: later work is skipped until the host clears it.
const uint COUNT_FAILED = 8;
// Non-zero if a tile's list was too long for the device's loops.
const uint COUNT_LIST_TOO_LONG = 9;
// Gradient rows that were not finite and were skipped by the optimiser.
const uint COUNT_POISONED = 10;
// First splat of those, as its distance from 2^32 - 1; 0 if there is none.
const uint COUNT_POISONED_FIRST = 11;
// Unused totals.
const uint COUNT_SCRATCH = 12;
// The current band: its first splat in depth order, the one past its last, and the intersections before it.
const uint COUNT_BAND_BEGIN = 13;
const uint COUNT_BAND_END = 14;
const uint COUNT_BAND_BASE = 15;
const uint COUNT_SLOTS = 16;

// Slots of the indirect dispatch arguments, written by `plan`.
const uint ARGS_VISIBLE = 0;
const uint ARGS_VISIBLE_CHUNK = 1;
const uint ARGS_VISIBLE_TABLE = 2;
const uint ARGS_VISIBLE_SCAN = 3;
const uint ARGS_EXPAND = 4;
const uint ARGS_ISECT = 5;
const uint ARGS_ISECT_CHUNK = 6;
const uint ARGS_ISECT_TABLE = 7;
// One workgroup per tile, if the band holds a splat.
const uint ARGS_TILE = 8;
const uint ARGS_SLOTS = 9;

// Most values of a digit of the radix sort; the table is in shared memory in some variants.
const uint SORT_DIGITS_MAX = 2048;
// Most values of a digit for a table of one invocation's own.
const uint SORT_DIGITS_NEAR = 256;

// Flags of an instance: opacities compensate the dilation; splats outside, or inside, its clip box are left out.
const uint INSTANCE_COMPENSATE = 1;
const uint INSTANCE_KEEP = 2;
const uint INSTANCE_CUT = 4;

// Mark on the origin of a splat without moments in `select_rows`.
const uint ORIGIN_IS_NEW = 0x80000000u;

// Begin of a splat's records if it has none in the current band.
const uint NOT_LISTED = 0xffffffffu;

// Splat of a pixel where the coverage stays below 1/2.
const uint NO_SPLAT = 0xffffffffu;

// Elements that one invocation of the scan kernels processes in order.
const uint SCAN_CHUNK = 256;
