//! Lock of a folder against a second writer.

use crate::{Error, Result};
use std::fs::{File, TryLockError};
use std::path::Path;

/// Exclusive right to write to a folder, held by one process at a time until dropped or the process ends.
///
/// An empty file `run.lock` in the folder carries the lock and stays behind.
#[derive(Debug)]
pub struct FolderLock {
    _file: File,
}

impl FolderLock {
    /// Takes the lock of an existing folder.
    ///
    /// # Errors
    /// At once if another process holds the lock, or if the file cannot be written.
    pub fn take(folder: &Path) -> Result<FolderLock> {
        let path = folder.join("run.lock");
        let file = File::options().create(true).append(true).open(&path);
        let file = file.map_err(Error::io(&path))?;
        match file.try_lock() {
            Ok(()) => Ok(FolderLock { _file: file }),
            Err(TryLockError::WouldBlock) => Err(Error::file(folder, "is being written to by another run")),
            Err(TryLockError::Error(error)) => Err(Error::io(&path)(error)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_has_one_writer() -> Result<()> {
        let dir = tempfile::tempdir().map_err(Error::io("."))?;
        let first = FolderLock::take(dir.path())?;
        let second = FolderLock::take(dir.path()).err();
        let message = second.map(|e| e.to_string()).unwrap_or_default();
        assert!(message.ends_with("is being written to by another run"), "{message}");
        drop(first);
        FolderLock::take(dir.path()).map(|_| ())
    }
}
