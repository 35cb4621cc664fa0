//! Compaction of the visible splats, in the order of their index.

use crate::common::check::*;
use crate::common::device;
use crate::common::scenes::Random;
use crate::kernels::fitting;
use crate::kernels::{LENGTHS, supported};
use ashfall::kernels::compact::{Bindings, Choice, Compact, Spec};
use ashfall::layout::COUNT_SPLAT;
use ashfall::reference::scan::scan;

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
    for variant in supported!(compact, gpu) {
        for workgroup in fitting(&gpu, [8, 64, 256]) {
            let spec = Spec { workgroup };
            let kernel = Compact::new(&gpu, Choice { variant, spec }).unwrap();
            for (name, len) in LENGTHS {
                for kind in ["none visible", "all visible", "some visible"] {
                    let tiles = tile_counts(kind, len);
                    let random = &mut Random::new(len as u64);
                    let depths: Vec<f32> = (0..len)
                        .map(|_| random.log_between(1e-30, 1e30) as f32)
                        .collect();
                    let flags: Vec<u32> = tiles.iter().map(|&t| t.min(1)).collect();
                    let (offsets, _) = scan(&flags);
                    let keys = unwritten::<u32>(&gpu, len + 1);
                    let values = unwritten::<u32>(&gpu, len + 1);
                    let rests: Vec<[f32; 2]> = depths.iter().map(|&depth| [0.0, depth]).collect();
                    let io = Bindings {
                        counts: &counts(&gpu, &[(COUNT_SPLAT, len as u32)]),
                        tile_count_from_splat: &buffer(&gpu, &tiles),
                        visible_from_splat: &buffer(&gpu, &offsets),
                        blue_depth_from_splat: &buffer(&gpu, &rests),
                        depth_from_visible: &keys,
                        splat_from_visible: &values,
                    };
                    gpu.run(|rec| kernel.record(rec, io, kernel.groups(len)))
                        .unwrap();
                    let visible: Vec<usize> = (0..len).filter(|&i| tiles[i] != 0).collect();
                    let padded = |list: Vec<f64>| {
                        let rest = len + 1 - list.len();
                        [list, vec![f64::NAN; rest]].concat()
                    };
                    let depth = |&i: &usize| f64::from(depths[i].to_bits());
                    let depths = padded(visible.iter().map(depth).collect());
                    let splats = padded(visible.iter().map(|&i| i as f64).collect());
                    let case = format!("{name}, {kind}, workgroup {workgroup}");
                    check.outputs(
                        &case,
                        vec![
                            Output::exact("depths", words(&read(&gpu, &keys)), depths),
                            Output::exact("splats", words(&read(&gpu, &values)), splats),
                        ],
                    );
                }
            }
        }
    }
    check.finish();
}
