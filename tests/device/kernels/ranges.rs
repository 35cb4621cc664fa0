//! Slice of the sorted intersections of each tile.

use crate::common::check::*;
use crate::common::device;
use crate::common::scenes::Random;
use crate::kernels::ELEMENTWISE;
use ashfall::lab::bench::kernels::ranges::ranges;

/// Intersections that a tile may have here.
const LIST_LIMIT: u32 = 299;

/// Sorted tiles and the number of tiles; tiles from there on are padding.
fn inputs() -> Vec<(&'static str, Vec<u32>, u32)> {
    let random = &mut Random::new(7);
    let mut drawn = |len: usize, tiles: usize| {
        let mut list: Vec<u32> = (0..len).map(|_| random.below(tiles) as u32).collect();
        list.sort_unstable();
        list
    };
    let lengths = crate::kernels::LENGTHS.map(|(name, len)| (name, drawn(len, 9), 9));
    let others = vec![
        ("nothing to draw", vec![], 5),
        ("one", vec![3], 5),
        ("all in the first tile", vec![0; 300], 5),
        ("all in the last tile", vec![4; 300], 5),
        ("as many as allowed", vec![4; 299], 5),
        ("as much padding as can be", vec![5; 400], 5),
        ("one in each", (0..1000).collect(), 1000),
        ("every other tile", (0..500).map(|i| 2 * i).collect(), 1000),
        ("a border at 2^6", [vec![0; 64], vec![1; 64]].concat(), 3),
        ("a border at 2^8 + 1", [vec![1; 257], vec![2]].concat(), 3),
        ("crosses workgroups", drawn(20_000, 77), 77),
        ("padding at the end", [drawn(500, 9), vec![9; 40]].concat(), 9),
        ("padding only", vec![9; 40], 9),
    ];
    lengths.into_iter().chain(others).collect()
}

#[test]
fn every_tile_finds_its_slice() {
    let gpu = device::gpu();
    let mut check = Check::new("ranges");
    let case = |(name, tiles, tile_count): (&'static str, Vec<u32>, u32)| {
        (name, ranges(&gpu, &tiles, tile_count, LIST_LIMIT).unwrap())
    };
    let cases: Vec<_> = inputs().into_iter().map(case).collect();
    check.cases(&gpu, ELEMENTWISE, &cases);
    check.finish();
}
