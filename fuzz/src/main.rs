//! The targets of `tests/slow/fuzz` under libFuzzer. `FUZZ_TARGET` selects the target of a process; the other arguments
//! are libFuzzer's. `scripts/fuzz` builds this with coverage and runs it.

#![no_main]

#[path = "../../tests/slow/fuzz/execute.rs"]
mod execute;
#[path = "../../tests/slow/fuzz/mutate.rs"]
mod mutate;
#[path = "../../tests/slow/fuzz/repair.rs"]
mod repair;
#[rustfmt::skip]
#[path = "../../tests/slow/fuzz/targets.rs"]
mod targets;

use libfuzzer_sys::{fuzz_mutator, fuzz_target, fuzzer_mutate};
use mutate::{Random, mutate};
use std::sync::LazyLock;
use targets::{TARGETS, Target};

/// The folder of the photograph and the point cloud to which inputs may refer.
const BESIDE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/slow/fuzz/beside");

static TARGET: LazyLock<&Target> = LazyLock::new(|| {
    let name = std::env::var("FUZZ_TARGET").unwrap_or_default();
    let known = TARGETS.iter().find(|target| target.name == name);
    known.unwrap_or_else(|| {
        let names: Vec<_> = TARGETS.iter().map(|target| target.name).collect();
        panic!("FUZZ_TARGET is {name:?}; there are {}", names.join(", "))
    })
});

fuzz_target!(|bytes: &[u8]| {
    execute::execute(&TARGET, bytes);
});

// Half of the mutations are libFuzzer's, guided by the comparisons in the code; half are of numbers and lines.
// Checksums are repaired after most of either.
fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
    let mut random = Random(u64::from(seed));
    let mut size = size;
    if random.below(2) == 0 {
        size = fuzzer_mutate(data, size, max_size);
    } else {
        let mut bytes = data[..size].to_vec();
        let other = bytes.clone();
        mutate(&mut random, &mut bytes, &other, TARGET.words, max_size);
        size = bytes.len();
        data[..size].copy_from_slice(&bytes);
    }
    if random.below(4) > 0 {
        let mut bytes = data[..size].to_vec();
        (TARGET.repair)(&mut bytes);
        bytes.truncate(max_size);
        size = bytes.len();
        data[..size].copy_from_slice(&bytes);
    }
    size
});
