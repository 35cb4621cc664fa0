// Pixel of a photograph in the loss: 8-bit RGBA, alpha either composited over the background or a weight. A weighted
// pixel enters every SSIM window with its weight, so that masked pixels count like pixels outside the image.

const uint ALPHA_MASKS = 1;

float channel_of(uint rgba, uint channel) {
    return float((rgba >> (8 * channel)) & 255u) * (1.0 / 255.0);
}

// Weight of the pixel in the loss, 0 to 1.
float weight_of(uint rgba, uint alpha_mode) {
    return alpha_mode == ALPHA_MASKS ? channel_of(rgba, 3) : 1.0;
}

// Target of a channel of the render; `background` is that channel's.
float target_of(uint rgba, uint channel, uint alpha_mode, float background) {
    float value = channel_of(rgba, channel);
    return alpha_mode == ALPHA_MASKS ? value : mix(background, value, channel_of(rgba, 3));
}
