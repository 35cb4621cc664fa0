//! Ctrl-C: the first asks for an orderly end, the second ends at once.

use super::EXIT_INTERRUPTED;
use crate::{Error, Result};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether the user asked to stop (SIGINT, or SIGTERM from a job scheduler).
#[derive(Clone, Debug, Default)]
pub(super) struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Listens from now on. A process can do this once.
    pub(crate) fn listen() -> Result<Interrupt> {
        let interrupt = Interrupt::default();
        let heard = interrupt.clone();
        let installed = ctrlc::set_handler(move || {
            if heard.0.swap(true, Ordering::Relaxed) {
                std::process::exit(i32::from(EXIT_INTERRUPTED));
            }
            eprintln!(
                "\nstopping after this step; Ctrl-C again stops at once, without a checkpoint"
            );
        });
        installed.map_err(|e| Error::Config(format!("cannot listen for Ctrl-C: {e}")))?;
        Ok(interrupt)
    }

    /// Whether to stop.
    pub(crate) fn is_requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// As if the user had asked.
    #[cfg(test)]
    pub(crate) fn request(&self) {
        self.0.store(true, Ordering::Relaxed);
    }
}
