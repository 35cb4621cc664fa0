//! Errors of the environment: files, devices, memory. Programming errors are assertions.

use std::path::{Path, PathBuf};

/// The result of every fallible function of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Error, with all that a reader needs to act on it.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file holds something other than it should.
    #[error("{}: {what}", path.display())]
    File {
        /// The file at fault.
        path: PathBuf,
        /// Fault and, if known, its place (line, byte offset, frame).
        what: String,
    },
    /// The operating system refused an operation on a file.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder concerned.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// A Vulkan call failed.
    #[error("Vulkan: {call} failed: {result}")]
    Vulkan {
        /// The function, e.g. `vkQueueSubmit2`.
        call: &'static str,
        /// The result code's name, e.g. `ERROR_DEVICE_LOST`.
        result: String,
    },
    /// The device, or this build, cannot do what is asked.
    #[error("unsupported: {what}")]
    Unsupported {
        /// Missing feature, and the part that needs it.
        what: String,
    },
    /// A kernel does not compute what the reference says.
    #[error("{kernel}: wrong result: {what}")]
    Mismatch {
        /// The kernel, its input and its variant.
        kernel: String,
        /// Its value and the reference's.
        what: String,
    },
    /// The device's memory does not hold what is asked.
    #[error("out of device memory: {wanted} bytes wanted for {name}, {available} available")]
    OutOfMemory {
        /// The buffer that did not fit.
        name: String,
        /// Bytes asked for.
        wanted: u64,
        /// Bytes the device or the user's limit leaves.
        available: u64,
    },
    /// A training step failed.
    #[error("iteration {iteration}: {source}")]
    Step {
        /// The step, from 1.
        iteration: u32,
        /// Why.
        source: Box<Error>,
    },
    /// Options that contradict each other or the data.
    #[error("{0}")]
    Config(String),
}

/// Characters of what is wrong with a file: more nobody reads.
const WHAT_CHARS_MAX: usize = 1000;

impl Error {
    /// A fault in the contents of `path`. Parsers quote what they stumble over: control characters become
    /// spaces, so that the message stays one line and no terminal takes it for commands, and long messages
    /// are cut.
    pub fn file(path: impl AsRef<Path>, what: impl Into<String>) -> Error {
        let mut what: String = what.into();
        if what.len() > WHAT_CHARS_MAX || what.chars().any(char::is_control) {
            let tame = |c: char| if c.is_control() { ' ' } else { c };
            let short: String = what.chars().take(WHAT_CHARS_MAX).map(tame).collect();
            what = short.trim_end().to_owned();
        }
        Error::File {
            path: path.as_ref().to_path_buf(),
            what,
        }
    }

    /// Says at which training step an error came up, unless it says so already.
    #[cfg(feature = "train")]
    pub(crate) fn at_step(self, iteration: u32) -> Error {
        match self {
            Error::Step { .. } => self,
            other => Error::Step {
                iteration,
                source: Box::new(other),
            },
        }
    }

    /// A failed operation on `path`; for `map_err`.
    pub fn io(path: impl AsRef<Path>) -> impl FnOnce(std::io::Error) -> Error {
        let path = path.as_ref().to_path_buf();
        move |source| Error::Io { path, source }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_file_holds_reaches_no_terminal_as_commands() {
        let message = |what: &str| Error::file("a", what).to_string();
        assert_eq!(message("unknown word \u{1b}[2J\r\n"), "a: unknown word  [2J");
        assert_eq!(message("é"), "a: é");
        assert_eq!(message(&"ü".repeat(5000)).chars().count(), 3 + 1000);
    }
}
