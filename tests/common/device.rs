//! The device of the tests. There is always one: a software device is part of the set-up, so a missing device fails the
//! tests.
//!
//! `ASHFALL_TEST_LIMITS` lowers its limits for all tests alike, e.g.
//! `binding=8388608,memory=536870912,workgroup=128,subgroups=off`.

use ashfall::gpu::{Faults, Gpu, GpuOptions, Limits};
use std::cell::RefCell;
use std::ops::Deref;
use std::rc::{Rc, Weak};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Exclusive use of devices: until it is dropped no other test of the process has any.
///
/// The validation layer (1.3.239) looks devices up in a table without a lock: a call to one occasionally crashes while
/// another is created or destroyed.
pub(crate) struct Turn(#[expect(dead_code, reason = "held, not read")] MutexGuard<'static, ()>);

/// Waits for this thread's turn, or shares its current one.
pub(crate) fn turn() -> Rc<Turn> {
    static DEVICES: Mutex<()> = Mutex::new(());
    thread_local!(static MINE: RefCell<Weak<Turn>> = const { RefCell::new(Weak::new()) });
    MINE.with_borrow_mut(|mine| {
        mine.upgrade().unwrap_or_else(|| {
            WAITING.fetch_add(1, Ordering::SeqCst);
            // A failed test no longer uses its devices.
            let guard = DEVICES.lock().unwrap_or_else(PoisonError::into_inner);
            WAITING.fetch_sub(1, Ordering::SeqCst);
            let turn = Rc::new(Turn(guard));
            *mine = Rc::downgrade(&turn);
            turn
        })
    })
}

impl Drop for Turn {
    fn drop(&mut self) {
        if WAITING.load(Ordering::SeqCst) == 0
            && let Some(last) = idle().take()
        {
            last.destroy();
        }
    }
}

/// Tests that wait for their turn.
static WAITING: AtomicUsize = AtomicUsize::new(0);

/// Device between two tests, destroyed where no test waits for its turn.
fn idle() -> MutexGuard<'static, Option<Validated>> {
    static IDLE: Mutex<Option<Validated>> = Mutex::new(None);
    IDLE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A device with validation on.
struct Validated {
    gpu: Gpu,
    faults: Faults,
}

impl Validated {
    /// Destroys the device, if this is the last handle, and fails if there are validation messages; those of leaks are
    /// included.
    fn destroy(self) {
        drop(self.gpu);
        if !std::thread::panicking() {
            assert_eq!(self.faults.validation_messages(), [""; 0], "validation messages");
        }
    }
}

/// A device with validation on. Dropping it fails the test if there are validation messages.
pub(crate) struct TestGpu {
    device: Option<Validated>,
    is_shared: bool,
    _turn: Rc<Turn>,
}

/// Device with the default test options, of an earlier test if there is one between two tests: a software device
/// compiles each kernel anew for each device.
pub(crate) fn gpu() -> TestGpu {
    let turn = turn();
    let device = idle().take();
    if let Some(device) = &device {
        device.gpu.reset_memory_peak();
    }
    TestGpu {
        device: Some(device.unwrap_or_else(|| validated(&options()))),
        is_shared: true,
        _turn: turn,
    }
}

/// Creates a device with a memory limit in bytes.
pub(crate) fn limited(memory_limit: Option<u64>) -> TestGpu {
    create(&GpuOptions {
        memory_limit,
        ..options()
    })
}

/// Creates a device with bindings of at most this many bytes.
pub(crate) fn narrow(binding: u64) -> TestGpu {
    let mut options = options();
    let most = options.limits.binding.unwrap_or(u64::MAX);
    options.limits.binding = Some(most.min(binding));
    create(&options)
}

fn create(options: &GpuOptions) -> TestGpu {
    let turn = turn();
    TestGpu {
        device: Some(validated(options)),
        is_shared: false,
        _turn: turn,
    }
}

fn validated(options: &GpuOptions) -> Validated {
    let faults = Faults::default();
    let options = GpuOptions {
        faults: Some(faults.clone()),
        ..options.clone()
    };
    let gpu = Gpu::create(&options).unwrap_or_else(|e| panic!("no device to test on: {e}"));
    Validated { gpu, faults }
}

/// Creates a device without the limits of `ASHFALL_TEST_LIMITS`, for comparisons with a host's device.
pub(crate) fn whole() -> TestGpu {
    create(&GpuOptions {
        limits: Limits::default(),
        memory_limit: None,
        ..options()
    })
}

/// Options of the device for all tests.
pub(crate) fn options() -> GpuOptions {
    let mut options = GpuOptions {
        validation: true,
        device: Some("0".into()),
        ..GpuOptions::default()
    };
    let text = std::env::var("ASHFALL_TEST_LIMITS").unwrap_or_default();
    for pair in text.split(',').filter(|pair| !pair.is_empty()) {
        let number = |value: &str| value.parse::<u64>().ok();
        let limits: &mut Limits = &mut options.limits;
        match pair.split_once('=') {
            Some(("binding", n)) if number(n).is_some() => limits.binding = number(n),
            Some(("memory", n)) if number(n).is_some() => options.memory_limit = number(n),
            Some(("workgroup", n)) if n.parse::<u32>().is_ok() => limits.workgroup = n.parse().ok(),
            Some(("subgroups", "off")) => limits.without_subgroups = true,
            _ => panic!("ASHFALL_TEST_LIMITS: {pair}?"),
        }
    }
    options
}

impl Deref for TestGpu {
    type Target = Gpu;

    fn deref(&self) -> &Gpu {
        match &self.device {
            Some(device) => &device.gpu,
            None => unreachable!("there is a device until it is dropped"),
        }
    }
}

impl Drop for TestGpu {
    fn drop(&mut self) {
        let Some(device) = self.device.take() else { return };
        // Buffers that are alive may be leaks: the validation layer tells where the device is destroyed.
        let is_clean = !std::thread::panicking()
            && device.gpu.memory_in_use() == 0
            && device.faults.validation_messages().is_empty();
        let mut idle = idle();
        if self.is_shared && is_clean && idle.is_none() && WAITING.load(Ordering::SeqCst) > 0 {
            *idle = Some(device);
        } else {
            device.destroy();
        }
    }
}
