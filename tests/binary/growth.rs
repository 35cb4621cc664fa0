//! `ashfall bench frame`, `ashfall bench train` and `ashfall bench guest`, with tiny sizes.

use ashfall::lab::synth::{self, Kind, SynthOptions};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

fn run(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_ashfall"));
    command.args(arguments).output().unwrap()
}

/// Printed text and written JSON of a bench.
#[track_caller]
fn bench(folder: &Path, arguments: &[&str]) -> (String, Value) {
    let path = folder.join("bench.json");
    let output = run(&[&["bench"][..], arguments, &["--json", path.to_str().unwrap()]].concat());
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}\n{errors}");
    let report = serde_json::from_slice(&fs::read(path).unwrap()).unwrap();
    (String::from_utf8(output.stdout).unwrap(), report)
}

fn stages<'a>(report: &'a Value, input: &str) -> Vec<&'a str> {
    let rows = report["rows"].as_array().unwrap().iter();
    let mine = rows.filter(|row| row["input"] == input && row["variant"] == "");
    mine.map(|row| row["stage"].as_str().unwrap()).collect()
}

#[test]
fn frames_are_measured_by_size() {
    let folder = tempfile::tempdir().unwrap();
    let csv = folder.path().join("frames.csv");
    let arguments = [
        "frame",
        "--splats",
        "300,600,1.2e3",
        "--sizes",
        "48x32,96x64,31x17",
        "--runs",
        "2",
        "--csv",
        csv.to_str().unwrap(),
    ];
    let (text, report) = bench(folder.path(), &arguments);
    let points = report["points"].as_array().unwrap();
    assert_eq!(points.len(), 9);
    for point in points {
        let number = |name: &str| point[name].as_f64().unwrap();
        assert!(number("wall_s") > 0.0 && number("processor_s") > 0.0, "{point}");
        let size = &point["size"];
        let pixels = size[0].as_u64().unwrap() * size[1].as_u64().unwrap();
        let memory = point["memory"].as_array().unwrap();
        let of = |name: &str| {
            let found = memory.iter().find(|entry| entry[0] == name);
            found.map(|entry| entry[1].as_u64().unwrap())
        };
        assert!(of("image").is_some_and(|bytes| (16 * pixels..17 * pixels + 512).contains(&bytes)));
        let splats = point["splats"].as_u64().unwrap();
        assert_eq!(of("params"), Some(16 * 15 * splats));
    }
    let stages = stages(&report, "frame/600/96x64");
    for stage in ["total", "project", "rasterize", "host", "memory/params"] {
        assert!(stages.contains(&stage), "{stage} in {stages:?}");
    }
    // Over splats at three sizes, over pixels at three counts, by two clocks.
    let exponents = report["exponents"].as_array().unwrap();
    assert_eq!(exponents.len(), 12);
    for exponent in exponents {
        let interval = [0, 1].map(|end| exponent["interval"][end].as_f64().unwrap());
        let slope = exponent["slope"].as_f64().unwrap();
        assert!((interval[0]..=interval[1]).contains(&slope), "{exponent}");
        assert!(exponent["doubling"].as_f64().unwrap() > 0.0);
    }
    assert!(report["giant"]["ratio"].as_f64().unwrap() > 0.0);
    assert!(text.contains("a splat all over the picture among 1,200"), "{text}");
    assert!(text.contains("time over pixels at 600 splats: exponent"), "{text}");
    let rows = report["rows"].as_array().unwrap().len();
    assert_eq!(fs::read_to_string(&csv).unwrap().lines().count(), rows + 1);
}

#[test]
fn pictures_of_a_guest_are_measured_against_a_plain_one() {
    let folder = tempfile::tempdir().unwrap();
    let common = ["guest", "--splats", "500", "--size", "64x48", "--runs", "2"];
    let (text, report) = bench(folder.path(), &common);
    let kinds = |report: &Value| {
        let costs = report["guests"].as_array().unwrap().iter();
        let kinds = costs.map(|cost| {
            assert!(cost["ratio"].as_f64().unwrap() > 0.0);
            cost["variant"].as_str().unwrap().to_owned()
        });
        kinds.collect::<Vec<_>>()
    };
    let all = ["display", "depth/none", "depth/half", "instances/8", "eyes/2"];
    assert_eq!(kinds(&report), all);
    assert!(text.contains("500 splats at 64x48, eyes/2: "), "{text}");
    let filtered = [&common[..], &["--filter", "depth", "--instances", "3"]].concat();
    let (_, report) = bench(folder.path(), &filtered);
    assert_eq!(kinds(&report), all[1..3]);
    let none = run(&[&["bench"][..], &common[..], &["--filter", "nonsense"]].concat());
    assert_eq!(none.status.code(), Some(1));
}

