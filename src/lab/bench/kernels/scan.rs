//! Cases of the prefix sum: each of its three kernels, and all of them.

use super::{KernelCase, chunk_groups, counts, read};
use crate::Result;
use crate::gpu::{Buffer, Gpu, Groups};
use crate::kernels::scan::{Io, Scan, What};
use crate::kernels::{Kernel, scan_apply, scan_chunks, scan_reduce};
use crate::lab::bench::Work;
use crate::lab::bench::check::{Output, words};
use crate::layout::{COUNT_SCRATCH, COUNT_VISIBLE, SCAN_CHUNK};
use crate::reference::scan::scan;
use crate::shader::KernelInfo;

/// Summed values: the values, or with `flags` 1 for each that is not 0.
fn summed(values: &[u32], flags: bool) -> Vec<u32> {
    let one = |&value: &u32| if flags { value.min(1) } else { value };
    values.iter().map(one).collect()
}

/// Sums of the chunks, saturating as the total does.
pub fn chunk_sums(values: &[u32], flags: bool) -> Vec<u32> {
    let sum = |chunk: &[u32]| u32::try_from(scan(&summed(chunk, flags)).1).unwrap_or(u32::MAX);
    values.chunks(SCAN_CHUNK as usize).map(sum).collect()
}

/// Sums of each chunk of values.
pub fn reduce<'a>(gpu: &Gpu, values: &[u32], flags: bool) -> Result<KernelCase<'a, scan_reduce::ScanReduce>> {
    let (len, expected) = (values.len(), chunk_sums(values, flags));
    let counts = counts(gpu, &[(COUNT_VISIBLE, len as u32)])?;
    let values = gpu.buffer_from("values", values)?;
    let sums = gpu.buffer::<u32>("sum_from_chunk", expected.len() + 1)?;
    let chunks = expected.len();
    let case = KernelCase::new(Work::of(len, "keys").moving(4 * len)).exact("sums", &sums, words(&expected));
    Ok(case.commands(move |rec, kernel: &scan_reduce::ScanReduce, choice| {
        let io = scan_reduce::Bindings {
            counts: &counts,
            values: &values,
            sum_from_chunk: &sums,
        };
        let params = scan_reduce::Params {
            count_slot: COUNT_VISIBLE,
            flags: flags.into(),
        };
        let by_workgroup = choice.variant == scan_reduce::Variant::Workgroup;
        kernel.record(rec, io, params, chunk_groups(chunks, by_workgroup, kernel.workgroup));
    }))
}

/// The sums before each of these chunk sums, saturating, and their total.
pub fn chunks<'a>(gpu: &Gpu, sums: &[u32]) -> Result<KernelCase<'a, scan_chunks::ScanChunks>> {
    let saturated = |sum: u64| sum.min(u64::from(u32::MAX)) as f64;
    let mut total = 0u64;
    let mut expected = Vec::new();
    for &sum in sums {
        expected.push(saturated(total));
        total += u64::from(sum);
    }
    let total = saturated(total);
    let counts = counts(gpu, &[(COUNT_VISIBLE, sums.len() as u32 * SCAN_CHUNK)])?;
    let before = gpu.buffer_from("sum_from_chunk", sums)?;
    let after = gpu.buffer::<u32>("sum_from_chunk", sums.len())?;
    let case = KernelCase::new(Work::of(sums.len(), "keys").moving(8 * sums.len()))
        .exact("sums", &after, expected)
        .copy(&before, &after);
    let case = with_total(case, &counts, total);
    Ok(case.commands(move |rec, kernel: &scan_chunks::ScanChunks, _| {
        let io = scan_chunks::Bindings {
            counts: &counts,
            sum_from_chunk: &after,
        };
        let params = scan_chunks::Params {
            count_slot: COUNT_VISIBLE,
            total_slot: COUNT_SCRATCH,
        };
        kernel.record(rec, io, params, Groups::Count(1));
    }))
}

/// Adds a comparison of the total, among the counts, to a case.
fn with_total<'a, K: Kernel>(case: KernelCase<'a, K>, counts: &Buffer<u32>, total: f64) -> KernelCase<'a, K> {
    let counts = counts.clone();
    case.judge(move |gpu| {
        let found = f64::from(read(gpu, &counts)?[COUNT_SCRATCH as usize]);
        Ok(vec![Output::exact("total", vec![found], vec![total])])
    })
}

/// The sums before each value, given those before each chunk.
pub fn apply<'a>(gpu: &Gpu, values: &[u32], flags: bool) -> Result<KernelCase<'a, scan_apply::ScanApply>> {
    let (len, (expected, _)) = (values.len(), scan(&summed(values, flags)));
    let starts: Vec<u32> = expected.iter().copied().step_by(SCAN_CHUNK as usize).collect();
    let counts = counts(gpu, &[(COUNT_VISIBLE, len as u32)])?;
    let values = gpu.buffer_from("values", values)?;
    let sums = gpu.buffer_from("sum_from_chunk", &starts)?;
    let offsets = gpu.buffer::<u32>("offsets", len + 1)?;
    let case = KernelCase::new(Work::of(len, "keys").moving(8 * len)).exact("offsets", &offsets, words(&expected));
    Ok(case.commands(move |rec, kernel: &scan_apply::ScanApply, choice| {
        let io = scan_apply::Bindings {
            counts: &counts,
            values: &values,
            sum_from_chunk: &sums,
            offsets: &offsets,
        };
        let params = scan_apply::Params {
            count_slot: COUNT_VISIBLE,
            flags: flags.into(),
        };
        let by_workgroup = choice.variant == scan_apply::Variant::Workgroup;
        kernel.record(
            rec,
            io,
            params,
            chunk_groups(starts.len(), by_workgroup, kernel.workgroup),
        );
    }))
}

/// The sums before each value, and their total, by all three kernels.
pub fn whole<'a>(gpu: &Gpu, values: &[u32], flags: bool) -> Result<KernelCase<'a, Scan>> {
    let (len, (expected, total)) = (values.len(), scan(&summed(values, flags)));
    let counts = counts(gpu, &[(COUNT_VISIBLE, len as u32)])?;
    let values = gpu.buffer_from("values", values)?;
    let sums = gpu.buffer::<u32>("sums", len.div_ceil(SCAN_CHUNK as usize))?;
    let offsets = gpu.buffer::<u32>("offsets", len + 1)?;
    let case = KernelCase::new(Work::of(len, "keys").moving(12 * len)).exact("offsets", &offsets, words(&expected));
    Ok(
        with_total(case, &counts, total as f64).commands(move |rec, kernel: &Scan, _| {
            let io = Io {
                counts: &counts,
                values: &values,
                offsets: &offsets,
                sums: &sums,
            };
            let what = What {
                count_slot: COUNT_VISIBLE,
                total_slot: COUNT_SCRATCH,
                flags,
            };
            kernel.record(rec, io, what, kernel.groups(len));
        }),
    )
}

impl Kernel for Scan {
    type Choice = ();
    const NAME: &'static str = "scan";

    fn choices(_: u32) -> Vec<()> {
        vec![()]
    }

    fn info((): &()) -> &'static KernelInfo {
        scan_reduce::Variant::Base.info()
    }

    fn compile(gpu: &Gpu, (): ()) -> Result<Scan> {
        Scan::new(gpu)
    }
}
