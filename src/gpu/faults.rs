//! Failures on purpose, to test what follows from them, and what a device said that is gone.

use super::debug::Messages;
use crate::{Error, Result};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

/// Makes a device fail at a moment of choice, counts its calls, and keeps what the validation layer says of it,
/// leaks included, beyond its end. Clones are handles of the same one; it serves one device.
#[derive(Clone, Debug, Default)]
pub struct Faults(Arc<State>);

#[derive(Debug, Default)]
struct State {
    creation: Point,
    submission: Point,
    is_lost: AtomicBool,
    messages: OnceLock<Arc<Messages>>,
}

/// A kind of call, counted from 1.
#[derive(Debug, Default)]
struct Point {
    /// The call that fails; 0: none does.
    fails: AtomicU64,
    done: AtomicU64,
}

impl Point {
    /// Counts a call; true if it is the one to fail.
    fn is_due(&self) -> bool {
        let number = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        number == self.fails.load(Ordering::Relaxed)
    }
}

impl Faults {
    /// The `n`-th creation of a Vulkan object from the device on, memory and pipelines included, fails for want of
    /// memory; those after it succeed.
    pub fn fail_creation(&self, n: u64) {
        self.0.creation.fails.store(n, Ordering::Relaxed);
    }

    /// The `n`-th submission finds the device lost, and so does every call to its queue from then on.
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

    /// What the validation layer has said of the device. Once everything made from the device is dropped this has
    /// the objects that were leaked, too.
    pub fn validation_messages(&self) -> Vec<String> {
        let messages = self.0.messages.get();
        messages.map(|messages| messages.all()).unwrap_or_default()
    }

    /// Whether the device has been destroyed: nothing made from it is held any more.
    pub fn is_device_gone(&self) -> bool {
        let messages = self.0.messages.get();
        messages.is_some_and(|messages| Arc::strong_count(messages) == 1)
    }

    pub(super) fn watch(&self, messages: &Arc<Messages>) {
        // A second device is not what this is for; the first goes on being watched.
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
