//! Whole files or none: a writer that is interrupted leaves the old file as it was.

use crate::error::{Error, Result};
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};

/// Writes `path` by way of a temporary file in the same folder: written, flushed to the disk and then
/// renamed over `path`. On any error (and when `write` panics) the temporary file is removed and `path`
/// is what it was before. The folder must exist; a `path` that is no regular file is refused, because
/// renaming would replace a device or a pipe by a file.
pub fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> std::io::Result<()>,
) -> Result<()> {
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
    // The rename itself lasts only once the folder is on the disk. Not every file system can do
    // that, and the file is complete by now, so failure is no error.
    if let Some(folder) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
        _ = File::open(folder).and_then(|folder| folder.sync_all());
    }
    Ok(())
}

/// Removes from a folder what writers left there that were killed: temporary files of processes that are no more,
/// as far as the operating system says (Linux does). Returns how many there were.
pub fn remove_leftovers(folder: &Path) -> usize {
    let Ok(entries) = fs::read_dir(folder) else {
        return 0;
    };
    let left = entries.flatten().filter(|entry| {
        let name = entry.file_name();
        let process = name.to_str().and_then(process_of);
        process.is_some_and(|id| is_gone(id) && entry.path().is_file())
    });
    left.filter(|entry| fs::remove_file(entry.path()).is_ok())
        .count()
}

/// The process that a temporary file belongs to, by its name: see [`create_beside`].
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

/// Creates a file beside `path` that no other writer, of this process or another, uses.
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

/// Names tried: more than any program has writers of one file at a time.
const ATTEMPTS: u32 = 1000;

/// Removes the file when dropped; after the rename there is nothing left to remove.
struct Temporary(PathBuf);

impl Drop for Temporary {
    fn drop(&mut self) {
        _ = fs::remove_file(&self.0);
    }
}
