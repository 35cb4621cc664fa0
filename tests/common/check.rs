//! Checks of a kernel's outputs against the oracle, with a check of the check: every output is falsified once, and a
//! comparison that accepts the falsified one fails the test.

#![allow(
    dead_code,
    unreachable_pub,
    reason = "shared by test binaries, each of which uses its own part"
)]

use ashfall::gpu::{Buffer, Gpu};
use ashfall::kernels::Kernel;
use ashfall::lab::bench::kernels::{KernelCase, Workgroups};
use ashfall::layout::DispatchArgs;
use bytemuck::Pod;
use std::collections::BTreeMap;

pub use ashfall::lab::bench::check::{Output, UNWRITTEN, floats, rms, words};

/// The checks of one kernel.
pub struct Check {
    kernel: &'static str,
    /// By output: the largest error, and whether a falsified output was tried.
    seen: BTreeMap<&'static str, (f64, bool)>,
}

impl Check {
    /// A check without outputs yet.
    pub fn new(kernel: &'static str) -> Check {
        Check {
            kernel,
            seen: BTreeMap::new(),
        }
    }

    /// Compares the outputs of one run and then falsifies them.
    #[track_caller]
    pub fn outputs(&mut self, case: &str, outputs: Vec<Output>) {
        for output in outputs {
            let (kernel, name) = (self.kernel, output.name);
            let worst = output
                .judge()
                .unwrap_or_else(|fault| panic!("{kernel}, {case}: {name}: {fault}"));
            let falsified = output.falsified();
            let entry = self.seen.entry(name).or_default();
            entry.0 = entry.0.max(worst);
            entry.1 |= !falsified.is_empty();
            for lie in falsified {
                assert!(
                    output.accepts(&lie).is_err(),
                    "{kernel}, {case}: {name}: the check does not notice a falsehood"
                );
            }
        }
    }

    /// Runs cases of one kernel in every choice that the device can run, compares their outputs and falsifies them.
    #[track_caller]
    pub fn cases<K: Kernel>(
        &mut self,
        gpu: &Gpu,
        workgroups: Workgroups,
        cases: &[(impl std::fmt::Display, KernelCase<'_, K>)],
    ) {
        for (choice, _) in workgroups.choices::<K>(gpu.caps()) {
            let mut compiled: Option<(K::Choice, K)> = None;
            for (name, case) in cases.iter().filter(|(_, case)| case.takes(&choice)) {
                let choice = case.tuned(choice);
                let kernel = match compiled.take() {
                    Some((same, kernel)) if same == choice => kernel,
                    _ => K::compile(gpu, choice).unwrap(),
                };
                case.run(gpu, &kernel, &choice).unwrap();
                let outputs = case.outputs(gpu).unwrap();
                self.outputs(&format!("{name}, {choice:?}"), outputs);
                compiled = Some((choice, kernel));
            }
        }
    }

    /// Prints the largest errors; asserts that every output was falsified in some case.
    #[track_caller]
    pub fn finish(self) {
        assert!(!self.seen.is_empty(), "{}: nothing checked", self.kernel);
        for (name, (worst, falsified)) in self.seen {
            println!("{:20} {name:24} largest error {worst:.1e}", self.kernel);
            assert!(falsified, "{}: {name} was empty in every case", self.kernel);
        }
    }
}

/// A buffer with the contents of `data`.
pub fn buffer<T: Pod>(gpu: &Gpu, data: &[T]) -> Buffer<T> {
    gpu.buffer_from("input", data).expect("no room for a test")
}

/// A buffer of `len` unwritten elements.
pub fn unwritten<T: Pod>(gpu: &Gpu, len: usize) -> Buffer<T> {
    gpu.buffer("output", len).expect("no room for a test")
}

/// Contents of a whole buffer.
pub fn read<T: Pod>(gpu: &Gpu, buffer: &Buffer<T>) -> Vec<T> {
    gpu.download(buffer, 0..buffer.len()).expect("cannot read back")
}

/// The slots of `counts`, with some of them set.
pub fn counts(gpu: &Gpu, slots: &[(u32, u32)]) -> Buffer<u32> {
    let mut counts = [0; ashfall::layout::COUNT_SLOTS as usize];
    for &(slot, value) in slots {
        counts[slot as usize] = value;
    }
    buffer(gpu, &counts)
}

/// Arguments of one indirect dispatch: one invocation for each of `count` elements.
pub fn args(gpu: &Gpu, count: usize, workgroup: u32) -> Buffer<DispatchArgs> {
    let x = (count as u32).div_ceil(workgroup);
    let y = u32::from(x > 0);
    buffer(gpu, &[DispatchArgs { x, y, z: 1 }])
}
