// Division of a radix sort's keys into a given number of chunks: all of one size but the last ones, which get the rest,
// if any. The size is a multiple of four, for reads of four keys at a time.

uint keys_per_chunk(uint count, uint chunk_count) {
    uint keys = count / chunk_count + (count % chunk_count != 0 ? 1 : 0);
    return (keys + 3) / 4 * 4;
}
