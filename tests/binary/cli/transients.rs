//! Ignored transients: the made perturbation, the patches found, files of a run, and resumption.

use super::*;

/// Made photographs of which some have a passer-by.
fn made(folder: &Path) -> PathBuf {
    let out = folder.join("transients");
    let size = ["--photos", "17", "--size", "64x48", "--seed", "3"];
    let arguments = ["demo", "--data-only", "--perturb", "transients", "--out", word(&out)];
    stdout(&[&arguments[..], &size].concat());
    out.join("data")
}

/// Patches of 8 × 8 pixels that a mask leaves out, in part or wholly, and those of which it leaves out at least half.
fn left_out(path: &Path) -> [Vec<bool>; 2] {
    let Ok(mask) = image::open(path) else {
        return [(); 2].map(|()| vec![false; 48]);
    };
    let mut counts = [0; 48];
    for (x, y, pixel) in mask.to_luma8().enumerate_pixels() {
        counts[(y / 8 * 8 + x / 8) as usize] += u32::from(pixel.0[0] < 128);
    }
    [1, 32].map(|least| counts.iter().map(|&count| count >= least).collect())
}

#[test]
fn passers_by_are_found_and_little_else() {
    let folder = folder();
    let data = made(folder.path());
    let out = folder.path().join("run");
    let long = ["train", word(&data), "--out", word(&out), "--iterations", "280"];
    stdout(&[&long[..], &["--against", "transients"]].concat());
    let (mut right, mut flagged, mut found, mut all) = (0, 0, 0, 0);
    for view in 0..17 {
        let name = format!("{view:04}.png");
        let [touched, covered] = left_out(&data.join("truth/masks").join(&name));
        let [ignored, _] = left_out(&out.join("ignored").join(&name));
        let both = |truth: &[bool]| truth.iter().zip(&ignored).filter(|(a, b)| **a && **b).count();
        right += both(&touched);
        found += both(&covered);
        flagged += ignored.iter().filter(|&&is| is).count();
        all += covered.iter().filter(|&&is| is).count();
    }
    println!("{right} of {flagged} patches right, {found} of {all} found");
    assert!(flagged > 0 && right * 10 >= flagged * 8 && found * 10 >= all * 7);
    let report = read_json(&out.join("report.json"));
    let shares = read_json(&out.join("transients.json"));
    assert_eq!(report["ignored_share"], shares["share"]);
    assert_eq!(shares["photos"].as_array().map(Vec::len), Some(14));
}

#[test]
fn a_run_against_transients_resumes_to_the_byte() {
    let folder = folder();
    let data = made(folder.path());
    let path = |name: &str| folder.path().join(name);
    let (whole, parts, off) = (path("whole"), path("parts"), path("off"));
    let more = [
        "--against",
        "transients",
        "--set",
        "transients.factor=2",
        "--exposure",
        "--checkpoint-every",
        "1",
    ];
    stdout(&train(word(&data), word(&whole), &more));
    stop(&train(word(&data), word(&parts), &more), &parts, "-INT");
    stdout(&["train", "--resume", word(&parts), "--validate"]);
    stdout(&train(word(&data), word(&off), &[]));
    for name in ["scene.ply", "transients.json", "exposures.json"] {
        let bytes = |dir: &Path| fs::read(dir.join(name)).unwrap();
        assert!(bytes(&whole) == bytes(&parts), "{name}: resumed differs");
    }
    let share = read_json(&whole.join("report.json"))["ignored_share"].as_f64().unwrap();
    assert!((0.001..=0.4).contains(&share), "{share}");
    assert!(!off.join("transients.json").exists() && !off.join("ignored").exists());
    assert_eq!(read_json(&off.join("report.json"))["ignored_share"], Value::Null);
    let refused = path("refused");
    let message = error(&train(
        word(&data),
        word(&refused),
        &["--against", "transients", "--parsimony"],
    ));
    assert!(message.contains("--parsimony") && !refused.exists(), "{message}");
}
