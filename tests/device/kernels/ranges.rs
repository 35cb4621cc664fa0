//! Slice of the sorted intersections of each tile.

use crate::common::check::*;
use crate::common::device;
use crate::common::scenes::Random;
use crate::kernels::fitting;
use crate::kernels::supported;
use ashfall::gpu::Groups;
use ashfall::kernels::ranges::{Bindings, Choice, Params, Ranges, Spec};
use ashfall::layout::{COUNT_FAILED, COUNT_ISECT, COUNT_LIST_TOO_LONG};
use ashfall::reference::ranges::ranges;

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
        (
            "padding at the end",
            [drawn(500, 9), vec![9; 40]].concat(),
            9,
        ),
        ("padding only", vec![9; 40], 9),
    ];
    lengths.into_iter().chain(others).collect()
}

#[test]
fn every_tile_finds_its_slice() {
    let gpu = device::gpu();
    let mut check = Check::new("ranges");
    for variant in supported!(ranges, gpu) {
        for workgroup in fitting(&gpu, [8, 64, 256]) {
            let spec = Spec { workgroup };
            let kernel = Ranges::new(&gpu, Choice { variant, spec }).unwrap();
            for (name, tiles, tile_count) in inputs() {
                let target = unwritten::<[u32; 2]>(&gpu, tile_count as usize);
                let counted = counts(&gpu, &[(COUNT_ISECT, tiles.len() as u32)]);
                let io = Bindings {
                    counts: &counted,
                    tile_from_isect: &buffer(&gpu, &tiles),
                    range_from_tile: &target,
                };
                let args = args(&gpu, tiles.len(), workgroup);
                let params = Params {
                    tile_count,
                    list_limit: LIST_LIMIT,
                };
                gpu.run(|rec| {
                    rec.fill(&target, 0);
                    kernel.record(rec, io, params, Groups::indirect(&args, 0));
                })
                .unwrap();
                // An empty slice may lie anywhere; the kernel leaves it at 0.
                let expected: Vec<[u32; 2]> = ranges(&tiles, tile_count)
                    .into_iter()
                    .map(|[begin, end]| if begin == end { [0, 0] } else { [begin, end] })
                    .collect();
                let found = words(&read(&gpu, &target));
                let longest = expected.iter().map(|[begin, end]| end - begin).max();
                let too_long = u32::from(longest.unwrap_or(0) > LIST_LIMIT);
                let after = read(&gpu, &counted);
                let flags = [COUNT_LIST_TOO_LONG, COUNT_FAILED].map(|slot| after[slot as usize]);
                check.outputs(
                    name,
                    vec![
                        Output::exact("ranges", found, words(&expected)),
                        Output::exact("too long", words(&flags), words(&[too_long; 2])),
                    ],
                );
            }
        }
    }
    check.finish();
}
