//! Basic operations of the device that all kernels rely on.

use super::outcome::{CheckGroup, StressCheck, Sweep, SweepPoint};
use super::{StressRun, unequal};
use crate::Result;
use crate::gpu::{Gpu, Groups};
use crate::kernels::selftest_atomics::{self, SelftestAtomics};
use crate::kernels::selftest_lanes::{self, SelftestLanes};
use crate::kernels::selftest_loops::{self, SelftestLoops};
use crate::kernels::selftest_math::{self, SelftestMath};
use crate::kernels::selftest_progress::{self, SelftestProgress};
use crate::lab::page::number;
use crate::reference::selftest::{self, FUNCTIONS, Function};
use crate::render::loop_turns;
use bytemuck::Pod;

pub(super) fn run(lab: &mut StressRun<'_>) -> Result<()> {
    atomics(lab)?;
    for variant in selftest_lanes::Variant::ALL {
        if lab.gpu.caps().supports(variant.info()).is_ok() {
            lanes(lab, *variant)?;
        }
    }
    functions(lab)?;
    special_values(lab)?;
    loops(lab)?;
    progress(lab)
}

fn read<T: Pod>(gpu: &Gpu, buffer: &crate::gpu::Buffer<T>) -> Result<Vec<T>> {
    gpu.download(buffer, 0..buffer.len())
}

fn atomics(lab: &mut StressRun<'_>) -> Result<()> {
    let gpu = lab.gpu;
    const INVOCATIONS: u32 = 100_000;
    let choice = selftest_atomics::Choice::default();
    let kernel = SelftestAtomics::new(gpu, choice)?;
    let expected = selftest::atomics(INVOCATIONS);
    let counts = gpu.buffer_from("selftest", &vec![0u32; expected.len()])?;
    let io = selftest_atomics::Bindings { counts: &counts };
    let params = selftest_atomics::Params {
        invocation_count: INVOCATIONS,
    };
    let groups = INVOCATIONS.div_ceil(choice.spec.workgroup);
    gpu.run(|rec| kernel.record(rec, io, params, Groups::Count(groups)))?;
    let what = format!(
        "{} invocations draw tickets, and add, compare and flip bits in common words",
        number(INVOCATIONS.into())
    );
    let wrong = unequal(&read(gpu, &counts)?, &expected);
    lab.none("atomic operations", what, wrong, "wrong words");
    Ok(())
}

fn lanes(lab: &mut StressRun<'_>, variant: selftest_lanes::Variant) -> Result<()> {
    let gpu = lab.gpu;
    const ROUNDS: u32 = 100;
    let choice = selftest_lanes::Choice::of_variant(gpu.caps(), variant);
    let lanes = choice.spec.workgroup;
    let kernel = SelftestLanes::new(gpu, choice)?;
    let found = gpu.buffer::<u32>("selftest", 8 * lanes as usize)?;
    let io = selftest_lanes::Bindings { found: &found };
    let params = selftest_lanes::Params { rounds: ROUNDS };
    gpu.run(|rec| kernel.record(rec, io, params, Groups::Count(1)))?;
    let wrong = unequal(&read(gpu, &found)?, &selftest::lanes(lanes, ROUNDS));
    let (name, how) = match variant.name() {
        "" | "base" => ("shared memory", "through shared memory"),
        _ => ("subgroup operations", "by subgroup operations"),
    };
    let what = format!("{lanes} lanes add, vote, count and exchange numbers {how}, {ROUNDS} times");
    lab.none(name, what, wrong, "wrong results");
    Ok(())
}

/// Runs the functions on arguments: `[function][argument]`.
fn computed(gpu: &Gpu, arguments: &[f32]) -> Result<Vec<Vec<f32>>> {
    let choice = selftest_math::Choice::default();
    let kernel = SelftestMath::new(gpu, choice)?;
    let found = gpu.buffer::<f32>("selftest", FUNCTIONS.len() * arguments.len())?;
    let io = selftest_math::Bindings {
        arguments: &gpu.buffer_from("selftest", arguments)?,
        found: &found,
    };
    let params = selftest_math::Params {
        argument_count: arguments.len() as u32,
    };
    let groups = params.argument_count.div_ceil(choice.spec.workgroup);
    gpu.run(|rec| kernel.record(rec, io, params, Groups::Count(groups)))?;
    let found = read(gpu, &found)?;
    Ok(found.chunks(arguments.len()).map(<[f32]>::to_vec).collect())
}

