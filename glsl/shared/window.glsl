// SSIM's window: 11 taps of a Gaussian with a standard deviation of 1.5 pixels, in each direction; what lies
// outside the image counts as 0 (Wang et al. 2004; zero padding as in the 3DGS code).

const uint WINDOW_TILE = 16;
const uint WINDOW_REACH = 5;
// Pixels of one row or column that WINDOW_TILE windows read.
const uint WINDOW_SPAN = WINDOW_TILE + 2 * WINDOW_REACH;
const float WINDOW[6] = float[](0.0010283800844791101, 0.007598758135239185, 0.036000772128430829,
                               0.10936068950970002, 0.21300553771125369, 0.26601172486179436);

const float SSIM_C1 = 0.0001;
const float SSIM_C2 = 0.0009;

// Weight of position `from` in the window around position `to + WINDOW_REACH`.
float window_weight(int from, int to) {
    return WINDOW[5 - abs(from - to - 5)];
}
