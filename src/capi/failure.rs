//! Results of the C interface: codes, the message of a thread's last failure, and panics turned into both.

use crate::Error;
use std::cell::RefCell;
use std::ffi::{CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Result of a function: ASHFALL_OK or one of the errors, which are negative.
pub type AshfallResult = i32;

/// Success.
pub const ASHFALL_OK: AshfallResult = 0;
/// A null pointer, a destroyed or foreign handle, a structure of no known size, a value out of range. Nothing was
/// recorded: images stay in their states before.
pub const ASHFALL_ERROR_ARGUMENT: AshfallResult = -1;
/// The device, or this build, lacks something.
pub const ASHFALL_ERROR_UNSUPPORTED: AshfallResult = -2;
/// The device's memory, or the limit set for it, is used up.
pub const ASHFALL_ERROR_MEMORY: AshfallResult = -3;
/// A Vulkan function failed.
pub const ASHFALL_ERROR_VULKAN: AshfallResult = -4;
/// A file cannot be read, or holds something else.
pub const ASHFALL_ERROR_FILE: AshfallResult = -5;
/// Arguments contradict each other or the options of the renderer.
pub const ASHFALL_ERROR_CONFIG: AshfallResult = -6;
/// A fault of the library. The renderer concerned refuses further calls.
pub const ASHFALL_ERROR_INTERNAL: AshfallResult = -7;

/// A failed call: its result and message.
#[derive(Debug)]
pub(super) struct Failure {
    pub(super) code: AshfallResult,
    pub(super) message: String,
}

impl Failure {
    /// A refused argument.
    pub(super) fn argument(message: impl Into<String>) -> Failure {
        Failure {
            code: ASHFALL_ERROR_ARGUMENT,
            message: message.into(),
        }
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Failure {
        let code = match &error {
            Error::File { .. } | Error::Io { .. } => ASHFALL_ERROR_FILE,
            Error::Vulkan { .. } => ASHFALL_ERROR_VULKAN,
            Error::Unsupported { .. } => ASHFALL_ERROR_UNSUPPORTED,
            Error::OutOfMemory { .. } => ASHFALL_ERROR_MEMORY,
            Error::Config(_) => ASHFALL_ERROR_CONFIG,
            Error::Mismatch { .. } | Error::Step { .. } => ASHFALL_ERROR_INTERNAL,
        };
        Failure {
            code,
            message: error.to_string(),
        }
    }
}

thread_local! {
    static LAST: RefCell<CString> = RefCell::default();
}

/// Message of the last failed call of this thread, in UTF-8; empty after a successful one. Valid until the thread's
/// next call of the library. Never null.
#[unsafe(no_mangle)]
pub extern "C" fn ashfall_last_error() -> *const c_char {
    // The thread may be ending, when its messages are gone.
    LAST.try_with(|last| last.try_borrow().map_or(c"".as_ptr(), |text| text.as_ptr()))
        .unwrap_or(c"".as_ptr())
}

fn remember(message: &str) {
    let text = CString::new(message.replace('\0', " ")).unwrap_or_default();
    // An error that cannot be kept still has its code.
    let _ = LAST.try_with(|last| last.try_borrow_mut().map(|mut last| *last = text));
}

/// Runs a call: its failure or panic becomes the result and the thread's message.
pub(super) fn guard(call: impl FnOnce() -> Result<(), Failure>) -> AshfallResult {
    let failure = match catch_unwind(AssertUnwindSafe(call)) {
        Ok(Ok(())) => {
            remember("");
            return ASHFALL_OK;
        }
        Ok(Err(failure)) => failure,
        Err(payload) => {
            let text = payload.downcast_ref::<&str>().copied();
            let text = text.or(payload.downcast_ref::<String>().map(String::as_str));
            let message = format!("a fault of the library: {}", text.unwrap_or("a panic"));
            // Its destructor is foreign code, which might panic again.
            std::mem::forget(payload);
            Failure {
                code: ASHFALL_ERROR_INTERNAL,
                message,
            }
        }
    };
    remember(&failure.message);
    failure.code
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ffi::CStr;

    fn last() -> String {
        // SAFETY: a C string of this thread.
        let text = unsafe { CStr::from_ptr(ashfall_last_error()) };
        text.to_string_lossy().into_owned()
    }

    #[test]
    fn panics_become_results_with_their_messages() {
        let caught = guard(|| panic!("on purpose, number {}", 1));
        assert_eq!(caught, ASHFALL_ERROR_INTERNAL);
        assert_eq!(last(), "a fault of the library: on purpose, number 1");
        let caught = guard(|| std::panic::panic_any(7));
        assert_eq!(
            (caught, last().as_str()),
            (ASHFALL_ERROR_INTERNAL, "a fault of the library: a panic")
        );
        assert_eq!((guard(|| Ok(())), last().as_str()), (ASHFALL_OK, ""));
    }

    #[test]
    fn messages_are_of_their_thread() {
        let refused = guard(|| Err(Failure::argument("a\0b")));
        assert_eq!((refused, last().as_str()), (ASHFALL_ERROR_ARGUMENT, "a b"));
        std::thread::spawn(|| assert_eq!(last(), "")).join().unwrap();
        let out_of_memory = Error::OutOfMemory {
            name: "image".into(),
            wanted: 2,
            available: 1,
        };
        assert_eq!(guard(|| Err(out_of_memory.into())), ASHFALL_ERROR_MEMORY);
        assert!(last().contains("image"));
    }
}