/// Arguments of a function: the range of its results in single precision, evenly in the argument or its logarithm.
fn arguments(function: Function) -> Vec<f32> {
    const COUNT: usize = 20_000;
    let between = |low: f64, high: f64| {
        let at = move |i: usize| low + (high - low) * i as f64 / (COUNT - 1) as f64;
        (0..COUNT).map(at)
    };
    match function {
        // Results from the least normal number to the largest.
        Function::Exp => between(-87.3, 88.7).map(|x| x as f32).collect(),
        Function::Exp2 => between(-126.0, 127.9).map(|x| x as f32).collect(),
        _ => between(-126.0, 127.0).map(|x| x.exp2() as f32).collect(),
    }
}

/// Names of [`FUNCTIONS`].
const NAMES: [&str; FUNCTIONS.len()] = ["exp", "exp2", "log2", "sqrt", "inversesqrt", "1 / x"];

fn functions(lab: &mut StressRun<'_>) -> Result<()> {
    for (index, &function) in FUNCTIONS.iter().enumerate() {
        let arguments = arguments(function);
        let found = &computed(lab.gpu, &arguments)?[index];
        let share = |(&x, &found): (&f32, &f32)| {
            let x = f64::from(x);
            (f64::from(found) - function.exact(x)).abs() / function.allowance(x)
        };
        let each = arguments.iter().zip(found).map(share);
        // NaN must propagate.
        let most = each.fold(0.0, |most: f64, s| if s > most || s.is_nan() { s } else { most });
        let what = format!(
            "{} arguments over its whole range, against the specification's precision",
            number(arguments.len() as f64)
        );
        lab.at_most(NAMES[index], what, [most, 1.0], "of the error allowed");
        if function == Function::Exp {
            lab.found.sweeps.push(curve_of_exp(&arguments, found));
        }
    }
    Ok(())
}

/// The error of exp over its range: the maximum over each of some intervals.
fn curve_of_exp(arguments: &[f32], found: &[f32]) -> Sweep {
    const PIECES: usize = 90;
    let size = arguments.len().div_ceil(PIECES);
    let worst = |(arguments, found): (&[f32], &[f32])| {
        let each = arguments.iter().zip(found).map(|(&x, &found)| {
            let x = f64::from(x);
            let ulp = x.exp().log2().floor().exp2() * f64::from(f32::EPSILON);
            SweepPoint {
                x,
                measured: (f64::from(found) - x.exp()).abs() / ulp,
                bound: Function::Exp.allowance(x) / ulp,
            }
        });
        each.max_by(|a, b| a.measured.total_cmp(&b.measured))
    };
    let pieces = arguments.chunks(size).zip(found.chunks(size));
    Sweep {
        group: CheckGroup::Device,
        title: "exp over its whole range",
        parameter: "argument of exp",
        quantity: "largest error, ulp",
        caption: "In units in the last place of the result. The specification allows 3 + 2 |x|; where results are \
                  hardly larger than the least normal number, that number is allowed.",
        points: pieces.filter_map(worst).collect(),
        ..Sweep::default()
    }
}

/// An argument, and the condition of its value.
type ExpectedValue = (f32, fn(f32) -> bool);

/// Values of compositing and projection at the ends of their ranges.
fn special_values(lab: &mut StressRun<'_>) -> Result<()> {
    let is_zero = |value: f32| (0.0..f32::MIN_POSITIVE).contains(&value);
    let is_infinite = |value: f32| value == f32::INFINITY;
    let expected: [ExpectedValue; 7] = [
        (f32::NEG_INFINITY, is_zero),
        // Exponent of splats hidden from compositing.
        (-1e30, is_zero),
        (-200.0, is_zero),
        (0.0, |value| value == 1.0),
        (200.0, is_infinite),
        (f32::INFINITY, is_infinite),
        // No ordinary number: Vulkan permits infinity.
        (f32::NAN, |value| !value.is_finite()),
    ];
    let found = computed(lab.gpu, &expected.map(|(argument, _)| argument))?;
    let mut wrong = Vec::new();
    for (function, found) in ["exp", "exp2"].iter().zip(&found) {
        let pairs = found.iter().zip(&expected);
        let bad = pairs.filter(|(found, (_, is_right))| !is_right(**found));
        wrong.extend(bad.map(|(found, (argument, _))| format!("{function} of {argument:e} is {found:e}")));
    }
    let mut what = "exp and exp2 of ±∞, −1e30, ±200 and 0 are 0, 1 or ∞, and of NaN not finite".to_owned();
    if !wrong.is_empty() {
        what = format!("{what}; {}", wrong.join(", "));
    }
    lab.none("special values", what, wrong.len(), "wrong values");
    Ok(())
}

