//! The binary from the command line: output, files and exit status of commands, on a small synthetic data set.

mod capture;
mod chart;
mod coarse;
mod depths;
mod export;
mod exposure;
mod mesh;
mod needs;
mod paths;
mod poses;
mod prune;
mod sky;
mod surfels;
mod transients;

use ashfall::lab::synth::{self, Kind, SynthOptions};
use ashfall::scene::PhotoSource;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;
use tempfile::TempDir;

fn ashfall(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_ashfall"));
    command
        .args(arguments)
        .stdin(Stdio::null())
        .env_remove("ASHFALL_DEVICE");
    command
}

fn run(arguments: &[&str]) -> Output {
    ashfall(arguments)
        .output()
        .unwrap_or_else(|e| panic!("cannot run the binary: {e}"))
}

/// Standard output of a command that must succeed.
#[track_caller]
fn stdout(arguments: &[&str]) -> String {
    let output = run(arguments);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}\n{errors}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// The one-line error of a command that must fail.
#[track_caller]
fn error(arguments: &[&str]) -> String {
    let output = run(arguments);
    assert_eq!(output.status.code(), Some(1), "{arguments:?}");
    assert!(output.stdout.is_empty(), "{arguments:?}");
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    let line = text.lines().last().unwrap_or_default().to_string();
    assert!(line.starts_with("error: "), "{text}");
    assert!(!text.contains("panicked"), "{text}");
    line
}

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|e| panic!("{e} in {text}"))
}

fn read_json(path: &Path) -> Value {
    json(&fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display())))
}

fn word(path: &Path) -> &str {
    path.to_str().unwrap_or_else(|| panic!("{path:?} is no text"))
}

fn folder() -> TempDir {
    tempfile::tempdir().unwrap_or_else(|e| panic!("no temporary folder: {e}"))
}

/// Data set of twelve small photographs with points, made once for all tests of this file.
fn data() -> &'static Path {
    static DATA: OnceLock<(TempDir, PathBuf)> = OnceLock::new();
    let (_, path) = DATA.get_or_init(|| {
        let folder = folder();
        let options = SynthOptions {
            views: 12,
            width: 45,
            height: 34,
            samples: 1,
            points: 300,
            test_every: 4,
            ..SynthOptions::default()
        };
        let dataset = synth::scene(Kind::Solids).dataset(&options);
        let path = folder.path().join("data");
        fs::create_dir(&path)
            .map_err(ashfall::Error::io(&path))
            .and_then(|()| synth::save(&dataset, &path))
            .unwrap_or_else(|e| panic!("{e}"));
        assert!(dataset.views.iter().all(|v| matches!(v.photo, PhotoSource::Memory(_))));
        (folder, path)
    });
    path
}

/// Options of a short run with refinement.
const SHORT: &[&str] = &[
    "--iterations",
    "60",
    "--set",
    "refine.every=15",
    "--set",
    "refine.from=5",
];

fn train<'a>(data: &'a str, out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    [&["train", data, "--out", out, "--validate"], SHORT, more].concat()
}

#[test]
fn help_teaches_and_mistakes_are_told_apart() {
    let help = stdout(&["--help"]);
    for command in [
        "train", "render", "eval", "mesh", "prune", "info", "demo", "chart", "needs",
    ] {
        assert!(help.contains(&format!("\n  {command}")), "{help}");
        let own = stdout(&[command, "--help"]);
        assert!(own.lines().count() > 10, "{own}");
    }
    assert!(help.contains("Examples:"));
    assert_eq!(run(&["train"]).status.code(), Some(2));
    assert_eq!(
        run(&["render", "x.ply", "--out", "x", "--orbit", "0"]).status.code(),
        Some(2)
    );
    assert_eq!(run(&["train", "--resume", "a", "--seed", "1"]).status.code(), Some(2));
}

