//! The device that tests run on. There is always one: a software device is part of the set-up, so a
//! missing device fails the tests.

use ashfall::gpu::{Faults, Gpu, GpuOptions};
use std::ops::Deref;

/// A device with validation on. Dropping it fails the test if the validation layer said anything; where it is the
/// last handle, that includes what was leaked.
pub(crate) struct TestGpu {
    gpu: Option<Gpu>,
    faults: Faults,
}

/// Creates one.
pub(crate) fn gpu() -> TestGpu {
    limited(None)
}

/// Creates one that has so many bytes of memory.
pub(crate) fn limited(memory_limit: Option<u64>) -> TestGpu {
    let faults = Faults::default();
    let options = GpuOptions {
        validation: true,
        device: Some("0".into()),
        memory_limit,
        faults: Some(faults.clone()),
    };
    let gpu = Gpu::create(&options).unwrap_or_else(|e| panic!("no device to test on: {e}"));
    TestGpu {
        gpu: Some(gpu),
        faults,
    }
}

impl Deref for TestGpu {
    type Target = Gpu;

    fn deref(&self) -> &Gpu {
        match &self.gpu {
            Some(gpu) => gpu,
            None => unreachable!("there is a device until it is dropped"),
        }
    }
}

impl Drop for TestGpu {
    fn drop(&mut self) {
        self.gpu = None;
        if !std::thread::panicking() {
            assert_eq!(
                self.faults.validation_messages(),
                Vec::<String>::new(),
                "validation messages"
            );
        }
    }
}
