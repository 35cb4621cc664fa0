// PCG's output permutation on a 32-bit state (O'Neill 2014, section 6.3): every bit of the input reaches every bit of
// the output.
uint scramble(uint x) {
    x = x * 747796405u + 2891336453u;
    uint word = ((x >> ((x >> 28) + 4)) ^ x) * 277803737u;
    return (word >> 22) ^ word;
}