#[test]
fn errors_name_the_file_or_the_option_and_leave_nothing_behind() {
    let folder = folder();
    let out = folder.path().join("run");
    let out = word(&out);
    let missing = error(&["train", "/no/such/folder", "--out", out]);
    assert!(missing.contains("/no/such/folder"), "{missing}");
    let data = word(data());
    let setting = error(&["train", data, "--out", out, "--set", "adc.treshold=1"]);
    assert!(
        setting.contains("adc.treshold") && setting.contains("grad_threshold"),
        "{setting}"
    );
    let degree = error(&["train", data, "--out", out, "--sh-degree", "4"]);
    assert!(degree.contains("sh_degree is 4"), "{degree}");
    let device = error(&["train", data, "--out", out, "--device", "no such device"]);
    assert!(device.contains("no such device"), "{device}");
    let resume = error(&["train", "--resume", out]);
    assert!(resume.contains("run.json"), "{resume}");
    assert!(!Path::new(out).exists());
    let scene = error(&["eval", word(&folder.path().join("a.ply")), data]);
    assert!(scene.contains("a.ply"), "{scene}");
}

#[test]
fn info_describes_devices_and_data_sets() {
    assert!(stdout(&["info"]).contains("subgroups of"));
    let devices = json(&stdout(&["info", "--json"]));
    assert!(
        devices["devices"].as_array().is_some_and(|d| !d.is_empty()),
        "{devices}"
    );
    assert!(devices["chosen"]["variants"]["rasterize"].is_string(), "{devices}");
    let named = ashfall(&["info", "--json"])
        .env("ASHFALL_DEVICE", "no such device")
        .output();
    assert_eq!(named.map(|o| o.status.code()).unwrap_or(None), Some(1));
    let found = json(&stdout(&["info", word(data()), "--json", "--downscale", "2"]));
    assert_eq!((&found["views"], &found["test_views"]), (&12.into(), &2.into()));
    assert_eq!(found["points"], 300);
    assert_eq!(found["sizes"], json("[[23, 17]]"));
    assert!(!found["warnings"].to_string().contains("missing"), "{found}");
}

#[test]
fn photographs_are_found_in_the_data_set_and_else_in_the_working_directory() {
    let folder = folder();
    let bare = folder.path().join("bare");
    fs::create_dir(&bare).unwrap();
    for entry in fs::read_dir(data()).unwrap().map(Result::unwrap) {
        if entry.path().is_file() {
            fs::copy(entry.path(), bare.join(entry.file_name())).unwrap();
        }
    }
    let status = |arguments: &[&str]| {
        let mut command = ashfall(arguments);
        command
            .current_dir(data().parent().unwrap())
            .output()
            .unwrap()
            .status
            .code()
    };
    let (out, scene) = (folder.path().join("run"), folder.path().join("run/scene.ply"));
    let begun = |images| {
        status(&[
            "train",
            word(&bare),
            "--images",
            images,
            "--iterations",
            "1",
            "--out",
            word(&out),
        ])
    };
    let judged = || status(&["eval", word(&scene), word(&bare), "--images", "data"]);
    assert_eq!(begun("photos"), Some(1));
    let told = json(&stdout(&["info", word(&bare), "--images", "photos", "--json"]))["warnings"].to_string();
    assert!(told.contains("12 of 12 photographs are missing"), "{told}");
    assert_eq!(begun("data"), Some(0));
    assert_eq!(judged(), Some(0));
    // The data set's own folder comes first, even an empty one.
    fs::create_dir(bare.join("data")).unwrap();
    assert_eq!(judged(), Some(1));
}

