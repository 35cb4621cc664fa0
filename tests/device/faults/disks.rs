//! Full disks: under a limit on file size the operating system's own writes end short, at any byte.
//!
//! The limit applies to a process, so these tests run themselves in a child process under `prlimit`. The signal of the
//! limit is ignored there, and a write fails as on a full disk.

use crate::common::device;
use crate::faults::run::{STEPS, holds_only, scene, train, train_with, undisturbed};
use ashfall::Result;
use ashfall::io::checkpoint::Section;
use ashfall::io::{checkpoint, exr, ply, png};
use ashfall::scene::Splats;
use ashfall::train::checkpoint::Checkpoint;
use std::path::Path;
use std::process::{Command, Output, Stdio};

/// A command with a limit on the size of each file it writes, in bytes.
pub(crate) fn limited(bytes: u64, program: &Path) -> Command {
    let mut command = Command::new("sh");
    command
        .args(["-c", "trap '' XFSZ; exec prlimit --fsize=$0: \"$@\""])
        .arg(bytes.to_string())
        .arg(program)
        .stdin(Stdio::null());
    command
}

/// Runs an ignored test of this file in a child process, with a folder to write to.
fn in_a_process(test: &str, bytes: u64, folder: &Path) -> Output {
    let own = std::env::current_exe().unwrap();
    limited(bytes, &own)
        .args([&format!("faults::disks::{test}"), "--exact", "--ignored", "--nocapture"])
        .env("FAULTS_FOLDER", folder)
        .output()
        .unwrap()
}

#[track_caller]
fn succeeds(output: &Output) {
    let [out, err] = [&output.stdout, &output.stderr].map(|t| String::from_utf8_lossy(t));
    assert!(output.status.success() && out.contains("1 passed"), "{out}\n{err}");
}

/// Sets this process's limit.
fn limit_to(bytes: &str) {
    let own = std::process::id().to_string();
    let status = Command::new("prlimit")
        .args(["--pid", &own, &format!("--fsize={bytes}:")])
        .status();
    assert!(status.unwrap().success(), "prlimit");
}

type Writer = fn(&Path, u8) -> Result<()>;

/// Every writer, by file name; the number makes contents differ.
const WRITERS: &[(&str, Writer)] = &[
    ("scene.ply", |path, value| {
        let splats = Splats {
            mean: vec![[f32::from(value); 3]; 40],
            quaternion: vec![[1.0, 0.0, 0.0, 0.0]; 40],
            log_scale: vec![[0.0; 3]; 40],
            opacity_logit: vec![0.0; 40],
            sh: vec![0.5; 120],
            ..Splats::default()
        };
        ply::write(path, &splats)
    }),
    ("checkpoint", |path, value| {
        let numbers = vec![u32::from(value); 300];
        checkpoint::write(path, &"a run".into(), &[Section::new("numbers", &numbers)])
    }),
    ("picture.png", |path, value| {
        let noise = |i: u32| [0.0, 0.5, f32::from((i * i * 31) as u8 ^ value) / 255.0];
        png::write_rgb(path, 24, 16, &(0..384).map(noise).collect::<Vec<_>>())
    }),
    ("picture.exr", |path, value| {
        let noise = |i: u32| [f32::from(value), (i * i) as f32, 0.5, 1.0];
        exr::write(
            path,
            24,
            16,
            &(0..384).map(noise).collect::<Vec<_>>(),
            &[1.0; 384],
            None,
        )
    }),
];

#[test]
#[ignore = "the body of f102, for a process of its own"]
fn write_everything() {
    let folder = std::env::var_os("FAULTS_FOLDER").unwrap();
    let limit = std::env::var("FAULTS_LIMIT").unwrap();
    for (name, write) in WRITERS {
        let path = Path::new(&folder).join(name);
        write(&path, 1).unwrap();
        let old = std::fs::read(&path).unwrap();
        let whole = path.with_extension("whole");
        write(&whole, 2).unwrap();
        let new = std::fs::read(&whole).unwrap();
        std::fs::remove_file(&whole).unwrap();
        assert_ne!(old, new);
        // Limits spread over the file, including the first and the last byte.
        let share: usize = limit.parse().unwrap();
        let bytes = (new.len() - 1) * share / 16;
        limit_to(&bytes.to_string());
        let error = write(&path, 2).expect_err("the disk is full").to_string();
        limit_to("unlimited");
        assert!(error.starts_with(&*path.to_string_lossy()), "names no file: {error}");
        assert!(error.contains("too large"), "{error}");
        assert_eq!(
            std::fs::read(&path).unwrap(),
            old,
            "{name}: half-written at {bytes} bytes"
        );
        write(&path, 2).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), new);
    }
    let names: Vec<&str> = WRITERS.iter().map(|(name, _)| *name).collect();
    holds_only(Path::new(&folder), &names);
}

#[test]
fn f102_a_disk_that_is_full_at_any_byte_leaves_the_old_file() {
    for share in 0..=16 {
        let folder = tempfile::tempdir().unwrap();
        let own = std::env::current_exe().unwrap();
        let output = limited(1 << 40, &own)
            .args(["faults::disks::write_everything", "--exact", "--ignored", "--nocapture"])
            .env("FAULTS_FOLDER", folder.path())
            .env("FAULTS_LIMIT", share.to_string())
            .output()
            .unwrap();
        succeeds(&output);
    }
}

#[test]
#[ignore = "the body of f103, for a process of its own"]
fn fill_the_disk_at_every_checkpoint() {
    let gpu = device::gpu();
    let expected = undisturbed(&gpu);
    let folder = std::env::var_os("FAULTS_FOLDER").unwrap();
    for full_at in 1..=STEPS {
        // A few bytes, and most of the file: the failing write is the first, or ends short.
        for bytes in ["0", "100", "2000"] {
            let run = Path::new(&folder).join(format!("{full_at}-{bytes}"));
            std::fs::create_dir(&run).unwrap();
            let failed = train_with(&gpu, &run, &mut |step| {
                limit_to(if step == full_at { bytes } else { "unlimited" });
            });
            limit_to("unlimited");
            let error = failed.expect_err("the disk is full").to_string();
            assert!(error.contains("checkpoint: File too large"), "{error}");
            holds_only(&run, &["checkpoint"]);
            let path = run.join("checkpoint");
            match full_at {
                1 => assert!(!path.exists(), "half-written"),
                _ => assert_eq!(Checkpoint::read(&path).unwrap().iteration, full_at - 1),
            }
            train(&gpu, &run).unwrap();
            assert!(scene(&run) == expected, "the rest differs");
        }
    }
}

#[test]
fn f103_a_full_disk_at_any_checkpoint_leaves_the_one_before() {
    let folder = tempfile::tempdir().unwrap();
    succeeds(&in_a_process(
        "fill_the_disk_at_every_checkpoint",
        1 << 40,
        folder.path(),
    ));
}
