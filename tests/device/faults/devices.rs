//! Lost devices and exhausted device memory.

use crate::common::device::{self, Turn};
use crate::faults::run::{STEPS, holds_only, scene, train, undisturbed};
use ashfall::Error;
use ashfall::gpu::{Faults, Gpu, GpuOptions};
use ashfall::kernels::compact::{self, Compact};
use std::collections::BTreeSet;
use std::rc::Rc;

/// A validated device with fault injection, and the handle of its faults.
fn faulty() -> (Rc<Turn>, Gpu, Faults) {
    let turn = device::turn();
    let faults = Faults::default();
    let options = GpuOptions {
        faults: Some(faults.clone()),
        ..device::options()
    };
    (turn, Gpu::create(&options).unwrap(), faults)
}

/// Runs the training with a failure at every `stride`-th of the calls counted by `count`, and resumes each on a healthy
/// device from the files on disk. Returns the errors.
fn fail_everywhere(stride: usize, count: fn(&Faults) -> u64, fail: fn(&Faults, u64)) -> Vec<Error> {
    let healthy = device::gpu();
    let expected = undisturbed(&healthy);
    let (_turn, gpu, faults) = faulty();
    let before = count(&faults);
    undisturbed(&gpu);
    let calls = count(&faults);
    drop(gpu);
    assert_eq!(faults.validation_messages(), [""; 0], "without a failure");
    let moments = (before + 1..=calls).step_by(stride);
    println!("{calls} calls, a failure at {} of them", moments.clone().count());
    let errors = moments.map(|n| {
        let folder = tempfile::tempdir().unwrap();
        let (_turn, gpu, faults) = faulty();
        fail(&faults, n);
        let error = train(&gpu, folder.path()).expect_err("the failure goes unnoticed");
        assert!(!folder.path().join("scene.ply").exists());
        drop(gpu);
        assert!(
            faults.is_device_gone(),
            "call {n} failed ({error}): something still holds the device"
        );
        let said = faults.validation_messages();
        assert_eq!(said, [""; 0], "call {n} failed ({error}): leaks, or a misuse of Vulkan");
        holds_only(folder.path(), &["checkpoint"]);
        train(&healthy, folder.path()).unwrap();
        assert!(
            scene(folder.path()) == expected,
            "call {n} failed ({error}): the rest differs"
        );
        error
    });
    errors.collect()
}

fn losses(stride: usize) {
    let errors = fail_everywhere(stride, Faults::submissions, Faults::lose_device_at);
    let mut steps = BTreeSet::new();
    for error in errors {
        assert!(
            error.to_string().ends_with("vkQueueSubmit2 failed: ERROR_DEVICE_LOST"),
            "{error}"
        );
        if let Error::Step { iteration, .. } = error {
            steps.insert(iteration);
        }
    }
    assert_eq!(steps, (1..=STEPS).collect(), "a loss in every step, named");
}

fn shortages(stride: usize) {
    let errors = fail_everywhere(stride, Faults::creations, Faults::fail_creation);
    for error in errors {
        let text = error.to_string();
        assert!(
            text.contains("OUT_OF_DEVICE_MEMORY") || text.contains("out of device memory"),
            "{text}"
        );
    }
}

#[test]
fn f106_a_lost_device_ends_the_step_by_name_and_training_goes_on_from_the_checkpoint() {
    losses(13);
}

#[test]
#[ignore = "a loss at every submission: minutes; `make soak`"]
fn f106_a_device_lost_at_any_submission() {
    losses(1);
}

#[test]
fn f107_memory_that_ends_is_a_clean_error_and_leaks_nothing() {
    shortages(61);
}

#[test]
#[ignore = "a failure of every creation: minutes; `make soak`"]
fn f107_memory_that_ends_at_any_creation() {
    shortages(1);
}

/// Images are made by benches and tests only, so training does not cover them.
#[test]
fn f107_an_image_whose_memory_ends_leaks_nothing() {
    let (_turn, gpu, faults) = faulty();
    let before = faults.creations();
    drop(gpu.image("picture", [9, 7]).unwrap());
    let calls = faults.creations() - before;
    drop(gpu);
    for n in 1..=calls {
        let (_turn, gpu, faults) = faulty();
        faults.fail_creation(before + n);
        gpu.image("picture", [9, 7]).expect_err("the failure goes unnoticed");
        assert_eq!(gpu.memory_in_use(), 0, "creation {n} failed");
        drop(gpu);
        assert!(faults.is_device_gone(), "creation {n} failed");
        assert_eq!(faults.validation_messages(), [""; 0], "creation {n} failed");
    }
}

#[test]
fn a_device_compiles_a_kernel_once_and_destroys_it() {
    let (_turn, gpu, faults) = faulty();
    let choice = compact::Choice::default();
    let mut other = choice;
    other.spec.workgroup /= 2;
    let creations = |choice| {
        let before = faults.creations();
        let made = Compact::new(&gpu, choice).unwrap();
        (faults.creations() - before, made)
    };
    let (first, held) = creations(choice);
    assert!(first > 0);
    assert_eq!(creations(choice).0, 0, "shared");
    assert_eq!(creations(other).0, first, "of another size");
    drop(held);
    let (again, held) = creations(choice);
    assert_eq!(again, 0, "kept");
    drop(gpu);
    assert!(!faults.is_device_gone(), "pipelines hold their device");
    drop(held);
    assert!(faults.is_device_gone());
    assert_eq!(faults.validation_messages(), [""; 0]);
}

/// Negative check of the leak detection: a buffer that is never dropped keeps its device.
#[test]
fn f107_a_leak_is_noticed() {
    let (_turn, gpu, faults) = faulty();
    let buffer = gpu.buffer::<u32>("leaked", 4).unwrap();
    drop(gpu);
    assert!(!faults.is_device_gone());
    drop(buffer);
    assert!(faults.is_device_gone());
}

#[test]
fn f107_a_device_whose_memory_ended_goes_on_working() {
    let (_turn, gpu, faults) = faulty();
    let expected = undisturbed(&gpu);
    for n in [1, 10, 100] {
        faults.fail_creation(faults.creations() + n);
        let folder = tempfile::tempdir().unwrap();
        train(&gpu, folder.path()).expect_err("the failure goes unnoticed");
        assert!(undisturbed(&gpu) == expected, "after a failure of the {n}-th creation");
    }
    assert_eq!(gpu.memory_in_use(), 0, "bytes of buffers that nobody holds");
    drop(gpu);
    assert_eq!(faults.validation_messages(), [""; 0]);
}
