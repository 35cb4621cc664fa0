//! Prefix sums: each of the three passes, and all together.

use crate::common::check::*;
use crate::common::device;
use crate::common::scenes::Random;
use crate::kernels::{ELEMENTWISE, LENGTHS, by_length};
use ashfall::Result;
use ashfall::kernels::Kernel;
use ashfall::lab::bench::kernels::{KernelCase, Workgroups, scan};

/// Values with a name, and whether only "is not 0" is summed.
fn inputs() -> Vec<(String, Vec<u32>, bool)> {
    let random = &mut Random::new(3);
    let mut cases = Vec::new();
    let lengths = LENGTHS.iter().copied().chain([("many", 300_001)]);
    for (name, len) in lengths {
        for flags in [false, true] {
            let values = (0..len).map(|_| [0, random.below(9) as u32][random.below(2)]);
            cases.push((format!("{name}, flags {flags}"), values.collect(), flags));
        }
    }
    cases.push(("all zero".into(), vec![0; 1000], false));
    cases.push(("just below 2^32".into(), vec![1 << 23; 511], false));
    cases.push(("flags of all 0xFFFFFFFF".into(), vec![u32::MAX; 700], true));
    cases
}

fn cases<'a, K: Kernel>(
    inputs: Vec<(String, Vec<u32>, bool)>,
    case: impl Fn(&[u32], bool) -> Result<KernelCase<'a, K>>,
) -> Vec<(String, KernelCase<'a, K>)> {
    let case = |(name, values, flags): (String, Vec<u32>, bool)| (name, case(&values, flags).unwrap());
    inputs.into_iter().map(case).collect()
}

#[test]
fn chunks_are_summed() {
    let gpu = device::gpu();
    let mut check = Check::new("scan_reduce");
    let mut inputs = inputs();
    inputs.push(("all 0xFFFFFFFF".to_owned(), vec![u32::MAX; 700], false));
    let cases = cases(inputs, |values, flags| scan::reduce(&gpu, values, flags));
    check.cases(&gpu, ELEMENTWISE, &cases);
    check.finish();
}

#[test]
fn sums_of_chunks_are_scanned_and_saturate() {
    let gpu = device::gpu();
    let mut check = Check::new("scan_chunks");
    for most in [9, u32::MAX as usize] {
        let cases = by_length(|len| {
            let random = &mut Random::new(len as u64);
            let values: Vec<u32> = (0..len).map(|_| random.below(most) as u32).collect();
            scan::chunks(&gpu, &values)
        });
        check.cases(&gpu, ELEMENTWISE, &cases);
    }
    check.finish();
}

#[test]
fn offsets_go_on_from_their_chunk() {
    let gpu = device::gpu();
    let mut check = Check::new("scan_apply");
    let cases = cases(inputs(), |values, flags| scan::apply(&gpu, values, flags));
    check.cases(&gpu, ELEMENTWISE, &cases);
    check.finish();
}

#[test]
fn a_whole_scan_is_one_running_sum() {
    let gpu = device::gpu();
    let mut check = Check::new("scan");
    let cases = cases(inputs(), |values, flags| scan::whole(&gpu, values, flags));
    check.cases(&gpu, Workgroups::FIXED, &cases);
    check.finish();
}
