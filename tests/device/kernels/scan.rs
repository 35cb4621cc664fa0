//! Prefix sums: each of the three passes, and all together.

use crate::common::check::*;
use crate::common::device;
use crate::common::scenes::Random;
use crate::kernels::fitting;
use crate::kernels::{LENGTHS, supported};
use ashfall::gpu::Groups;
use ashfall::kernels::scan::{Io, Scan, What};
use ashfall::kernels::{scan_apply, scan_chunks, scan_reduce};
use ashfall::layout::SCAN_CHUNK;
use ashfall::reference::scan::scan;

/// The slots used here; any would do.
const COUNT: u32 = 2;
const TOTAL: u32 = 5;

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

/// Sums of the chunks, saturating as the total does.
fn chunk_sums(values: &[u32], flags: bool) -> Vec<u32> {
    let chunks = values.chunks(SCAN_CHUNK as usize);
    chunks
        .map(|chunk| {
            let (_, sum) = scan(&counted(chunk, flags));
            u32::try_from(sum).unwrap_or(u32::MAX)
        })
        .collect()
}

fn counted(values: &[u32], flags: bool) -> Vec<u32> {
    let one = |&value: &u32| if flags { value.min(1) } else { value };
    values.iter().map(one).collect()
}

#[test]
fn chunks_are_summed() {
    let gpu = device::gpu();
    let mut check = Check::new("scan_reduce");
    for variant in supported!(scan_reduce, gpu) {
        for workgroup in [1, 8, 64] {
            let spec = scan_reduce::Spec { workgroup };
            let choice = scan_reduce::Choice { variant, spec };
            let kernel = scan_reduce::ScanReduce::new(&gpu, choice).unwrap();
            let overflowing = ("all 0xFFFFFFFF".to_owned(), vec![u32::MAX; 700], false);
            for (name, values, flags) in inputs().into_iter().chain([overflowing]) {
                let expected = chunk_sums(&values, flags);
                let sums = unwritten::<u32>(&gpu, expected.len() + 1);
                let io = scan_reduce::Bindings {
                    counts: &counts(&gpu, &[(COUNT, values.len() as u32)]),
                    values: &buffer(&gpu, &values),
                    sum_from_chunk: &sums,
                };
                let params = scan_reduce::Params {
                    count_slot: COUNT,
                    flags: flags.into(),
                };
                let groups = Groups::Count((expected.len() as u32).div_ceil(workgroup));
                gpu.run(|rec| kernel.record(rec, io, params, groups))
                    .unwrap();
                let expected = [words(&expected), vec![f64::NAN]].concat();
                let found = words(&read(&gpu, &sums));
                check.outputs(&name, vec![Output::exact("sums", found, expected)]);
            }
        }
    }
    check.finish();
}

#[test]
fn sums_of_chunks_are_scanned_and_saturate() {
    let gpu = device::gpu();
    let mut check = Check::new("scan_chunks");
    for variant in supported!(scan_chunks, gpu) {
        for workgroup in fitting(&gpu, [1, 8, 64, 256]) {
            let spec = scan_chunks::Spec { workgroup };
            let choice = scan_chunks::Choice { variant, spec };
            let kernel = scan_chunks::ScanChunks::new(&gpu, choice).unwrap();
            for (name, len) in LENGTHS {
                for most in [9, u32::MAX as usize] {
                    let random = &mut Random::new(len as u64);
                    let values: Vec<u32> = (0..len).map(|_| random.below(most) as u32).collect();
                    let counted = counts(&gpu, &[(COUNT, len as u32 * SCAN_CHUNK)]);
                    let sums = buffer(&gpu, &values);
                    let io = scan_chunks::Bindings {
                        counts: &counted,
                        sum_from_chunk: &sums,
                    };
                    let params = scan_chunks::Params {
                        count_slot: COUNT,
                        total_slot: TOTAL,
                    };
                    gpu.run(|rec| kernel.record(rec, io, params, Groups::Count(1)))
                        .unwrap();
                    let mut sum = 0u64;
                    let saturated = |sum: u64| sum.min(u64::from(u32::MAX)) as f64;
                    let before: Vec<f64> = values
                        .iter()
                        .map(|&value| {
                            sum += u64::from(value);
                            saturated(sum - u64::from(value))
                        })
                        .collect();
                    let total = words(&read(&gpu, &counted))[TOTAL as usize];
                    let found = if len == 0 {
                        Vec::new()
                    } else {
                        words(&read(&gpu, &sums))
                    };
                    check.outputs(
                        &format!("{name}, up to {most}"),
                        vec![
                            Output::exact("sums", found, before),
                            Output::exact("total", vec![total], vec![saturated(sum)]),
                        ],
                    );
                }
            }
        }
    }
    check.finish();
}

#[test]
fn offsets_go_on_from_their_chunk() {
    let gpu = device::gpu();
    let mut check = Check::new("scan_apply");
    for variant in supported!(scan_apply, gpu) {
        for workgroup in [1, 8, 64] {
            let spec = scan_apply::Spec { workgroup };
            let choice = scan_apply::Choice { variant, spec };
            let kernel = scan_apply::ScanApply::new(&gpu, choice).unwrap();
            for (name, values, flags) in inputs() {
                let (before, _) = scan(&counted(&values, flags));
                let starts: Vec<u32> = before.iter().copied().step_by(256).collect();
                let offsets = unwritten::<u32>(&gpu, values.len() + 1);
                let io = scan_apply::Bindings {
                    counts: &counts(&gpu, &[(COUNT, values.len() as u32)]),
                    values: &buffer(&gpu, &values),
                    sum_from_chunk: &buffer(&gpu, &starts),
                    offsets: &offsets,
                };
                let params = scan_apply::Params {
                    count_slot: COUNT,
                    flags: flags.into(),
                };
                let groups = Groups::Count((starts.len() as u32).div_ceil(workgroup));
                gpu.run(|rec| kernel.record(rec, io, params, groups))
                    .unwrap();
                let expected = [words(&before), vec![f64::NAN]].concat();
                let found = words(&read(&gpu, &offsets));
                check.outputs(&name, vec![Output::exact("offsets", found, expected)]);
            }
        }
    }
    check.finish();
}

#[test]
fn a_whole_scan_is_one_running_sum() {
    let gpu = device::gpu();
    let mut check = Check::new("scan");
    let whole = Scan::new(&gpu).unwrap();
    for (name, values, flags) in inputs() {
        let counted_on_device = counts(&gpu, &[(COUNT, values.len() as u32)]);
        let offsets = unwritten::<u32>(&gpu, values.len() + 1);
        let chunks = values.len().div_ceil(SCAN_CHUNK as usize);
        let io = Io {
            counts: &counted_on_device,
            values: &buffer(&gpu, &values),
            offsets: &offsets,
            sums: &unwritten(&gpu, chunks),
        };
        let what = What {
            count_slot: COUNT,
            total_slot: TOTAL,
            flags,
        };
        let groups = Scan::groups(values.len());
        gpu.run(|rec| whole.record(rec, io, what, groups)).unwrap();
        let (before, sum) = scan(&counted(&values, flags));
        let total = words(&read(&gpu, &counted_on_device))[TOTAL as usize];
        let expected = [words(&before), vec![f64::NAN]].concat();
        check.outputs(
            &name,
            vec![
                Output::exact("offsets", words(&read(&gpu, &offsets)), expected),
                Output::exact("total", vec![total], vec![sum as f64]),
            ],
        );
    }
    check.finish();
}
