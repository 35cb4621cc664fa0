//! Prefix sums: one running sum, which a kernel computes in pieces.

/// For every element the sum of those before it (wrapped to 32 bits), and the sum of all.
pub fn scan(values: &[u32]) -> (Vec<u32>, u64) {
    let mut sum = 0u64;
    let mut before = Vec::with_capacity(values.len());
    for &value in values {
        before.push(sum as u32);
        sum += u64::from(value);
    }
    (before, sum)
}
