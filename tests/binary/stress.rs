//! `ashfall stress`: it runs, keeps its bounds, and detects errors.

use ashfall::io::ply;
use ashfall::lab::stress::outcome::CheckGroup;
use ashfall::lab::stress::{self, StressPlan, StressScene};
use ashfall::scene::Splats;
use serde_json::Value;
use std::fs;
use std::ops::ControlFlow;
use std::path::Path;
use std::process::{Command, Output, Stdio};

fn ashfall(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_ashfall"))
        .args(arguments)
        .stdin(Stdio::null())
        .env_remove("ASHFALL_DEVICE")
        .output()
        .unwrap()
}

/// Runs the command into a folder and returns its JSON.
#[track_caller]
fn stress(folder: &Path, scene: Option<&Path>, more: &[&str]) -> (Output, Value) {
    let (json, out) = (folder.join("stress.json"), folder.join("page"));
    let mut arguments = vec!["stress", "--quick", "--validate", "--device", "0"];
    arguments.extend(["--json", json.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    arguments.extend(more);
    arguments.extend(scene.map(|scene| scene.to_str().unwrap()));
    let output = ashfall(&arguments);
    let text = fs::read_to_string(&json).unwrap_or_else(|e| panic!("{e}: {output:?}"));
    (output, serde_json::from_str(&text).unwrap())
}

/// The groups that have a check, and those with a failed one.
fn groups(report: &Value) -> (Vec<String>, Vec<String>) {
    let outcomes = report["outcomes"].as_array().unwrap();
    let named = |only_failed: bool| {
        let chosen = outcomes.iter().filter(|o| !only_failed || o["passed"] == false);
        let mut names: Vec<String> = chosen.map(|o| o["group"].as_str().unwrap().to_owned()).collect();
        names.dedup();
        names
    };
    (named(false), named(true))
}

const GROUPS: [&str; 7] = [
    "device",
    "scenes",
    "poison",
    "sizes",
    "sweeps",
    "gradients",
    "determinism",
];

#[test]
fn every_group_is_tried_and_keeps_its_bounds() {
    let folder = tempfile::tempdir().unwrap();
    let (output, report) = stress(folder.path(), None, &[]);
    let said = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{said}{output:?}");
    assert!(said.contains("checks keep their bounds") && said.contains("stress.html"));
    assert_eq!(report["passed"], true);
    assert_eq!(groups(&report), (GROUPS.map(String::from).to_vec(), vec![]));
    for outcome in report["outcomes"].as_array().unwrap() {
        let [measured, bound] = ["measured", "bound"].map(|name| outcome[name].as_f64());
        assert!(measured.is_some() && bound.is_some(), "{outcome}");
    }
    let page = fs::read_to_string(folder.path().join("page/stress.html")).unwrap();
    assert!(page.contains("checks keep their bounds.</p>") && page.ends_with("</html>\n"));
    for title in CheckGroup::ALL.map(CheckGroup::title) {
        assert!(page.contains(&format!("<h2>{title}</h2>")), "{title}");
    }
    assert!(page.matches("<svg ").count() >= 8 && page.matches("<img ").count() > 40);
}

#[test]
fn a_scene_of_ones_own_is_tried_with_all_its_faults() {
    let folder = tempfile::tempdir().unwrap();
    let mut splats = StressScene::made().splats;
    splats.mean[5] = [f32::NAN; 3];
    splats.log_scale[9] = [f32::INFINITY; 3];
    splats.log_scale[11] = [3.0, -9.0, 0.5];
    splats.opacity_logit[13] = 60.0;
    splats.quaternion[15] = [0.0; 4];
    let scene = folder.path().join("scene.ply");
    ply::write(&scene, &splats).unwrap();
    // The largest picture of a quick run, 4.9 MB, exceeds the binding limit: it is drawn in bands of rows.
    let (output, report) = stress(folder.path(), Some(&scene), &["--limit-binding", "4M"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert_eq!(groups(&report).0, GROUPS);
    assert!(report["facts"].get("640 × 480").is_none(), "{report}");
    // Splats with non-finite numbers are dropped on reading.
    let scene = report["facts"]["scene"].as_str().unwrap();
    assert!(scene.ends_with("scene.ply, 798 splats"), "{scene}");
    let empty = folder.path().join("empty.ply");
    ply::write(&empty, &Splats::default()).unwrap();
    let output = ashfall(&["stress", empty.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("empty.ply"));
}

/// Slightly higher opacities in the reference simulate an engine that draws too little.
#[test]
fn what_is_wrong_is_noticed_wherever_it_shows() {
    let gpu = crate::common::device::gpu();
    let mut subject = StressScene::made();
    for logit in &mut subject.exact.opacity_logit {
        *logit += 0.01;
    }
    let mut goes_on = |_| ControlFlow::Continue(());
    let found = stress::run(&gpu, &subject, StressPlan::QUICK, &mut goes_on).unwrap();
    let found = found.expect("nobody ended it");
    for group in CheckGroup::ALL {
        let of_group = found.failed().into_iter().filter(|o| o.group == group);
        let compares = matches!(
            group,
            CheckGroup::Scenes | CheckGroup::Sizes | CheckGroup::Sweeps | CheckGroup::Gradients
        );
        assert_eq!(of_group.count() > 0, compares, "{group:?}");
    }
    for sweep in found.sweeps.iter().filter(|s| s.group == CheckGroup::Sweeps) {
        assert!(!sweep.points.iter().all(|p| p.holds()), "{}", sweep.title);
    }
}

#[test]
fn it_ends_when_it_is_told_to() {
    let gpu = crate::common::device::gpu();
    let mut begun = 0;
    let mut ends = |group| {
        begun += 1;
        match group {
            CheckGroup::Scenes => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        }
    };
    let found = stress::run(&gpu, &StressScene::made(), StressPlan::QUICK, &mut ends).unwrap();
    assert!(found.is_none() && begun == 2);
}
