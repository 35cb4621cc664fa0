//! Case of `sum_by_splat`: records of intersections added up by splat.

use super::composite::Composite;
use super::{KernelCase, counts};
use crate::Result;
use crate::gpu::Gpu;
use crate::kernels::sum_by_splat::{Bindings, Choice, Params, SumBySplat};
use crate::lab::bench::Work;
use crate::lab::bench::check::Output;

/// Records of every splat, and totals to add them to.
pub struct Records {
    /// Records of each splat.
    pub counts: Vec<u32>,
    /// First record of each splat.
    pub begins: Vec<u32>,
    /// The records.
    pub records: Vec<[f32; 3]>,
    /// Totals before, by splat.
    pub totals: Vec<[f32; 3]>,
}

impl Records {
    /// One record for each intersection of a scene, small whole numbers.
    pub fn of(composite: &Composite) -> Records {
        let (isects, splats) = (&composite.lists.isects, composite.scene.splats.len());
        let (mut counts, mut begins) = (vec![0; splats], vec![0; splats]);
        for (source, isect) in isects.iter().enumerate().rev() {
            counts[isect.splat as usize] += 1;
            begins[isect.splat as usize] = source as u32;
        }
        let record = |i: usize| [i % 3, i % 5, i % 7].map(|x| x as f32);
        Records {
            counts,
            begins,
            records: (0..isects.len()).map(record).collect(),
            totals: vec![[0.0; 3]; splats],
        }
    }

    /// Largest first number, sum of the second, smallest third; with `sums` the sum of each.
    fn expected(&self, splat: usize, sums: bool) -> [f64; 3] {
        let begin = self.begins[splat] as usize;
        let end = begin.saturating_add(self.counts[splat] as usize);
        let records = self.records.get(begin..end).unwrap_or_default();
        let total = self.totals[splat].map(f64::from);
        let of = |k: usize| records.iter().map(move |r| f64::from(r[k]));
        match sums {
            true => [0, 1, 2].map(|k| total[k] + of(k).sum::<f64>()),
            false => [
                of(0).fold(total[0], f64::max),
                total[1] + of(1).sum::<f64>(),
                of(2).fold(total[2], f64::min),
            ],
        }
    }
}

/// Records added up; `sums`: all three numbers are sums.
pub fn sum_by_splat<'a>(gpu: &Gpu, input: &Records, sums: bool) -> Result<KernelCase<'a, SumBySplat>> {
    let splats = input.counts.len();
    let mut expected: Vec<[f64; 3]> = (0..splats).map(|i| input.expected(i, sums)).collect();
    // One more than asked for: it must not be touched.
    expected.push([f64::NAN; 3]);
    let mut before = input.totals.clone();
    before.push([f32::NAN; 3]);
    let longest = input.counts.iter().max().copied().unwrap_or(0);
    let work = Work::of(splats, "splats").moving(12 * input.records.len() + 32 * splats);
    let counts = counts(gpu, &[])?;
    let tile_counts = gpu.buffer_from("tile_count_from_splat", &input.counts)?;
    let begins = gpu.buffer_from("emitted_from_splat", &input.begins)?;
    let records = gpu.buffer_from("record_from_emitted", &input.records)?;
    let before = gpu.buffer_from("totals", &before)?;
    let totals = gpu.buffer::<[f32; 3]>("sum_from_splat", splats + 1)?;
    let case = KernelCase::new(work).tune(move |choice: &mut Choice| choice.spec.sums = sums.into());
    let case = case.compare(&totals, move |found| {
        let column = |k: usize| found.iter().map(|r| f64::from(r[k])).collect::<Vec<_>>();
        let wanted = |k: usize| expected.iter().map(|r| r[k]).collect::<Vec<_>>();
        // n additions of positive numbers err by n u of their sum at most.
        let tolerance = f64::from(longest + 10) * 6e-8;
        let output = |(k, name)| match sums || k == 1 {
            true => Output::relative(name, column(k), wanted(k), tolerance, 1.0),
            false => Output::exact(name, column(k), wanted(k)),
        };
        let names = ["first", "second", "third"];
        names.into_iter().enumerate().map(output).collect()
    });
    Ok(case
        .copy(&before, &totals)
        .commands(move |rec, kernel: &SumBySplat, _| {
            let io = Bindings {
                counts: &counts,
                tile_count_from_splat: &tile_counts,
                emitted_from_splat: &begins,
                record_from_emitted: &records,
                sum_from_splat: &totals,
            };
            let params = Params {
                splat_count: splats as u32,
            };
            kernel.record(rec, io, params, kernel.groups(splats));
        }))
}
