// How a radix sort thresholds keys into chunks. Their number is given; all are of one size but the last ones, which get
// what is left, if anything. A size of whole quadruples lets an invocation read four keys at a time.

uint keys_per_chunk(uint count, uint chunk_count) {
    uint keys = count / chunk_count + (count % chunk_count != 0 ? 1 : 0);
    return (keys + 3) / 4 * 4;
}
