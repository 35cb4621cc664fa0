//! Sums of records by splat.

use crate::common::check::*;
use crate::common::device;
use crate::common::scenes::Random;
use crate::kernels::fitting;
use crate::kernels::{LENGTHS, supported};
use ashfall::gpu::Gpu;
use ashfall::kernels::sum_by_splat::{Bindings, Choice, Params, Spec, SumBySplat};
use ashfall::layout::COUNT_FAILED;

/// Splats with up to nine records each, in the order of some depths, and one that has more than loops may turn.
struct Input {
    counts: Vec<u32>,
    begins: Vec<u32>,
    records: Vec<[f32; 3]>,
    totals: Vec<[f32; 3]>,
}

fn input(len: usize, longest: u32) -> Input {
    let random = &mut Random::new(len as u64);
    let mut counts: Vec<u32> = (0..len).map(|_| random.below(10) as u32).collect();
    if let Some(first) = counts.first_mut() {
        *first = longest;
    }
    let mut begins = vec![u32::MAX; len];
    let mut next = 0;
    for i in random.permutation(len) {
        // A splat without records has no place either.
        if counts[i] > 0 {
            begins[i] = next;
            next += counts[i];
        }
    }
    let triple = |random: &mut Random| [0; 3].map(|_| random.between(0.0, 9.0) as f32);
    Input {
        counts,
        begins,
        records: (0..next).map(|_| triple(random)).collect(),
        totals: (0..len).map(|_| triple(random)).collect(),
    }
}

fn run(gpu: &Gpu, kernel: &SumBySplat, input: &Input, slots: &[(u32, u32)]) -> Vec<[f32; 3]> {
    let len = input.counts.len();
    // One more than asked for: it must not be touched.
    let mut before = input.totals.clone();
    before.push([f32::NAN; 3]);
    let totals = buffer(gpu, &before);
    let io = Bindings {
        counts: &counts(gpu, slots),
        tile_count_from_splat: &buffer(gpu, &input.counts),
        emitted_from_splat: &buffer(gpu, &input.begins),
        record_from_emitted: &buffer(gpu, &input.records),
        sum_from_splat: &totals,
    };
    let params = Params {
        splat_count: len as u32,
    };
    gpu.run(|rec| kernel.record(rec, io, params, kernel.groups(params.splat_count as usize)))
        .unwrap();
    read(gpu, &totals)
}

#[test]
fn records_are_added_up_by_splat() {
    let gpu = device::gpu();
    let mut check = Check::new("sum_by_splat");
    for variant in supported!(sum_by_splat, gpu) {
        for workgroup in fitting(&gpu, [1, 8, 64, 256]) {
            let spec = Spec {
                workgroup,
                ..Spec::default()
            };
            let kernel = SumBySplat::new(&gpu, Choice { variant, spec }).unwrap();
            for (name, len) in LENGTHS {
                if workgroup == 1 && len > 300 {
                    continue;
                }
                let longest = if len == 65 { 65_536 } else { 3 };
                let input = input(len, longest);
                let found = run(&gpu, &kernel, &input, &[]);
                let mut wanted = Vec::new();
                for i in 0..len {
                    let begin = input.begins[i] as usize;
                    let end = begin.saturating_add(input.counts[i] as usize);
                    let records = input.records.get(begin..end).unwrap_or_default();
                    let [most, sum, least] = input.totals[i].map(f64::from);
                    let of = |k: usize| records.iter().map(move |r| f64::from(r[k]));
                    wanted.push([
                        of(0).fold(most, f64::max),
                        sum + of(1).sum::<f64>(),
                        of(2).fold(least, f64::min),
                    ]);
                }
                wanted.push([f64::NAN; 3]);
                let found_of = |k: usize| found.iter().map(|r| f64::from(r[k])).collect::<Vec<_>>();
                let wanted_of = |k: usize| wanted.iter().map(|r| r[k]).collect::<Vec<_>>();
                // n additions of positive numbers err by n u of their sum at most.
                let tolerance = f64::from(longest + 10) * 6e-8;
                check.outputs(
                    name,
                    vec![
                        Output::exact("most", found_of(0), wanted_of(0)),
                        Output::relative("sum", found_of(1), wanted_of(1), tolerance, 1.0),
                        Output::exact("least", found_of(2), wanted_of(2)),
                    ],
                );
            }
        }
    }
    check.finish();
}

#[test]
fn all_three_are_summed_where_asked() {
    let gpu = device::gpu();
    let spec = Spec {
        sums: 1,
        ..Spec::default()
    };
    let choice = Choice {
        spec,
        ..Choice::default()
    };
    let kernel = SumBySplat::new(&gpu, choice).unwrap();
    let input = input(130, 7);
    let found = run(&gpu, &kernel, &input, &[]);
    let mut check = Check::new("sum_by_splat of sums");
    for k in 0..3 {
        let sum = |i: usize| {
            let begin = input.begins[i] as usize;
            let end = begin.saturating_add(input.counts[i] as usize);
            let records = input.records.get(begin..end).unwrap_or_default();
            let sum: f64 = records.iter().map(|r| f64::from(r[k])).sum();
            f64::from(input.totals[i][k]) + sum
        };
        let found = found[..130].iter().map(|r| f64::from(r[k])).collect();
        let wanted = (0..130).map(sum).collect();
        let output = Output::relative("sum", found, wanted, 10.0 * 6e-8, 1.0);
        check.outputs(["first", "second", "third"][k], vec![output]);
    }
    check.finish();
}

#[test]
fn a_frame_that_did_not_fit_changes_nothing() {
    let gpu = device::gpu();
    let kernel = SumBySplat::new(&gpu, Choice::default()).unwrap();
    let input = input(100, 5);
    let found = run(&gpu, &kernel, &input, &[(COUNT_FAILED, 1)]);
    assert_eq!(found[..100], input.totals);
}