#[test]
fn a_scene_is_trained_judged_and_drawn() {
    let folder = folder();
    let path = |name: &str| folder.path().join(name);
    let run_dir = path("run");
    let data = word(data());
    let more = ["--json", "--test-every", "4", "--eval-every", "30"];
    let lines = stdout(&train(data, word(&run_dir), &more));
    let events: Vec<Value> = lines.lines().map(json).collect();
    let names = |name: &str| events.iter().filter(|e| e["event"] == name).count();
    assert_eq!((names("start"), names("test"), names("done")), (1, 1, 1), "{lines}");
    assert!(names("step") >= 60, "{lines}");

    let report = read_json(&run_dir.join("report.json"));
    check_report(&report);
    for name in ["scene.ply", "checkpoint", "run.json", "test/images_0000.png"] {
        assert!(run_dir.join(name).is_file(), "{name}");
    }

    let scene = run_dir.join("scene.ply");
    let scene = word(&scene);
    let scores = json(&stdout(&["eval", scene, data, "--test-every", "4", "--json"]));
    assert_eq!(scores["mean"], report["test"], "the file is what was judged");
    check_corrected(&scores);
    let table = stdout(&["eval", scene, data]);
    assert!(
        table.contains("mean:") && table.contains("corrected by 12 numbers a view (cc): "),
        "{table}"
    );
    assert_eq!(
        json(&stdout(&["info", scene, "--json"]))["splat_count"],
        report["splat_count"]
    );

    let frames = path("frames");
    let split = ["--split", "test", "--test-every", "4", "--format", "exr"];
    let draw = ["render", scene, "--cameras", data, "--out", word(&frames)];
    stdout(&[&draw[..], &split].concat());
    stdout(&[&draw[..], &["--orbit", "2"]].concat());
    stdout(&["render", scene, "--orbit", "1", "--out", word(&path("around"))]);
    for show in ["depth", "normal", "alpha"] {
        let around = path("around");
        stdout(&["render", scene, "--orbit", "1", "--out", word(&around), "--show", show]);
    }
    // Rendering by the rules of the 3DGS code gives another picture.
    let theirs = path("theirs");
    let draw = ["render", scene, "--orbit", "1", "--out", word(&theirs)];
    stdout(&[&draw[..], &["--compat", "original"]].concat());
    for name in [
        "frames/images_0004.exr",
        "frames/orbit_0001.png",
        "around/orbit_0000.png",
        "theirs/orbit_0000.png",
        "around/orbit_0000_depth.png",
        "around/orbit_0000_normal.png",
        "around/orbit_0000_alpha.png",
    ] {
        assert!(path(name).is_file(), "{name}");
    }
    let bytes = |name: &str| std::fs::read(path(name)).unwrap();
    assert!(bytes("around/orbit_0000.png") != bytes("theirs/orbit_0000.png"));
}

/// Raw figures and those after corrections of colours, which never cost decibels.
#[track_caller]
fn check_corrected(scores: &Value) {
    let views = scores["views"].as_array().cloned().unwrap_or_default();
    assert_eq!(views.len(), 3);
    let number = |of: &Value, pointer: &str| of.pointer(pointer).and_then(Value::as_f64).unwrap_or(f64::NAN);
    let cc = |of: &Value| number(of, "/cc_affine12_direct/psnr_db");
    for view in &views {
        assert!(cc(view) >= number(view, "/psnr_db") - 1e-6, "{view}");
        for half in ["left", "right"] {
            assert!(
                number(view, &format!("/half_affine12_direct/{half}/psnr_db")) > 5.0,
                "{view}"
            );
        }
    }
    let mean = views.iter().map(cc).sum::<f64>() / 3.0;
    assert!((cc(&scores["mean_corrected"]) - mean).abs() < 1e-9, "{scores}");
}

