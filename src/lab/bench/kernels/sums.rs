//! Prefix sums: each of the three passes, and all of them.

use super::{ELEMENTWISE, counts, nothing, read, sizes, wanted};
use crate::Result;
use crate::gpu::{Buffer, Gpu, Groups};
use crate::kernels::scan::{Io, Scan, What};
use crate::kernels::{scan_apply, scan_chunks, scan_reduce};
use crate::lab::bench::check::{Output, words};
use crate::lab::bench::input::random::Random;
use crate::lab::bench::{Bench, Case, Unit, Work};
use crate::layout::{COUNT_SCRATCH, COUNT_VISIBLE, SCAN_CHUNK};
use crate::reference::scan::scan;

pub(super) fn run(bench: &mut Bench) -> Result<()> {
    for &count in sizes(bench.gpu().caps()) {
        let input = Input::new(bench.gpu(), count)?;
        reduce(bench, &input)?;
        chunks(bench, &input)?;
        apply(bench, &input)?;
        whole(bench, &input)?;
    }
    Ok(())
}

/// Values up to 8, and all that there is to know about them.
struct Input {
    count: usize,
    counts: Buffer<u32>,
    values: Buffer<u32>,
    sums: Buffer<u32>,
    starts: Buffer<u32>,
    scratch: Buffer<u32>,
    offsets: Buffer<u32>,
    /// Of every chunk: its sum, and the sum before it; of every value, the sum before it.
    expected: [Vec<f64>; 3],
}

impl Input {
    fn new(gpu: &Gpu, count: usize) -> Result<Input> {
        let random = &mut Random::new(count as u64);
        let values: Vec<u32> = (0..count).map(|_| random.below(9) as u32).collect();
        let chunk = |values: &[u32]| values.iter().sum::<u32>();
        let sums: Vec<u32> = values.chunks(SCAN_CHUNK as usize).map(chunk).collect();
        let (starts, _) = scan(&sums);
        let (offsets, _) = scan(&values);
        Ok(Input {
            count,
            counts: counts(gpu, &[(COUNT_VISIBLE, count as u32)])?,
            values: gpu.buffer_from("values", &values)?,
            sums: gpu.buffer_from("sums", &sums)?,
            starts: gpu.buffer_from("starts", &starts)?,
            scratch: gpu.buffer_from("scratch", &sums)?,
            offsets: gpu.buffer_from("offsets", &offsets)?,
            expected: [words(&sums), words(&starts), words(&offsets)],
        })
    }

    fn groups(&self, workgroup: u32) -> Groups<'static> {
        Groups::Count((self.sums.len() as u32).div_ceil(workgroup))
    }
}

fn reduce(bench: &mut Bench, input: &Input) -> Result<()> {
    let gpu = bench.gpu().clone();
    let work = Work::of(input.count, Unit::Keys).moving(4 * input.count);
    for (variant, workgroup, case) in wanted!(bench, scan_reduce, input.count, ELEMENTWISE, work) {
        let spec = scan_reduce::Spec { workgroup };
        let choice = scan_reduce::Choice { variant, spec };
        let kernel = scan_reduce::ScanReduce::new(&gpu, choice)?;
        let io = scan_reduce::Bindings {
            counts: &input.counts,
            values: &input.values,
            sum_from_chunk: &input.scratch,
        };
        let params = scan_reduce::Params {
            count_slot: COUNT_VISIBLE,
            flags: 0,
        };
        bench.trial(
            &case,
            |rec| rec.fill(&input.scratch, u32::MAX),
            |rec| kernel.record(rec, io, params, input.groups(workgroup)),
            || {
                let found = words(&read(&gpu, &input.scratch)?);
                Ok(vec![Output::exact(
                    "sums",
                    found,
                    input.expected[0].clone(),
                )])
            },
        )?;
    }
    Ok(())
}

fn chunks(bench: &mut Bench, input: &Input) -> Result<()> {
    let gpu = bench.gpu().clone();
    let work = Work::of(input.sums.len(), Unit::Keys).moving(8 * input.sums.len());
    for (variant, workgroup, case) in wanted!(bench, scan_chunks, input.count, ELEMENTWISE, work) {
        let spec = scan_chunks::Spec { workgroup };
        let choice = scan_chunks::Choice { variant, spec };
        let kernel = scan_chunks::ScanChunks::new(&gpu, choice)?;
        let io = scan_chunks::Bindings {
            counts: &input.counts,
            sum_from_chunk: &input.scratch,
        };
        let params = scan_chunks::Params {
            count_slot: COUNT_VISIBLE,
            total_slot: COUNT_SCRATCH,
        };
        bench.trial(
            &case,
            |rec| rec.copy(&input.sums, 0..input.sums.len(), &input.scratch, 0),
            |rec| kernel.record(rec, io, params, Groups::Count(1)),
            || {
                let found = words(&read(&gpu, &input.scratch)?);
                Ok(vec![Output::exact(
                    "starts",
                    found,
                    input.expected[1].clone(),
                )])
            },
        )?;
    }
    Ok(())
}

fn apply(bench: &mut Bench, input: &Input) -> Result<()> {
    let gpu = bench.gpu().clone();
    let work = Work::of(input.count, Unit::Keys).moving(8 * input.count);
    for (variant, workgroup, case) in wanted!(bench, scan_apply, input.count, ELEMENTWISE, work) {
        let spec = scan_apply::Spec { workgroup };
        let choice = scan_apply::Choice { variant, spec };
        let kernel = scan_apply::ScanApply::new(&gpu, choice)?;
        let io = scan_apply::Bindings {
            counts: &input.counts,
            values: &input.values,
            sum_from_chunk: &input.starts,
            offsets: &input.offsets,
        };
        let params = scan_apply::Params {
            count_slot: COUNT_VISIBLE,
            flags: 0,
        };
        bench.trial(
            &case,
            |rec| rec.fill(&input.offsets, u32::MAX),
            |rec| kernel.record(rec, io, params, input.groups(workgroup)),
            || {
                let found = words(&read(&gpu, &input.offsets)?);
                Ok(vec![Output::exact(
                    "offsets",
                    found,
                    input.expected[2].clone(),
                )])
            },
        )?;
    }
    Ok(())
}

fn whole(bench: &mut Bench, input: &Input) -> Result<()> {
    let gpu = bench.gpu().clone();
    let work = Work::of(input.count, Unit::Keys).moving(12 * input.count);
    let case = Case::of("scan", input.count, "chosen", 0).doing(work);
    if !bench.wants(&case) {
        return Ok(());
    }
    let scan = Scan::new(&gpu)?;
    let io = Io {
        counts: &input.counts,
        values: &input.values,
        offsets: &input.offsets,
        sums: &input.scratch,
    };
    let what = What {
        count_slot: COUNT_VISIBLE,
        total_slot: COUNT_SCRATCH,
        flags: false,
    };
    bench.trial(
        &case,
        nothing,
        |rec| scan.record(rec, io, what, Scan::groups(input.count)),
        || {
            let found = words(&read(&gpu, &input.offsets)?);
            Ok(vec![Output::exact(
                "offsets",
                found,
                input.expected[2].clone(),
            )])
        },
    )?;
    Ok(())
}
