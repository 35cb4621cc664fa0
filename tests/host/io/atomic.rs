//! Atomic writes: the whole new file or the old one.

use crate::io::{error_at, files_in};
use ashfall::io::atomic;
use std::io::Write as _;

#[test]
fn a_failed_write_leaves_the_old_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    std::fs::write(&path, b"old").unwrap();
    let result = atomic::write_atomically(&path, |file| {
        file.write_all(&[1; 1 << 20])?;
        Err(std::io::Error::other("the disk is full"))
    });
    assert!(error_at(result, &path).contains("the disk is full"));
    assert_eq!(std::fs::read(&path).unwrap(), b"old");
    let panicked = std::panic::catch_unwind(|| {
        atomic::write_atomically(&path, |_| panic!("on purpose")).unwrap();
    });
    assert!(panicked.is_err());
    assert_eq!(std::fs::read(&path).unwrap(), b"old");
    assert_eq!(files_in(folder.path()), ["file"], "nothing is left behind");
    atomic::write_atomically(&path, |file| file.write_all(b"new")).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), b"new");
    // A folder as the target, and a file in a missing folder.
    error_at(atomic::write_atomically(folder.path(), |_| Ok(())), folder.path());
    let nowhere = folder.path().join("no/file");
    error_at(atomic::write_atomically(&nowhere, |_| Ok(())), &nowhere);
}

#[test]
fn what_a_killed_writer_left_is_removed_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    // Linux process ids are at most 2^22, so 2^22 + 1 is never in use.
    let own = format!(".a.{}.0.tmp", std::process::id());
    let stays = [own.as_str(), "a.4194305.0.tmp", ".a.4194305.tmp", ".a.x.0.tmp", ".tmp"];
    for name in stays.iter().chain(&[".a.4194305.0.tmp", ".scene.ply.4194305.12.tmp"]) {
        std::fs::write(folder.path().join(name), b"half").unwrap();
    }
    assert_eq!(atomic::remove_leftovers(folder.path()), 2);
    let mut left = files_in(folder.path());
    left.sort();
    let mut stays = stays.to_vec();
    stays.sort_unstable();
    assert_eq!(left, stays);
    assert_eq!(atomic::remove_leftovers(&folder.path().join("nowhere")), 0);
}
