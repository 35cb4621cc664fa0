// Powers of two of numbers up to 0, exactly or by a polynomial.

// x = n + f, n whole and f from 0 to 1: 2^f is taken from the polynomial whose largest relative error on [0, 1] is the
// least of its degree (minimax, by the exchange algorithm), and n is added to the bits of its exponent. Numbers below
// -126, whose power is not normal, are taken for -126: no alpha that counts is as small.
// Relative errors: 1.7248e-3 of degree 2, 7.479e-5 of degree 3, plus a few roundings of 2^-24.
vec4 power_of_two(uint degree, vec4 x) {
    if (degree == 0) return exp2(x);
    x = max(x, vec4(-126.0));
    vec4 n = floor(x);
    vec4 f = x - n;
    vec4 p = degree == 2
        ? (0.33718943468391116 * f + 0.6576362756978286) * f + 1.0017247632060866
        : ((0.07802452266443263 * f + 0.22606715539312927) * f + 0.6958335405064481) * f + 0.99992521856401;
    return intBitsToFloat(floatBitsToInt(p) + (ivec4(n) << 23));
}
