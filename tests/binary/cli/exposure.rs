//! Exposures of photographs: the made perturbation, its table, training with gains, and resumption.

use super::*;

/// Made photographs with exposures, in COLMAP's form.
fn made(folder: &Path, perturb: &str) -> PathBuf {
    let out = folder.join(perturb);
    let size = ["--photos", "17", "--size", "48x36", "--seed", "3"];
    let arguments = ["demo", "--data-only", "--perturb", perturb, "--out", word(&out)];
    stdout(&[&arguments[..], &size].concat());
    out.join("data")
}

#[test]
fn exposures_are_shown_where_they_differ() {
    let folder = folder();
    let data = made(folder.path(), "exposure");
    let table = stdout(&["info", word(&data)]);
    assert!(
        table.contains("train with --exposure") && table.contains("0001.png"),
        "{table}"
    );
    let found = json(&stdout(&["info", word(&data), "--json"]))["exposure"].clone();
    let truth = read_json(&data.join("truth.json"));
    let photos = found["photos"].as_array().cloned().unwrap();
    assert_eq!((&found["differ"], photos.len()), (&true.into(), 14));
    for photo in photos {
        let name = photo["name"].as_str().unwrap();
        for channel in 0..3 {
            let stops = |of: &Value| of[channel].as_f64().unwrap();
            let error = stops(&photo["stops"]) - stops(&truth["stops"][name]);
            assert!(error.abs() < 0.15, "{name}: {photo} {}", truth["stops"][name]);
        }
    }
    let control = stdout(&["info", word(&made(folder.path(), "none"))]);
    assert!(
        control.contains("exposure: within") && !control.contains("--exposure"),
        "{control}"
    );
    let without = json(&stdout(&["info", word(super::data()), "--json"]));
    assert_eq!(without["exposure"], Value::Null, "no tracks");
}

#[test]
fn a_run_with_exposures_keeps_one_brightness_and_resumes_to_the_byte() {
    let folder = folder();
    let data = made(folder.path(), "exposure");
    let path = |name: &str| folder.path().join(name);
    let (whole, parts, off) = (path("whole"), path("parts"), path("off"));
    let more = ["--exposure", "--checkpoint-every", "1", "--set", "sh_degree=0"];
    stdout(&train(word(&data), word(&whole), &more));
    stop(&train(word(&data), word(&parts), &more), &parts, "-INT");
    stdout(&["train", "--resume", word(&parts), "--validate"]);
    stdout(&train(word(&data), word(&off), &["--set", "sh_degree=0"]));
    for name in ["scene.ply", "exposures.json"] {
        let bytes = |dir: &Path| fs::read(dir.join(name)).unwrap();
        assert!(bytes(&whole) == bytes(&parts), "{name}: resumed differs");
    }
    assert!(!off.join("exposures.json").exists());
    let report = |dir: &Path| read_json(&dir.join("report.json"));
    assert_eq!(report(&whole)["config"]["exposure"], "gain");
    assert_eq!(report(&off)["config"]["exposure"], "off");
    let gains = read_json(&whole.join("exposures.json"));
    let stops = |photo: &Value| photo["stops"][1].as_f64().unwrap();
    let photos = gains["photos"].as_array().cloned().unwrap();
    let mean = photos.iter().map(stops).sum::<f64>() / photos.len() as f64;
    assert!(photos.len() == 14 && mean.abs() < 1e-9, "{mean}");
    let psnr = |name: &str, more: &[&str]| {
        let out = path(name);
        let longer = ["train", word(&data), "--out", word(&out), "--iterations", "200"];
        stdout(&[&longer[..], &["--set", "sh_degree=0"], more].concat());
        report(&out)["test"]["psnr_db"].as_f64().unwrap()
    };
    let (with, without) = (psnr("with", &["--exposure"]), psnr("without", &[]));
    assert!(with > without + 1.0, "{with} dB, {without} without");
    let refused = path("refused");
    let message = error(&train(word(&data), word(&refused), &["--exposure", "--parsimony"]));
    assert!(message.contains("--parsimony") && !refused.exists(), "{message}");
}

#[test]
fn vignetting_is_told_removed_and_scored_without() {
    let folder = folder();
    let made = folder.path().join("lens");
    let data = made.join("data");
    let size = ["--photos", "24", "--size", "48x36", "--scene", "facade"];
    let arguments = ["demo", "--data-only", "--perturb", "vignetting", "--out", word(&made)];
    stdout(&[&arguments[..], &size].concat());
    assert_eq!(read_json(&data.join("truth.json"))["vignetting_stops"], 0.7);
    let text = stdout(&["info", word(&data)]);
    assert!(text.contains("stops darker: --vignetting removes it"), "{text}");
    let corner = |more: &[&str]| {
        let found = json(&stdout(&[&["info", word(&data), "--json"], more].concat()));
        found["vignetting"][0]["corner_stops"].as_f64().unwrap()
    };
    let (before, after) = (corner(&[]), corner(&["--vignetting"]));
    assert!((before + 0.7).abs() < 0.15 && after.abs() < 0.05, "{before}, {after}");
    let out = folder.path().join("run");
    stdout(&train(word(&data), word(&out), &["--vignetting"]));
    let report = read_json(&out.join("report.json"));
    let score = |more: &[&str]| {
        let scene = out.join("scene.ply");
        let scores = json(&stdout(
            &[&["eval", word(&scene), word(&data), "--json"], more].concat(),
        ));
        scores["mean"]["psnr_db"].as_f64().unwrap()
    };
    let reported = report["test"]["psnr_db"].as_f64().unwrap();
    assert!((score(&["--vignetting"]) - reported).abs() < 1e-3 && (score(&[]) - reported).abs() > 1e-3);
    let message = error(&["info", word(super::data()), "--vignetting"]);
    assert!(
        message.contains("tracks") && message.contains("20 training photographs"),
        "{message}"
    );
}
