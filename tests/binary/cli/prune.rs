//! `ashfall prune`.

use super::{ashfall, data, error, folder, json, run, stdout, train, word};
use std::fs;
use std::path::Path;
use std::process::Command;

/// A trained scene in a folder.
fn scene(folder: &Path) -> std::path::PathBuf {
    let out = folder.join("run");
    stdout(&train(word(data()), word(&out), &[]));
    out.join("scene.ply")
}

#[test]
fn less_is_left_and_no_pixel_breaks_its_bound() {
    let folder = folder();
    let scene = scene(folder.path());
    let less = folder.path().join("less.ply");
    let arguments = ["prune", word(&scene), word(data()), "--validate", "--json"];
    let with = |more: &[&str]| json(&stdout(&[&arguments[..], more].concat()));
    let figures = with(&["--error", "1/16", "--test-every", "4", "--out", word(&less)]);
    let count = |name: &str| figures[name].as_u64().unwrap_or_else(|| panic!("{name}"));
    assert!(count("removed") > 0);
    assert_eq!(count("splats_after"), count("splats_before") - count("removed"));
    let size = fs::metadata(&less).map(|file| file.len()).unwrap_or(0);
    assert!(size.abs_diff(count("ply_bytes_after")) < 2000, "{size}");
    let change = &figures["change"];
    assert_eq!((&change["broken"], count("train_views")), (&0.into(), 9));
    let [most, range] = ["most", "color_range"].map(|name| change[name].as_f64().unwrap_or(9.0));
    assert!(most > 0.0 && most <= range / 16.0 + 1e-3, "{figures}");
    assert!(figures["test_after"]["psnr_db"].as_f64().unwrap_or(0.0) > 5.0);
    let left = json(&stdout(&["info", word(&less), "--json"]));
    assert_eq!(left["splat_count"], figures["splats_after"], "{left}");

    let flat = with(&["--sh-error", "1", "--out", word(&less)]);
    let degrees = flat["splats_by_degree"].as_array().map(Vec::len);
    assert_eq!((degrees, &flat["change"]["broken"]), (Some(4), &0.into()));
    let left = json(&stdout(&["info", word(&less), "--json"]));
    let most = flat["splats_by_degree"].as_array().into_iter().flatten();
    let highest = most.enumerate().filter(|(_, count)| **count != 0).last();
    assert_eq!(left["sh_degree"].as_u64(), highest.map(|(degree, _)| degree as u64));

    let fitted = with(&["--error", "1/16", "--refit", "20"]);
    let db = |of: &str| fitted[of]["psnr_db"].as_f64().unwrap_or(0.0);
    assert!(db("test_after_refit") > db("test_after") - 1.0, "{fitted}");
    let original = with(&["--compat", "original"]);
    assert_eq!(original["change"]["broken"], 0);
}

#[test]
fn words_say_what_went_and_nothing_is_written_unasked() {
    let folder = folder();
    let scene = scene(folder.path());
    let files = || fs::read_dir(folder.path()).map(Iterator::count).unwrap_or(0);
    let before = files();
    let text = stdout(&["prune", word(&scene), word(data())]);
    for part in [
        "splats",
        "seen by no training view",
        "largest change",
        "degrees 0 to 3",
        "test views after",
        "no --out",
    ] {
        assert!(text.contains(part), "{text}");
    }
    assert_eq!(files(), before);
    let scene = word(&scene);
    for (more, says) in [
        (["--out", "scene.ksplat"], "choose such a name"),
        (["--out", "/nowhere/at/all.ply"], "/nowhere/at/all.ply"),
        (["--refit", "5"], "--compat original"),
    ] {
        let compat: &[&str] = if more[0] == "--refit" {
            &["--compat", "original"]
        } else {
            &[]
        };
        let line = error(&[&["prune", scene, word(data())], &more[..], compat].concat());
        assert!(line.contains(says), "{line}");
    }
    for bad in ["0", "2", "x"] {
        let output = run(&["prune", scene, word(data()), "--error", bad]);
        assert_eq!(output.status.code(), Some(2), "{bad}");
    }
}

