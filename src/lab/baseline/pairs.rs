//! Sorting against baselines: 2^20 random pairs of 32 bits each.

use super::{Ratio, on_processor};
use crate::Result;
use crate::gpu::{Frames, Gpu, Recorder};
use crate::kernels::Kernel;
use crate::kernels::sort::Sort;
use crate::lab::bench::kernels::{Sorting, Workgroups, sort};
use crate::lab::bench::session::device_times;
use crate::lab::bench::session::{Bench, Case};
use crate::lab::bench::trial::{Subject, host_times};

const COUNT: usize = 1 << 20;
/// Workgroup sizes of the ballot sort.
const BALLOT_WORKGROUPS: Workgroups = Workgroups::subgroups(&[64, 256]);

fn case(variant: &str) -> Case {
    Case::of("baseline", "sort", variant, 0)
}

/// Checks a sort and prepares it for timing.
fn on_device<'a>(gpu: &Gpu, name: &str, sorting: &'a Sorting, sort: &'a Sort) -> Result<Subject<'a>> {
    let case = case(name).doing(sorting.work());
    gpu.run(|rec| {
        sorting.prepare(rec, sort);
        sorting.record(rec, sort);
    })?;
    case.judge(&sorting.outputs(gpu)?)?;
    let mut frames = Frames::new(gpu, 1, true)?;
    let run = move || {
        let prepare = |rec: &mut Recorder<'_>| sorting.prepare(rec, sort);
        device_times(&mut frames, prepare, |rec| sorting.record(rec, sort))
    };
    Ok(Subject {
        case,
        run: Box::new(run),
    })
}

pub(super) fn sort(bench: &mut Bench) -> Result<Vec<Ratio>> {
    let gpu = bench.gpu().clone();
    let names = ["chosen", "ballot/64", "ballot/256", "radsort"];
    if !names.iter().any(|name| bench.wants(&case(name))) {
        return Ok(Vec::new());
    }
    let ours = Sorting::new(&gpu, sort::keys(COUNT), sort::layout(8, 4))?;
    // A chunk for each workgroup, and keys ranked by ballots of subgroups.
    let mut sorts = vec![(names[0].to_owned(), Sort::new(&gpu)?)];
    for (choice, workgroup) in BALLOT_WORKGROUPS.choices::<Sort>(gpu.caps()) {
        if Sort::info(&choice).uses_subgroups() {
            sorts.push((format!("ballot/{workgroup}"), Sort::compile(&gpu, choice)?));
        }
    }
    let subjects = sorts.iter().map(|(name, sort)| on_device(&gpu, name, &ours, sort));
    let mut subjects = subjects.collect::<Result<Vec<_>>>()?;
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
