//! Stable sort of (key, value) pairs, by the standard library.

/// Keys and values in ascending order of the key's bits under `mask`; equal keys keep their order.
pub fn sort(keys: &[u32], values: &[u32], mask: u32) -> (Vec<u32>, Vec<u32>) {
    assert_eq!(keys.len(), values.len(), "one value per key");
    let mut pairs: Vec<(u32, u32)> = keys.iter().copied().zip(values.iter().copied()).collect();
    pairs.sort_by_key(|(key, _)| key & mask);
    pairs.into_iter().unzip()
}
