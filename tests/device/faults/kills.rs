//! `kill -9`, and a full disk, applied to the executable.

use crate::faults::disks::limited;
use crate::faults::run::holds_only;
use ashfall::lab::synth::{self, Kind, SynthOptions};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};
use tempfile::TempDir;

const BINARY: &str = env!("CARGO_BIN_EXE_ashfall");

/// Files in a finished run's folder.
const RESULTS: &[&str] = &["checkpoint", "run.json", "run.lock", "report.json", "scene.ply", "test"];

fn data() -> &'static Path {
    static DATA: OnceLock<(TempDir, PathBuf)> = OnceLock::new();
    let (_, path) = DATA.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let dataset = synth::scene(Kind::Solids).dataset(&SynthOptions {
            views: 6,
            width: 32,
            height: 24,
            samples: 1,
            points: 100,
            test_every: 3,
            ..SynthOptions::default()
        });
        let path = folder.path().join("data");
        std::fs::create_dir(&path).unwrap();
        synth::save(&dataset, &path).unwrap();
        (folder, path)
    });
    path
}

/// The arguments that begin a run in `out`, or resume it.
fn arguments(out: &Path, strategy: &str) -> Vec<String> {
    let out = out.display().to_string();
    let words = if Path::new(&out).join("run.json").exists() {
        format!("train --resume {out} --checkpoint-every 1 --device 0")
    } else {
        format!(
            "train {} --out {out} --strategy {strategy} --iterations 40 --max-splats 300 --checkpoint-every 1 \
             --device 0 --set refine.every=10 --set refine.from=5",
            data().display()
        )
    };
    words.split(' ').map(str::to_owned).collect()
}

fn start(out: &Path, strategy: &str) -> Child {
    Command::new(BINARY)
        .args(arguments(out, strategy))
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Waits for a run that must succeed; returns its duration.
#[track_caller]
fn finish(out: &Path, strategy: &str) -> Duration {
    let begun = Instant::now();
    let output = start(out, strategy).wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    begun.elapsed()
}

fn scene(out: &Path) -> Vec<u8> {
    std::fs::read(out.join("scene.ply")).unwrap()
}

/// SplitMix64 (Steele, Lea and Flood 2014), as a number in [0, 1).
fn uniform(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

/// Kills runs at random moments, `kills` times, resuming each; a finished run must have the bytes of the uninterrupted
/// one.
fn kill(strategy: &str, kills: u32, seed: u64) {
    let folder = tempfile::tempdir().unwrap();
    let whole = folder.path().join("whole");
    let duration = finish(&whole, strategy);
    let expected = scene(&whole);
    let mut random = seed;
    let (mut killed, mut ended, mut runs) = (0, 0, 0);
    let mut out = folder.path().join("run-0");
    while killed < kills {
        let mut child = start(&out, strategy);
        std::thread::sleep(duration.mul_f64(uniform(&mut random)));
        child.kill().unwrap();
        let output = child.wait_with_output().unwrap();
        match output.status.code() {
            None => killed += 1,
            code => assert_eq!(code, Some(0), "{}", String::from_utf8_lossy(&output.stderr)),
        }
        // Files are complete at any time: half of the runs are finished here, the others are killed again.
        if uniform(&mut random) < 0.5 {
            finish(&out, strategy);
        }
        if out.join("report.json").exists() {
            assert!(scene(&out) == expected, "{strategy}: after {killed} kills, other bytes");
            holds_only(&out, RESULTS);
            ended += 1;
            runs += 1;
            out = folder.path().join(format!("run-{runs}"));
        }
    }
    finish(&out, strategy);
    assert!(scene(&out) == expected, "{strategy}: after {killed} kills, other bytes");
    println!("{strategy}: {killed} kills, {} runs ended in the same bytes", ended + 1);
}

#[test]
fn f103_a_run_that_was_killed_goes_on_to_the_same_bytes() {
    kill("adc", 3, 1);
}

#[test]
#[ignore = "fifty kills of each strategy: minutes; `make soak`"]
fn f103_a_run_that_was_killed_a_hundred_times() {
    kill("adc", 50, 2);
    kill("mcmc", 50, 3);
}

/// A second run over a finished one's folder, on a full disk.
#[test]
fn f102_the_program_on_a_full_disk_says_so_and_spoils_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let run = |bytes: u64| {
        let mut command = limited(bytes, BINARY.as_ref());
        let output = command
            .args([
                "train",
                &data().display().to_string(),
                "--iterations",
                "3",
                "--device",
                "0",
            ])
            .args(["--checkpoint-every", "1", "--overwrite", "--out"])
            .arg(&out)
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        (output.status.code(), said.lines().last().unwrap_or_default().to_owned())
    };
    let (code, said) = run(1 << 40);
    assert_eq!(code, Some(0), "{said}");
    let before = scene(&out);
    for bytes in [0, 1, 100, 5000, 10_000] {
        let (code, said) = run(bytes);
        assert_eq!(code, Some(1), "{bytes} bytes: {said}");
        assert!(said.starts_with("error: ") && said.contains("File too large"), "{said}");
        assert!(scene(&out) == before, "{bytes} bytes: the scene was spoilt");
        holds_only(&out, RESULTS);
    }
    assert_eq!(run(1 << 40).0, Some(0));
}