#[track_caller]
fn check_report(report: &Value) {
    let number = |pointer: &str| {
        let value = report.pointer(pointer).and_then(Value::as_f64);
        value.unwrap_or_else(|| panic!("{pointer} is no number in {report:#}"))
    };
    assert_eq!((number("/iterations"), number("/seed")), (60.0, 0.0));
    assert_eq!((&report["strategy"], number("/sh_degree")), (&"adc".into(), 3.0));
    assert!(report["device"].as_str().is_some_and(|name| !name.is_empty()));
    assert!(number("/splat_count") > 300.0, "refinement adds splats");
    assert!(number("/train_seconds") > 0.0 && number("/memory_peak_bytes") > 1e5);
    let memory = |name: &str| number(&format!("/memory/{name}"));
    let ratio = memory("predicted_bytes") / memory("peak_bytes");
    // Evaluations between steps have buffers of their own, which the formula of training does not include.
    assert!((0.05..1.1).contains(&ratio), "{ratio}");
    assert!(memory("essential_bytes") > 0.0 && memory("isects_peak") > 100.0);
    assert!(memory("reserved_peak_bytes") >= memory("peak_bytes"));
    assert!(report["memory"]["buffers"]["moment1"].is_u64());
    assert_eq!(number("/test/views"), 3.0);
    assert!(number("/test/psnr_db") > 15.0 && number("/train/psnr_db") > 15.0);
    assert!((0.2..=1.0).contains(&number("/test/ssim")));
    let history = report["history"].as_array().cloned().unwrap_or_default();
    assert_eq!(history.len(), 60);
    for field in ["iteration", "seconds", "splat_count", "loss", "psnr_db"] {
        assert!(history.iter().all(|entry| entry[field].is_number()), "{field}");
    }
    assert!(history[29]["test"]["psnr_db"].is_number());
    assert!(number("/loss") < history[0]["loss"].as_f64().unwrap_or_default());
}

#[test]
fn equal_seeds_give_equal_bytes_also_when_stopped_and_resumed() {
    let folder = folder();
    let data = word(data());
    for (strategy, mode, signal) in [("adc", "default", "-KILL"), ("mcmc", "mip", "-INT")] {
        let path = |name: &str| folder.path().join(format!("{strategy}_{name}"));
        let (whole, parts, other) = (path("whole"), path("parts"), path("other"));
        let kind = ["--strategy", strategy, "--mode", mode, "--max-splats", "500"];
        let more = [&kind[..], &["--checkpoint-every", "1"]].concat();
        stdout(&train(data, word(&whole), &more));
        stop(&train(data, word(&parts), &more), &parts, signal);
        let refused = error(&train(data, word(&parts), &more));
        assert!(refused.contains("--resume"), "{refused}");
        stdout(&["train", "--resume", word(&parts), "--validate"]);
        let seed = [&kind[..], &["--seed", "5"]].concat();
        stdout(&train(data, word(&other), &seed));
        let bytes = |dir: &Path| fs::read(dir.join("scene.ply")).unwrap_or_default();
        assert!(!bytes(&whole).is_empty());
        assert!(bytes(&whole) == bytes(&parts), "{strategy}: resumed differs");
        assert!(bytes(&whole) != bytes(&other), "{strategy}: the seed does nothing");
        check_mode(&parts, mode);
    }
}

/// The scene's file stores its mode, and evaluation uses it.
#[track_caller]
fn check_mode(dir: &Path, mode: &str) {
    let (scene, report) = (dir.join("scene.ply"), read_json(&dir.join("report.json")));
    assert_eq!(report["config"]["mode"], mode);
    assert_eq!(json(&stdout(&["info", word(&scene), "--json"]))["mode"], mode);
    let scores = json(&stdout(&["eval", word(&scene), word(data()), "--json"]));
    assert_eq!(scores["mean"], report["test"], "{mode}: judged otherwise");
}

/// Starts a run and stops it with a signal once `run.json` reports the second iteration.
fn stop(arguments: &[&str], dir: &Path, signal: &str) {
    let mut child = ashfall(arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap_or_else(|e| panic!("cannot run the binary: {e}"));
    let done = || {
        let text = fs::read_to_string(dir.join("run.json")).unwrap_or_default();
        let run = serde_json::from_str::<Value>(&text).ok()?;
        run["iteration"].as_u64()
    };
    while done().unwrap_or(0) < 2 {
        let over = child.try_wait().is_ok_and(|status| status.is_some());
        assert!(!over, "the run ended before it could be stopped");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let sent = Command::new("kill").args([signal, &child.id().to_string()]).status();
    assert!(sent.is_ok_and(|status| status.success()), "cannot send {signal}");
    let status = child.wait().unwrap_or_else(|e| panic!("cannot wait: {e}"));
    let expected = (signal == "-INT").then_some(130);
    assert_eq!(status.code(), expected, "{signal}");
    assert!(!dir.join("scene.ply").exists(), "stopped too late to test anything");
}
