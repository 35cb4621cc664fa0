//! Sorting against baselines: 2^20 random pairs of 32 bits each.

use super::{Ratio, on_processor};
use crate::Result;
use crate::gpu::{Frames, Gpu};
use crate::kernels::sort::Sort;
use crate::kernels::{sort_count, sort_scatter};
use crate::lab::bench::kernels::Sorting;
use crate::lab::bench::session::device_times;
use crate::lab::bench::session::{Bench, Case};
use crate::lab::bench::trial::{Subject, host_times};

const COUNT: usize = 1 << 20;
/// Workgroup sizes of the ballot sort.
const BALLOT_WORKGROUPS: [u32; 2] = [64, 256];

fn case(variant: &str) -> Case {
    Case::of("baseline", "sort", variant, 0)
}

/// Checks a sort and prepares it for timing.
fn on_device<'a>(gpu: &Gpu, name: &str, sorting: &'a Sorting) -> Result<Subject<'a>> {
    let case = case(name).doing(sorting.work());
    gpu.run(|rec| {
        sorting.prepare(rec);
        sorting.record(rec);
    })?;
    case.judge(&sorting.outputs()?)?;
    let mut frames = Frames::new(gpu, 1, true)?;
    let run = move || device_times(&mut frames, |r| sorting.prepare(r), |r| sorting.record(r));
    Ok(Subject {
        case,
        run: Box::new(run),
    })
}

/// Sort with a chunk for each workgroup and keys ranked by ballots of subgroups.
fn ballot(gpu: &Gpu, workgroup: u32) -> Result<Option<Sorting>> {
    let caps = gpu.caps();
    let count = sort_count::Choice {
        variant: sort_count::Variant::Subgroup,
        spec: sort_count::Spec { workgroup },
    };
    let scatter = sort_scatter::Choice {
        variant: sort_scatter::Variant::Subgroup,
        spec: sort_scatter::Spec { workgroup },
    };
    let runs = caps.supports(scatter.variant.info()).is_ok()
        && workgroup <= caps.max_workgroup
        && workgroup.is_multiple_of(caps.subgroup_size.max(1));
    if !runs {
        return Ok(None);
    }
    let sort = Sort::with(gpu, count, scatter)?;
    Sorting::new(gpu, COUNT, sort).map(Some)
}

pub(super) fn sort(bench: &mut Bench) -> Result<Vec<Ratio>> {
    let gpu = bench.gpu().clone();
    let names = ["chosen", "ballot/64", "ballot/256", "radsort"];
    if !names.iter().any(|name| bench.wants(&case(name))) {
        return Ok(Vec::new());
    }
    let ours = Sorting::new(&gpu, COUNT, Sort::new(&gpu)?)?;
    let mut ballots = Vec::new();
    for workgroup in BALLOT_WORKGROUPS {
        ballots.extend(ballot(&gpu, workgroup)?.map(|sorting| (workgroup, sorting)));
    }
    let mut subjects = vec![on_device(&gpu, names[0], &ours)?];
    for (workgroup, sorting) in &ballots {
        subjects.push(on_device(&gpu, &format!("ballot/{workgroup}"), sorting)?);
    }
    let pairs: Vec<(u32, u32)> = ours.keys.iter().copied().zip(0..).collect();
    // Single-threaded, so that its processor time is that of one core.
    subjects.push(Subject {
        case: case("radsort").doing(ours.work()),
        run: Box::new(move || {
            let mut pairs = pairs.clone();
            let times = host_times(|| radsort::sort_by_key(&mut pairs, |&(key, _)| key));
            std::hint::black_box(&pairs);
            Ok(times)
        }),
    });
    let runs = bench.measure_in_turns(&mut subjects)?;
    let by_processor = on_processor(bench);
    let others = subjects.iter().zip(&runs).skip(1);
    let ratio = |(subject, times): (&Subject<'_>, &Vec<_>)| {
        let name = subject.case.variant.as_str();
        let pair = [(names[0], runs[0].as_slice()), (name, times.as_slice())];
        Ratio::of("sort", pair, by_processor)
    };
    Ok(others.map(ratio).collect())
}
