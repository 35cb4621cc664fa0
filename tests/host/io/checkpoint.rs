//! Checkpoint container: round trip, and detection of damage anywhere.

use crate::io::{error_at, for_every_prefix};
use ashfall::io::checkpoint::{self, Checkpoint, Section};
use serde_json::json;
use std::path::{Path, PathBuf};

fn example(folder: &Path) -> PathBuf {
    let path = folder.join("step.ckpt");
    let sections = [
        Section::new("params", &[1.5f32, -0.0, f32::NAN, f32::MIN_POSITIVE]),
        Section::new("nothing", &[] as &[f64]),
        Section::new("moments", &[1e300f64, -2.0]),
        Section::new("random", &[u64::MAX, 0x0123_4567_89ab_cdef]),
        Section::new("ids", &[7u32, 8, 9]),
        Section::new("note", b"odd"),
    ];
    checkpoint::write(&path, &json!({"step": 7000, "name": "a\nb"}), &sections).unwrap();
    path
}

/// The concatenated bytes of all sections.
fn read_all(path: &Path) -> ashfall::Result<Vec<u8>> {
    let file = Checkpoint::open(path)?;
    let mut all = bytemuck::cast_slice(&file.read::<f32>("params")?).to_vec();
    all.extend(bytemuck::cast_slice::<f64, u8>(&file.read("nothing")?));
    all.extend(bytemuck::cast_slice::<f64, u8>(&file.read("moments")?));
    all.extend(bytemuck::cast_slice::<u64, u8>(&file.read("random")?));
    all.extend(bytemuck::cast_slice::<u32, u8>(&file.read("ids")?));
    all.extend(file.read::<u8>("note")?);
    Ok(all)
}

#[test]
fn what_is_written_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = example(folder.path());
    let file = Checkpoint::open(&path).unwrap();
    assert_eq!(file.meta(), &json!({"step": 7000, "name": "a\nb"}));
    let names: Vec<&str> = file.names().collect();
    assert_eq!(names, ["params", "nothing", "moments", "random", "ids", "note"]);
    let bits: Vec<u32> = file
        .read::<f32>("params")
        .unwrap()
        .iter()
        .map(|v| v.to_bits())
        .collect();
    assert_eq!(bits, [1.5f32, -0.0, f32::NAN, f32::MIN_POSITIVE].map(f32::to_bits));
    assert_eq!(file.read::<f64>("nothing").unwrap(), [] as [f64; 0]);
    assert_eq!(file.read::<f64>("moments").unwrap(), [1e300, -2.0]);
    assert_eq!(file.read::<u64>("random").unwrap(), [u64::MAX, 0x0123_4567_89ab_cdef]);
    assert_eq!(file.read::<u32>("ids").unwrap(), [7, 8, 9]);
    assert_eq!(file.read::<u8>("note").unwrap(), b"odd");
    assert!(file.has("ids") && !file.has("id"));
}

#[test]
fn wrong_requests_say_what_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let path = example(folder.path());
    let file = Checkpoint::open(&path).unwrap();
    assert!(error_at(file.read::<f32>("splats"), &path).contains("no section \"splats\""));
    assert!(error_at(file.read::<u32>("params"), &path).contains("16 bytes of f32, not u32"));
    let absent = folder.path().join("absent");
    error_at(Checkpoint::open(&absent), &absent);
}

#[test]
fn a_file_cut_anywhere_is_an_error_on_opening() {
    let folder = tempfile::tempdir().unwrap();
    let path = example(folder.path());
    let contents = std::fs::read(&path).unwrap();
    for_every_prefix(
        &contents,
        &path,
        |path| Checkpoint::open(path).map(drop),
        |_, result| {
            error_at(result, &path);
        },
    );
    std::fs::write(&path, [&contents[..], b"?"].concat()).unwrap();
    assert!(error_at(Checkpoint::open(&path), &path).contains("sections"));
}

#[test]
fn a_changed_byte_anywhere_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = example(folder.path());
    let contents = std::fs::read(&path).unwrap();
    for at in 0..contents.len() {
        for change in [0x01, 0x80, 0xff] {
            let mut damaged = contents.clone();
            damaged[at] ^= change;
            std::fs::write(&path, damaged).unwrap();
            error_at(read_all(&path), &path);
        }
    }
    std::fs::write(&path, &contents).unwrap();
    read_all(&path).unwrap();
}

#[test]
fn a_file_that_shrinks_after_opening_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = example(folder.path());
    let file = Checkpoint::open(&path).unwrap();
    let contents = std::fs::read(&path).unwrap();
    std::fs::write(&path, &contents[..contents.len() - 30]).unwrap();
    assert!(error_at(file.read::<u64>("random"), &path).contains("random"));
}