/// Longest loop tested, in iterations: a fraction of a second on any device.
const TURNS_MAX: u32 = 1 << 22;

fn loops(lab: &mut StressRun<'_>) -> Result<()> {
    let gpu = lab.gpu;
    let choice = selftest_loops::Choice::default();
    let kernel = SelftestLoops::new(gpu, choice)?;
    let lanes = choice.spec.workgroup;
    let found = gpu.buffer::<u32>("selftest", lanes as usize)?;
    let runs_to_its_end = |turns: u32| -> Result<bool> {
        let io = selftest_loops::Bindings { found: &found };
        gpu.run(|rec| kernel.record(rec, io, selftest_loops::Params { turns }, Groups::Count(1)))?;
        let expected: Vec<u32> = (0..lanes).map(|i| selftest::chain(i, turns)).collect();
        Ok(read(gpu, &found)? == expected)
    };
    let longest = longest(TURNS_MAX, runs_to_its_end)?;
    let needed = loop_turns(gpu.caps().kind);
    let what = match needed < TURNS_MAX {
        true => "the longest loop that runs to its end; longer lists are drawn in several passes",
        false => "the longest loop that runs to its end; no more are tried",
    };
    let pair = [longest.into(), needed.min(TURNS_MAX).into()];
    let outcome = StressCheck::at_least(lab.group, "length of loops", what, pair, "turns");
    lab.found.outcomes.push(outcome);
    Ok(())
}

/// Largest number up to `most` for which `holds` is true, by bisection; 0 if for none.
fn longest(most: u32, mut holds: impl FnMut(u32) -> Result<bool>) -> Result<u32> {
    if holds(most)? {
        return Ok(most);
    }
    let (mut good, mut bad) = (0, most);
    while bad - good > 1 {
        let middle = good + (bad - good) / 2;
        match holds(middle)? {
            true => good = middle,
            false => bad = middle,
        }
    }
    Ok(good)
}

fn progress(lab: &mut StressRun<'_>) -> Result<()> {
    let gpu = lab.gpu;
    // Beyond the group limit of one dimension on any device.
    const GROUPS: u32 = 70_000;
    const ROUNDS: u32 = 3;
    let choice = selftest_progress::Choice::default();
    let kernel = SelftestProgress::new(gpu, choice)?;
    let counts = gpu.buffer_from("selftest", &vec![0u32; GROUPS as usize])?;
    let found = gpu.buffer::<u32>("selftest", GROUPS as usize)?;
    let io = selftest_progress::Bindings {
        counts: &counts,
        found: &found,
    };
    let params = selftest_progress::Params {
        group_count: GROUPS,
        rounds: ROUNDS,
    };
    gpu.run(|rec| kernel.record(rec, io, params, Groups::Count(GROUPS)))?;
    let expected = selftest::progress(GROUPS, choice.spec.workgroup, ROUNDS);
    let wrong = unequal(&read(gpu, &counts)?, &vec![1; GROUPS as usize]) + unequal(&read(gpu, &found)?, &expected);
    let what = format!(
        "{} workgroups run once each, their lanes on unequal ways to common barriers; no kernel waits for another \
         workgroup",
        number(GROUPS.into())
    );
    lab.none("forward progress", what, wrong, "wrong groups");
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_loop_is_found() -> Result<()> {
        for limit in [0, 1, 65_535, 65_536, 999_999, 1_000_000] {
            assert_eq!(longest(1_000_000, |turns| Ok(turns <= limit))?, limit);
        }
        Ok(())
    }
}
