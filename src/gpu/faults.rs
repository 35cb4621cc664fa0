//! Fault injection for tests: failing creations, a lost device, and validation messages after destruction.

use super::debug::Messages;
use crate::{Error, Result};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

/// Injects failures into one device, counts its calls, and keeps its validation messages, leaks included, beyond its
/// destruction. Clones are handles of the same state.
#[derive(Clone, Debug, Default)]
pub struct Faults(Arc<FaultState>);

#[derive(Debug, Default)]
struct FaultState {
    creation: CallCounter,
    submission: CallCounter,
    is_lost: AtomicBool,
    messages: OnceLock<Arc<Messages>>,
}

/// Counter of one kind of call, from 1.
#[derive(Debug, Default)]
struct CallCounter {
    /// Number of the failing call; 0: none.
    fails: AtomicU64,
    done: AtomicU64,
}

impl CallCounter {
    /// Counts a call; true if it has to fail.
    fn is_due(&self) -> bool {
        let number = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        number == self.fails.load(Ordering::Relaxed)
    }
}

impl Faults {
    /// Fails the `n`-th creation of a Vulkan object from the device on, memory and pipelines included, as out of device
    /// memory; later ones succeed.
    pub fn fail_creation(&self, n: u64) {
        self.0.creation.fails.store(n, Ordering::Relaxed);
    }

    /// Fails the `n`-th submission, and every later call to the queue, as a lost device.
    pub fn lose_device_at(&self, n: u64) {
        self.0.submission.fails.store(n, Ordering::Relaxed);
    }

    /// Objects created so far.
    pub fn creations(&self) -> u64 {
        self.0.creation.done.load(Ordering::Relaxed)
    }

    /// Submissions so far.
    pub fn submissions(&self) -> u64 {
        self.0.submission.done.load(Ordering::Relaxed)
    }

    /// Validation messages of the device; leaked objects included, once the device is destroyed.
    pub fn validation_messages(&self) -> Vec<String> {
        let messages = self.0.messages.get();
        messages.map(|messages| messages.all()).unwrap_or_default()
    }

    /// True if the device has been destroyed, which includes everything made from it.
    pub fn is_device_gone(&self) -> bool {
        let messages = self.0.messages.get();
        messages.is_some_and(|messages| Arc::strong_count(messages) == 1)
    }

    pub(super) fn watch(&self, messages: &Arc<Messages>) {
        // Only the first device is watched.
        let _ = self.0.messages.set(messages.clone());
    }

    pub(super) fn create(&self, call: &'static str) -> Result<()> {
        match self.0.creation.is_due() {
            true => Err(failed(call, "ERROR_OUT_OF_DEVICE_MEMORY")),
            false => Ok(()),
        }
    }

    pub(super) fn submit(&self) -> Result<()> {
        if self.0.submission.is_due() {
            self.0.is_lost.store(true, Ordering::Relaxed);
        }
        self.use_queue("vkQueueSubmit2")
    }

    pub(super) fn use_queue(&self, call: &'static str) -> Result<()> {
        match self.0.is_lost.load(Ordering::Relaxed) {
            true => Err(failed(call, "ERROR_DEVICE_LOST")),
            false => Ok(()),
        }
    }
}

fn failed(call: &'static str, result: &str) -> Error {
    Error::Vulkan {
        call,
        result: result.to_owned(),
    }
}