#[test]
fn what_a_device_cannot_hold_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = [
        "frame",
        "--splats",
        "100,200000",
        "--sizes",
        "32x32",
        "--runs",
        "1",
        "--memory-limit",
        "32M",
        "--filter",
        "frame/frame",
    ];
    let (text, report) = bench(folder.path(), &arguments);
    assert!(
        text.contains("200,000 splats at 32x32: not held by the device"),
        "{text}"
    );
    let points = report["points"].as_array().unwrap();
    assert!(points[0]["fault"].is_null() && points[0]["wall_s"].is_number());
    assert!(points[1]["fault"].is_string() && points[1]["wall_s"].is_null());
    let none = run(&["bench", "frame", "--filter", "nonsense"]);
    assert_eq!(none.status.code(), Some(1));
    for bad in [["--splats", "0"], ["--sizes", "5"], ["--runs", "0"]] {
        let output = run(&[&["bench", "frame"][..], &bad].concat());
        assert_eq!(output.status.code(), Some(2), "{bad:?}");
    }
}

#[test]
fn steps_are_measured_from_points_and_from_a_scene() {
    let folder = tempfile::tempdir().unwrap();
    let options = SynthOptions {
        views: 4,
        width: 48,
        height: 32,
        samples: 1,
        points: 200,
        ..SynthOptions::default()
    };
    let made = synth::scene(Kind::Demo).dataset(&options);
    let data = folder.path().join("data");
    synth::save(&made, &data).unwrap();
    let scene = folder.path().join("scene.ply");
    let config = ashfall::train::TrainConfig::default();
    let splats = ashfall::train::initial_splats(&made, made.extent(), &config).unwrap();
    ashfall::io::ply::write(&scene, &splats).unwrap();
    let common = [
        "train",
        data.to_str().unwrap(),
        "--splats",
        "100,900",
        "--steps",
        "4",
        "--warm-up",
        "2",
        "--runs",
        "2",
    ];
    let init = ["--init", scene.to_str().unwrap(), "--budget", "h100,rx7900xtx"];
    for more in [&[][..], &init, &["--kind", "surfel"]] {
        let (text, report) = bench(folder.path(), &[&common, more].concat());
        let has_budget = more.contains(&"--budget");
        assert!(text.contains("a step with 900 splats: "), "{text}");
        let points = report["points"].as_array().unwrap();
        assert_eq!(points.len(), 2);
        assert!(points.iter().all(|p| p["processor_s"].as_f64().unwrap() > 0.0));
        for memory in report["memory"].as_array().unwrap() {
            let bytes = |name: &str| memory[name].as_f64().unwrap();
            let ratio = bytes("predicted_bytes") / bytes("peak_bytes");
            assert!((0.9..1.1).contains(&ratio), "{memory}");
        }
        let rows = report["rows"].as_array().unwrap().iter();
        let alone = rows.filter(|row| row["variant"] == "alone");
        let alone: Vec<&str> = alone.map(|row| row["stage"].as_str().unwrap()).collect();
        assert!(alone.len() > 2 * 8, "the stages of single steps");
        let budgets = report["budgets"].as_array().map_or(&[][..], Vec::as_slice);
        assert_eq!(budgets.len(), if has_budget { 2 * 2 } else { 0 });
        for budget in budgets {
            holds_all_stages(budget, &alone[..alone.len() / 2]);
        }
        assert_eq!(text.contains("least times on NVIDIA H100 SXM"), has_budget, "{text}");
        assert_eq!(report["exponents"].as_array().unwrap().len(), 2);
    }
}

/// A budget has the stages of a step but for the whole and the transfer of the photograph, all with bytes and times.
#[track_caller]
fn holds_all_stages(budget: &Value, timed: &[&str]) {
    let stages = budget["stages"].as_array().unwrap();
    let names: Vec<&str> = stages.iter().map(|stage| stage["stage"].as_str().unwrap()).collect();
    let timed = timed.iter().filter(|name| !["total", "upload"].contains(name));
    assert_eq!(names, timed.copied().collect::<Vec<_>>());
    for stage in stages {
        let number = |name: &str| stage[name].as_f64().unwrap();
        assert!(
            number("bytes") > 0.0 && number("memory_s") > 0.0 && number("measured_s") > 0.0,
            "{stage}"
        );
    }
    let step = &budget["step"];
    let [splats, visible, isects] = ["splats", "visible", "isects"].map(|name| step[name].as_f64().unwrap());
    assert!(0.0 < visible && visible <= splats && visible <= isects, "{step}");
}
