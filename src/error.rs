//! What a caller could not have known beforehand: files, devices, memory. Programmer errors are assertions.

use std::path::{Path, PathBuf};

/// The result of every fallible function of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// What went wrong, with what the reader needs to act on it.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file holds something other than it should.
    #[error("{}: {what}", path.display())]
    File {
        /// The file at fault.
        path: PathBuf,
        /// What is wrong with it, and where (line, byte offset, frame) if known.
        what: String,
    },
    /// The operating system refused an operation on a file.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder concerned.
        path: PathBuf,
        /// What the operating system said.
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
        /// What is missing, and for which part.
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
    /// Options that contradict each other or the data.
    #[error("{0}")]
    Config(String),
}

impl Error {
    /// A fault in the contents of `path`.
    pub fn file(path: impl AsRef<Path>, what: impl Into<String>) -> Error {
        Error::File {
            path: path.as_ref().to_path_buf(),
            what: what.into(),
        }
    }

    /// A failed operation on `path`; for `map_err`.
    pub fn io(path: impl AsRef<Path>) -> impl FnOnce(std::io::Error) -> Error {
        let path = path.as_ref().to_path_buf();
        move |source| Error::Io { path, source }
    }
}