/// The change by merging is measured and reported separately; the proof covers only the pruning after it.
#[test]
fn merging_comes_first_and_is_told_apart_from_the_proof() {
    let folder = folder();
    let scene = scene(folder.path());
    let less = folder.path().join("less.ply");
    let arguments = ["prune", word(&scene), word(data()), "--error", "1/16"];
    let with = |more: &[&str]| stdout(&[&arguments[..], more].concat());
    let figures = json(&with(&[
        "--merge",
        "1/4",
        "--json",
        "--out",
        word(&less),
        "--refit",
        "5",
    ]));
    let merge = &figures["merge"];
    let count = |of: &serde_json::Value, name: &str| of[name].as_u64().unwrap_or_else(|| panic!("{name}"));
    let before = count(&figures, "splats_before");
    assert_eq!(count(merge, "merged_away"), before / 4);
    assert_eq!(count(merge, "splats_after_merge"), before - before / 4);
    assert_eq!(
        count(&figures, "splats_after"),
        before - before / 4 - count(&figures, "removed")
    );
    assert!(merge["bound"].is_null() && merge["share"] == 0.25, "{merge}");
    let change = &merge["train_change"];
    let [most, rms, psnr] = ["most", "rms", "psnr_db"].map(|name| change[name].as_f64().unwrap_or(f64::NAN));
    assert!(
        most > rms && rms > 0.0 && (psnr + 20.0 * rms.log10()).abs() < 1e-9,
        "{change}"
    );
    assert_eq!(count(change, "pixels"), count(&figures, "train_views") * 45 * 34);
    assert!(psnr > 20.0, "{change}");
    assert_eq!(figures["change"]["broken"], 0);
    for test in [
        &merge["test_after_merge"],
        &figures["test_after"],
        &figures["test_after_refit"],
    ] {
        assert!(test["psnr_db"].as_f64().is_some(), "{figures}");
    }
    let left = json(&stdout(&["info", word(&less), "--json"]));
    assert_eq!(left["splat_count"], figures["splats_after"]);

    let text = with(&["--merge"]);
    for part in [
        "splats went into neighbours (0.5 of all asked for)",
        "no bound of that is proven",
        "by merging, measured at",
        "of merged against before",
        "proven against the merged scene",
        "test views merged",
        "nearest to a bound",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let without = with(&["--json"]);
    assert!(json(&without)["merge"].is_null(), "{without}");
    let help = stdout(&["prune", "--help"]);
    let help: Vec<&str> = help.split_whitespace().collect();
    assert!(help.join(" ").contains("No bound of that is proven"), "{help:?}");
    for bad in ["0", "1", "-1", "x"] {
        let output = run(&[&arguments[..], &["--merge", bad]].concat());
        assert_eq!(output.status.code(), Some(2), "{bad}");
    }
}

/// An interrupted run leaves an existing file unchanged.
#[cfg(unix)]
#[test]
fn an_interruption_leaves_no_half_scene() {
    let folder = folder();
    let scene = scene(folder.path());
    let less = folder.path().join("less.ply");
    fs::write(&less, "as it was").unwrap_or_else(|e| panic!("{e}"));
    let endless = ["--refit", "1000000", "--out", word(&less)];
    let arguments = [&["prune", word(&scene), word(data())], &endless[..]].concat();
    let child = ashfall(&arguments).stderr(std::process::Stdio::piped()).spawn();
    let mut child = child.unwrap_or_else(|e| panic!("{e}"));
    // The signal handler is installed before this line of progress.
    let stderr = child.stderr.take().unwrap_or_else(|| panic!("no stderr"));
    let mut lines = std::io::BufRead::lines(std::io::BufReader::new(stderr)).map_while(Result::ok);
    let line = lines.find(|line| line.contains("training views"));
    assert!(line.is_some());
    let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(sent.is_ok_and(|status| status.success()));
    let status = child.wait().unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(status.code(), Some(130));
    assert_eq!(fs::read_to_string(&less).unwrap_or_default(), "as it was");
    let left: Vec<_> = fs::read_dir(folder.path()).into_iter().flatten().flatten().collect();
    assert_eq!(left.len(), 2, "{left:?}");
}
