// SSIM's window: 11 taps of a Gaussian with a standard deviation of 1.5 pixels, in each direction; pixels outside the
// image are 0 (Wang et al. 2004; zero padding as in the 3DGS code).

const uint WINDOW_REACH = 5;
// Rows read by a tile's windows.
const uint WINDOW_SPAN = LOSS_TILE_HEIGHT + 2 * WINDOW_REACH;
// Distance of windows in both directions, in pixels: 1, or 2 for a lattice of a quarter of them. Each of a lattice
// counts STRIDE * STRIDE times.
layout(constant_id = 4) const uint STRIDE = 1;
// Windows of a strip, which one invocation slides over: 2, 4 or 8. Long strips load least, short ones keep more lanes
// busy.
layout(constant_id = 5) const uint STRIP = 8;
const float WINDOW[6] = float[](0.0010283800844791101, 0.007598758135239185, 0.036000772128430829,
                               0.10936068950970002, 0.21300553771125369, 0.26601172486179436);

const float SSIM_C1 = 0.0001;
const float SSIM_C2 = 0.0009;

// The weighted sum of the window around value `to + WINDOW_REACH`. A macro: as a function it would copy the
// whole array at every call.
#define window_sum(values, to)                              \
    (WINDOW[5] * values[(to) + 5] +                         \
     WINDOW[4] * (values[(to) + 4] + values[(to) + 6]) +    \
     WINDOW[3] * (values[(to) + 3] + values[(to) + 7]) +    \
     WINDOW[2] * (values[(to) + 2] + values[(to) + 8]) +    \
     WINDOW[1] * (values[(to) + 1] + values[(to) + 9]) +    \
     WINDOW[0] * (values[(to)] + values[(to) + 10]))

// Sums of the windows' values at even and at odd distances up to 5 pixels, for values two pixels apart.
#define even_sum(values, from)                              \
    (WINDOW[5] * values[(from) + 2] +                       \
     WINDOW[3] * (values[(from) + 1] + values[(from) + 3]) + \
     WINDOW[1] * (values[(from)] + values[(from) + 4]))
#define odd_sum(values, from)                               \
    (WINDOW[4] * (values[(from) + 2] + values[(from) + 3]) + \
     WINDOW[2] * (values[(from) + 1] + values[(from) + 4]) + \
     WINDOW[0] * (values[(from)] + values[(from) + 5]))

// Place of a window's derivatives: planes of [channel][row][column] of the windows.
uint place_of_window(uvec2 pixel, uint channel, uvec2 size) {
    uvec2 grid = (size + STRIDE - 1) / STRIDE;
    uvec2 at = pixel / STRIDE;
    return (channel * grid.y + at.y) * grid.x + at.x;
}
