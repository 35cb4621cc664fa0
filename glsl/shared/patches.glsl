// Patches of a photograph: squares of 2^shift pixels, in rows. One bit of each tells whether the loss leaves it out.

uint patch_at(uint x, uint y, uint shift, uint columns) {
    return (y >> shift) * columns + (x >> shift);
}

// Word of the patch's bit, and the weight of its pixels in that word: 0 if left out, else 1.
uint word_of(uint place) {
    return place >> 5;
}

float kept_by(uint word, uint place) {
    return float(~(word >> (place & 31u)) & 1u);
}
