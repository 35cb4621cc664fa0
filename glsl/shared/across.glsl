// Vector of the lane with an index that differs in the bits of `mask`.
vec4 from_across(vec4 v, uint mask) {
    return vec4(subgroupShuffleXor(v.x, mask), subgroupShuffleXor(v.y, mask), subgroupShuffleXor(v.z, mask),
                subgroupShuffleXor(v.w, mask));
}
