//! Requests to stop: SIGINT (Ctrl-C) and SIGTERM ask for an orderly end; a second SIGINT ends the process at once.

use super::EXIT_INTERRUPTED;
use crate::{Error, Result};
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag::{register, register_conditional_shutdown};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Stop request of the user or of a job scheduler.
#[derive(Clone, Debug)]
pub(super) struct Interrupt {
    requested: Arc<AtomicBool>,
    announced: Arc<AtomicBool>,
    notice: &'static str,
}

impl Interrupt {
    /// Installs the signal handlers.
    pub(crate) fn listen() -> Result<Interrupt> {
        Interrupt::listen_with("stopping after this step; Ctrl-C stops at once, without a checkpoint")
    }

    /// Installs the signal handlers, with the notice of a request.
    pub(crate) fn listen_with(notice: &'static str) -> Result<Interrupt> {
        let interrupt = Interrupt {
            requested: Arc::default(),
            announced: Arc::default(),
            notice,
        };
        let flag = || Arc::clone(&interrupt.requested);
        // In this order a SIGINT finds the flag set only from the second time on. SIGTERM may be sent several times.
        register_conditional_shutdown(SIGINT, i32::from(EXIT_INTERRUPTED), flag())
            .and_then(|_| register(SIGINT, flag()))
            .and_then(|_| register(SIGTERM, flag()))
            .map_err(|e| Error::Config(format!("cannot listen for signals: {e}")))?;
        Ok(interrupt)
    }

    /// True if a stop is requested; prints a notice the first time.
    pub(crate) fn is_requested(&self) -> bool {
        let is_requested = self.requested.load(Ordering::Relaxed);
        if is_requested && !self.announced.swap(true, Ordering::Relaxed) {
            eprintln!("\n{}", self.notice);
        }
        is_requested
    }
}
