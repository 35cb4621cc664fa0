// Sum of counts that stays at 2^32 - 1, so that an overflow is never taken for a small count.

uint add_saturating(uint a, uint b) {
    return a + min(b, ~a);
}
