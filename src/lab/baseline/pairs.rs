//! Sorting against baselines: 2^20 random pairs of 32 bits each.

use super::{Ratio, case, compare, is_wanted};
use crate::Result;
use crate::kernels::sort::Sort;
use crate::kernels::{Kernel, sort_scatter};
use crate::lab::bench::kernels::{Workgroups, sort};
use crate::lab::bench::session::Bench;
use crate::lab::bench::trial::{Subject, host_times};

const COUNT: usize = 1 << 20;
/// Workgroup sizes of the ballot sort.
const BALLOT_WORKGROUPS: Workgroups = Workgroups::subgroups(&[64, 256]);

pub(super) fn sort(bench: &mut Bench) -> Result<Vec<Ratio>> {
    let gpu = bench.gpu().clone();
    let names = ["chosen", "ballot/64", "ballot/256", "radsort"];
    if !is_wanted(bench, "sort", &names) {
        return Ok(Vec::new());
    }
    let keys = sort::keys(COUNT);
    let ours = sort::sort(&gpu, keys.clone(), sort::layout(8, 4))?;
    // A chunk for each workgroup, and keys ranked by ballots of subgroups.
    let mut choices = vec![(names[0].to_owned(), sort_scatter::Choice::prefer(gpu.caps()))];
    for (choice, workgroup) in BALLOT_WORKGROUPS.choices::<Sort>(gpu.caps()) {
        if Sort::info(&choice).uses_subgroups() {
            choices.push((format!("ballot/{workgroup}"), choice));
        }
    }
    let mut subjects = Vec::new();
    for (name, choice) in choices {
        subjects.push(ours.subject(&gpu, case("sort", &name).doing(ours.work), choice)?);
    }
    let pairs: Vec<(u32, u32)> = keys.into_iter().zip(0..).collect();
    // Single-threaded, so that its processor time is that of one core.
    subjects.push(Subject {
        case: case("sort", "radsort").doing(ours.work),
        run: Box::new(move || {
            let mut pairs = pairs.clone();
            let times = host_times(|| radsort::sort_by_key(&mut pairs, |&(key, _)| key));
            std::hint::black_box(&pairs);
            Ok(times)
        }),
    });
    let others: Vec<[&str; 2]> = names[1..].iter().map(|name| [names[0], name]).collect();
    compare(bench, "sort", subjects, &others)
}
