//! Case of `compact`: the visible splats in the order of their index.

use super::{KernelCase, counts};
use crate::Result;
use crate::gpu::Gpu;
use crate::kernels::compact::{Bindings, Compact};
use crate::lab::bench::Work;
use crate::lab::bench::input::random::Random;
use crate::layout::COUNT_SPLAT;
use crate::reference::scan::scan;

/// Splats that touch so many tiles each, at random depths.
pub fn compact<'a>(gpu: &Gpu, tiles: &[u32]) -> Result<KernelCase<'a, Compact>> {
    let len = tiles.len();
    let random = &mut Random::new(len as u64);
    let mut depth = || random.log_between(1e-30, 1e30) as f32;
    let rests: Vec<[f32; 2]> = (0..len).map(|_| [0.0, depth()]).collect();
    let flags: Vec<u32> = tiles.iter().map(|&tiles| tiles.min(1)).collect();
    let visible: Vec<usize> = (0..len).filter(|&i| tiles[i] > 0).collect();
    let counts = counts(gpu, &[(COUNT_SPLAT, len as u32)])?;
    let visible_from_splat = gpu.buffer_from("visible_from_splat", &scan(&flags).0)?;
    let tile_counts = gpu.buffer_from("tile_count_from_splat", tiles)?;
    let depths = gpu.buffer_from("blue_depth_from_splat", &rests)?;
    let [keys, values] =
        ["depth_from_visible", "splat_from_visible"].map(|name| gpu.buffer::<u32>(name, visible.len() + 1));
    let (keys, values) = (keys?, values?);
    // A flag and a place for all; a depth, and a pair to write, for the visible.
    let work = Work::of(len, "splats").moving(8 * len + 12 * visible.len());
    let bits = |&i: &usize| f64::from(rests[i][1].to_bits());
    let case = KernelCase::new(work)
        .exact("depths", &keys, visible.iter().map(bits).collect())
        .exact("splats", &values, visible.iter().map(|&i| i as f64).collect());
    Ok(case.commands(move |rec, kernel: &Compact, _| {
        let io = Bindings {
            counts: &counts,
            tile_count_from_splat: &tile_counts,
            visible_from_splat: &visible_from_splat,
            blue_depth_from_splat: &depths,
            depth_from_visible: &keys,
            splat_from_visible: &values,
        };
        kernel.record(rec, io, kernel.groups(len));
    }))
}
