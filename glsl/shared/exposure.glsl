// Exposure of a photograph: values of the scene become those that its sensor stored. An exposure in linear light, seen
// through the sRGB curve, is a line with one number g for each channel, v + 0.055 = g (x + 0.055), above the curve's
// toe, and the line through 0 of slope g^2.4 on it; the curve is the lower of both where g is above 1, else the upper.
//
// A value that the photograph has clipped is a bound. A black one asks for no less. A white one asks for no more, nor
// for more than white in the scene itself; and where the bound holds, the scene is drawn to white weakly, or a sky that
// is white in all photographs would be free to be grey in the bright ones.

const float CURVE_OFFSET = 0.055;
// Stored levels from 254 on are clipped, and those up to 1.
const float CLIPPED_HIGH = 253.5 / 255.0;
const float CLIPPED_LOW = 1.5 / 255.0;
// Share of the distance to white that counts where the bound holds.
const float TO_WHITE = 0.1;

// Exposed value and its derivative by x; `target` is the photograph's value.
vec2 exposed(float x, float target, float gain, float toe) {
    float upper = gain * x + (gain - 1.0) * CURVE_OFFSET;
    float lower = toe * x;
    bool on_toe = gain >= 1.0 ? lower < upper : lower > upper;
    vec2 value = on_toe ? vec2(lower, toe) : vec2(upper, gain);
    if (target > CLIPPED_HIGH) {
        if (x >= target) return vec2(target, 0.0);
        if (value.x < x) value = vec2(x, 1.0);
        if (value.x >= target) value = vec2(target, 0.0);
        return value + TO_WHITE * vec2(x - target, 1.0);
    }
    return target < CLIPPED_LOW && value.x < target ? vec2(target, 0.0) : value;
}
