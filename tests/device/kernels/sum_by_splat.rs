//! Records added up by splat.

use crate::common::check::*;
use crate::common::device;
use crate::common::scenes::Random;
use crate::kernels::{ELEMENTWISE, by_length};
use ashfall::kernels::sum_by_splat::{Bindings, Choice, Params, SumBySplat};
use ashfall::lab::bench::kernels::sum_by_splat::{Records, sum_by_splat};
use ashfall::layout::COUNT_FAILED;

/// Splats with up to nine records each, in the order of some depths, and one with `longest`.
fn input(len: usize, longest: u32) -> Records {
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
    Records {
        counts,
        begins,
        records: (0..next).map(|_| triple(random)).collect(),
        totals: (0..len).map(|_| triple(random)).collect(),
    }
}

/// One of the splats has more records than loops of a software device may turn.
#[test]
fn records_are_added_up_by_splat() {
    let gpu = device::gpu();
    let mut check = Check::new("sum_by_splat");
    for sums in [false, true] {
        let cases = by_length(|len| {
            let longest = if len == 65 { 65_536 } else { 3 };
            sum_by_splat(&gpu, &input(len, longest), sums)
        });
        check.cases(&gpu, ELEMENTWISE, &cases);
    }
    check.finish();
}

#[test]
fn a_frame_that_did_not_fit_changes_nothing() {
    let gpu = device::gpu();
    let kernel = SumBySplat::new(&gpu, Choice::default()).unwrap();
    let input = input(100, 5);
    let totals = buffer(&gpu, &input.totals);
    let io = Bindings {
        counts: &counts(&gpu, &[(COUNT_FAILED, 1)]),
        tile_count_from_splat: &buffer(&gpu, &input.counts),
        emitted_from_splat: &buffer(&gpu, &input.begins),
        record_from_emitted: &buffer(&gpu, &input.records),
        sum_from_splat: &totals,
    };
    let params = Params { splat_count: 100 };
    gpu.run(|rec| kernel.record(rec, io, params, kernel.groups(100)))
        .unwrap();
    assert_eq!(read(&gpu, &totals), input.totals);
}
