//! Case of `gather`: values read through an index.

use super::{KernelCase, counts};
use crate::Result;
use crate::gpu::Gpu;
use crate::kernels::gather::{Bindings, Gather};
use crate::lab::bench::Work;
use crate::lab::bench::input::random::Random;
use crate::layout::COUNT_VISIBLE;

/// Random values through a random permutation, as the order of depths is one.
pub fn gather<'a>(gpu: &Gpu, len: usize) -> Result<KernelCase<'a, Gather>> {
    let random = &mut Random::new(len as u64);
    let source: Vec<u32> = (0..len + 7).map(|_| random.bits() as u32).collect();
    let index = random.permutation(len + 7);
    let index: Vec<u32> = index.iter().take(len).map(|&i| i as u32).collect();
    let value = |&i: &u32| f64::from(source[i as usize]);
    let expected = index.iter().map(value).collect();
    let counts = counts(gpu, &[(COUNT_VISIBLE, len as u32)])?;
    let source = gpu.buffer_from("tile_count_from_splat", &source)?;
    let index = gpu.buffer_from("splat_from_rank", &index)?;
    let target = gpu.buffer::<u32>("tile_count_from_rank", len + 1)?;
    let work = Work::of(len, "splats").moving(12 * len);
    let case = KernelCase::new(work).exact("values", &target, expected);
    Ok(case.commands(move |rec, kernel: &Gather, _| {
        let io = Bindings {
            counts: &counts,
            splat_from_rank: &index,
            tile_count_from_splat: &source,
            tile_count_from_rank: &target,
        };
        kernel.record(rec, io, kernel.groups(len));
    }))
}
