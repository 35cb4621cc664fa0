//! Device self-tests: every variant against the expected results.

use crate::common::check::*;
use crate::common::device;
use ashfall::gpu::{Gpu, Groups};
use ashfall::kernels::{selftest_atomics, selftest_lanes, selftest_loops, selftest_math, selftest_progress};
use ashfall::reference::selftest::{self, FUNCTIONS};

/// The variants that the device can run.
macro_rules! supported {
    ($kernel:ident, $gpu:expr) => {
        ashfall::kernels::$kernel::Variant::ALL
            .iter()
            .copied()
            .filter(|variant| $gpu.caps().supports(variant.info()).is_ok())
    };
}

fn zeros(gpu: &Gpu, len: usize) -> ashfall::gpu::Buffer<u32> {
    buffer(gpu, &vec![0u32; len])
}

#[test]
fn atomics_lose_nothing() {
    let gpu = device::gpu();
    let mut check = Check::new("selftest_atomics");
    for variant in supported!(selftest_atomics, gpu) {
        let cases = [(1u32, 64), (64, 8), (1000, 64), (20_000, 128)];
        let most = gpu.caps().max_workgroup;
        for (invocations, workgroup) in cases.into_iter().filter(|(_, size)| *size <= most) {
            let spec = selftest_atomics::Spec { workgroup };
            let choice = selftest_atomics::Choice { variant, spec };
            let kernel = selftest_atomics::SelftestAtomics::new(&gpu, choice).unwrap();
            let expected = selftest::atomics(invocations);
            let counts = zeros(&gpu, expected.len());
            let io = selftest_atomics::Bindings { counts: &counts };
            let params = selftest_atomics::Params {
                invocation_count: invocations,
            };
            let groups = invocations.div_ceil(workgroup);
            gpu.run(|rec| kernel.record(rec, io, params, Groups::Count(groups)))
                .unwrap();
            let found = words(&read(&gpu, &counts));
            check.outputs(
                &format!("{invocations} invocations of {workgroup}"),
                vec![Output::exact("counts", found, words(&expected))],
            );
        }
    }
    check.finish();
}

#[test]
fn lanes_understand_each_other() {
    let gpu = device::gpu();
    let mut check = Check::new("selftest_lanes");
    for variant in supported!(selftest_lanes, gpu) {
        for rounds in [1, 100] {
            let choice = selftest_lanes::Choice::of_variant(gpu.caps(), variant);
            let lanes = choice.spec.workgroup;
            let kernel = selftest_lanes::SelftestLanes::new(&gpu, choice).unwrap();
            let found = unwritten::<u32>(&gpu, 8 * lanes as usize);
            let io = selftest_lanes::Bindings { found: &found };
            let params = selftest_lanes::Params { rounds };
            gpu.run(|rec| kernel.record(rec, io, params, Groups::Count(1))).unwrap();
            let expected = selftest::lanes(lanes, rounds);
            check.outputs(
                &format!("{}, {lanes} lanes, {rounds} rounds", variant.name()),
                vec![Output::exact("results", words(&read(&gpu, &found)), words(&expected))],
            );
        }
    }
    check.finish();
}

#[test]
fn loops_of_a_few_turns_end_where_they_should() {
    let gpu = device::gpu();
    let mut check = Check::new("selftest_loops");
    let choice = selftest_loops::Choice::default();
    let kernel = selftest_loops::SelftestLoops::new(&gpu, choice).unwrap();
    for turns in [0, 1, 1000, 40_000] {
        let lanes = choice.spec.workgroup;
        let found = unwritten::<u32>(&gpu, lanes as usize);
        let io = selftest_loops::Bindings { found: &found };
        gpu.run(|rec| kernel.record(rec, io, selftest_loops::Params { turns }, Groups::Count(1)))
            .unwrap();
        let expected: Vec<u32> = (0..lanes).map(|i| selftest::chain(i, turns)).collect();
        check.outputs(
            &format!("{turns} turns"),
            vec![Output::exact("ends", words(&read(&gpu, &found)), words(&expected))],
        );
    }
    check.finish();
}

#[test]
fn groups_run_once_and_lanes_arrive() {
    let gpu = device::gpu();
    let mut check = Check::new("selftest_progress");
    let choice = selftest_progress::Choice::default();
    let kernel = selftest_progress::SelftestProgress::new(&gpu, choice).unwrap();
    for groups in [1, 1000, 66_000] {
        let counts = zeros(&gpu, groups as usize);
        let found = unwritten::<u32>(&gpu, groups as usize);
        let io = selftest_progress::Bindings {
            counts: &counts,
            found: &found,
        };
        let params = selftest_progress::Params {
            group_count: groups,
            rounds: 3,
        };
        gpu.run(|rec| kernel.record(rec, io, params, Groups::Count(groups)))
            .unwrap();
        let expected = selftest::progress(groups, choice.spec.workgroup, 3);
        check.outputs(
            &format!("{groups} groups"),
            vec![
                Output::exact("runs", words(&read(&gpu, &counts)), vec![1.0; groups as usize]),
                Output::exact("results", words(&read(&gpu, &found)), words(&expected)),
            ],
        );
    }
    check.finish();
}

#[test]
fn functions_are_as_exact_as_they_must_be() {
    let gpu = device::gpu();
    let mut check = Check::new("selftest_math");
    let choice = selftest_math::Choice::default();
    let kernel = selftest_math::SelftestMath::new(&gpu, choice).unwrap();
    let arguments: Vec<f32> = (1..=997).map(|i| i as f32 * 0.0625).collect();
    let count = arguments.len();
    let found = unwritten::<f32>(&gpu, FUNCTIONS.len() * count);
    let io = selftest_math::Bindings {
        arguments: &buffer(&gpu, &arguments),
        found: &found,
    };
    let params = selftest_math::Params {
        argument_count: count as u32,
    };
    let groups = (count as u32).div_ceil(choice.spec.workgroup);
    gpu.run(|rec| kernel.record(rec, io, params, Groups::Count(groups)))
        .unwrap();
    let found = floats(&read(&gpu, &found));
    for (function, found) in FUNCTIONS.iter().zip(found.chunks(count)) {
        // In units of what each may be off by.
        let allowed = |(&x, found): (&f32, &f64)| {
            let x = f64::from(x);
            (found - function.exact(x)) / function.allowance(x)
        };
        let errors: Vec<f64> = arguments.iter().zip(found).map(allowed).collect();
        let zeros = vec![0.0; count];
        let output = Output::relative("errors", errors.clone(), zeros, 1.0, 1.0);
        let worst = output.judge().unwrap_or_else(|e| panic!("{function:?}: {e}"));
        println!("{function:?}: {worst:.2} of its allowance");
        let mut lie = errors;
        lie[500] += 2.5;
        assert!(output.accepts(&lie).is_err());
    }
    // The check that a falsehood shows: exact values off by a percent.
    let exact: Vec<f64> = arguments.iter().map(|&x| f64::from(x).exp2()).collect();
    check.outputs(
        "2^x",
        vec![Output::relative(
            "exp2",
            found[count..2 * count].to_vec(),
            exact,
            1e-4,
            1.0,
        )],
    );
    check.finish();
}
