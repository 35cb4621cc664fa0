//! Atomic file writes: an interrupted writer leaves the old file unchanged.

use crate::error::{Error, Result};
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};

/// Writes `path` by way of a temporary file in the same folder: written, flushed to the disk and then renamed over
/// `path`. On any error (and when `write` panics) the temporary file is removed and `path` is unchanged. The folder
/// must exist; a `path` to anything but a regular file is refused, because renaming would replace a device or a pipe by
/// a file.
pub fn write_atomically(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> std::io::Result<()>) -> Result<()> {
    if fs::metadata(path).is_ok_and(|meta| !meta.is_file()) {
        return Err(Error::file(path, "exists and is not a file"));
    }
    let (temporary, file) = create_beside(path)?;
    let mut writer = BufWriter::with_capacity(1 << 18, file);
    write(&mut writer)
        .and_then(|()| writer.flush())
        .and_then(|()| writer.get_ref().sync_all())
        .and_then(|()| fs::rename(&temporary.0, path))
        .map_err(Error::io(path))?;
    // The rename is durable only once the folder is on the disk. Not every file system supports that, and the file is
    // complete by now, so failure is ignored.
    if let Some(folder) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
        _ = File::open(folder).and_then(|folder| folder.sync_all());
    }
    Ok(())
}

/// Removes temporary files of killed writers from a folder: those of processes that the operating system reports as
/// ended (on Linux). Returns their number.
pub fn remove_leftovers(folder: &Path) -> usize {
    let Ok(entries) = fs::read_dir(folder) else {
        return 0;
    };
    let left = entries.flatten().filter(|entry| {
        let name = entry.file_name();
        let process = name.to_str().and_then(process_of);
        process.is_some_and(|id| is_gone(id) && entry.path().is_file())
    });
    left.filter(|entry| fs::remove_file(entry.path()).is_ok()).count()
}

/// Process id in the name of a temporary file; see [`create_beside`].
fn process_of(name: &str) -> Option<u32> {
    let stem = name.strip_prefix('.')?.strip_suffix(".tmp")?;
    let (stem, attempt) = stem.rsplit_once('.')?;
    let (_, id) = stem.rsplit_once('.')?;
    attempt.parse::<u32>().ok()?;
    id.parse().ok()
}

fn is_gone(process: u32) -> bool {
    let all = Path::new("/proc");
    all.join("self").exists() && !all.join(process.to_string()).exists()
}

/// Creates a temporary file beside `path` that no other writer uses, in this process or another.
fn create_beside(path: &Path) -> Result<(Temporary, File)> {
    let name = path
        .file_name()
        .ok_or_else(|| Error::file(path, "names no file to write"))?;
    let mut attempt = 0;
    loop {
        let mut hidden = OsString::from(".");
        hidden.push(name);
        hidden.push(format!(".{}.{attempt}.tmp", std::process::id()));
        let candidate = path.with_file_name(hidden);
        match File::create_new(&candidate) {
            Ok(file) => return Ok((Temporary(candidate), file)),
            Err(e) if e.kind() == ErrorKind::AlreadyExists && attempt < ATTEMPTS => attempt += 1,
            Err(e) => return Err(Error::io(path)(e)),
        }
    }
}

/// Maximum number of names tried; far above the concurrent writers of one file.
const ATTEMPTS: u32 = 1000;

/// Removes the file when dropped, unless it has been renamed.
struct Temporary(PathBuf);

impl Drop for Temporary {
    fn drop(&mut self) {
        _ = fs::remove_file(&self.0);
    }
}
