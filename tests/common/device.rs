//! The device that tests run on. There is always one: a software device is part of the set-up, so a
//! missing device fails the tests.

use ashfall::gpu::{Gpu, GpuOptions};
use std::ops::Deref;

/// A device with validation on; dropping it fails the test if the validation layer said anything.
pub(crate) struct TestGpu(Gpu);

/// Creates one.
pub(crate) fn gpu() -> TestGpu {
    limited(None)
}

/// Creates one that has so many bytes of memory.
pub(crate) fn limited(memory_limit: Option<u64>) -> TestGpu {
    let options = GpuOptions {
        validation: true,
        device: Some("0".into()),
        memory_limit,
    };
    TestGpu(Gpu::create(&options).unwrap_or_else(|error| panic!("no device to test on: {error}")))
}

impl Deref for TestGpu {
    type Target = Gpu;

    fn deref(&self) -> &Gpu {
        &self.0
    }
}

impl Drop for TestGpu {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            assert_eq!(
                self.0.validation_messages(),
                Vec::<String>::new(),
                "validation messages"
            );
        }
    }
}
