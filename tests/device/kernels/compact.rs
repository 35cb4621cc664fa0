//! Visible splats in the order of their index.

use crate::common::check::*;
use crate::common::device;
use crate::common::scenes::Random;
use crate::kernels::{ELEMENTWISE, by_length};
use ashfall::lab::bench::kernels::compact::compact;

/// Tile counts of `len` splats: none, all or some of them visible.
fn tile_counts(kind: &str, len: usize) -> Vec<u32> {
    let random = &mut Random::new(len as u64 + 1);
    let mut draw = || match kind {
        "none visible" => 0,
        "all visible" => 1 + random.below(3) as u32,
        _ => [0, 0, 1, u32::MAX][random.below(4)],
    };
    (0..len).map(|_| draw()).collect()
}

#[test]
fn the_visible_are_listed_in_order() {
    let gpu = device::gpu();
    let mut check = Check::new("compact");
    for kind in ["none visible", "all visible", "some visible"] {
        let cases = by_length(|len| compact(&gpu, &tile_counts(kind, len)));
        check.cases(&gpu, ELEMENTWISE, &cases);
    }
    check.finish();
}
