// Exposure of a photograph: values of the scene become those that its sensor stored. An exposure in linear light, seen
// through the sRGB curve, is a line with one number g for each channel, v + 0.055 = g (x + 0.055), above the curve's
// toe, and the line through 0 of slope g^2.4 on it; the curve is the lower of both where g is above 1, else the upper.
// A value that the photograph has clipped asks for no more: there is neither loss nor slope beyond it.

const float CURVE_OFFSET = 0.055;
// Stored levels from 254 on are clipped, and those up to 1.
const float CLIPPED_HIGH = 253.5 / 255.0;
const float CLIPPED_LOW = 1.5 / 255.0;

// Exposed value and its derivative by x; `target` is the photograph's value.
vec2 exposed(float x, float target, float gain, float toe) {
    float upper = gain * x + (gain - 1.0) * CURVE_OFFSET;
    float lower = toe * x;
    bool on_toe = gain >= 1.0 ? lower < upper : lower > upper;
    vec2 value = on_toe ? vec2(lower, toe) : vec2(upper, gain);
    bool is_beyond = target > CLIPPED_HIGH ? value.x > target : target < CLIPPED_LOW && value.x < target;
    return is_beyond ? vec2(target, 0.0) : value;
}
