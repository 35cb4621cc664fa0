//! Refined poses: the made perturbation, comparison with the truth, files of a run, and resumption.

use super::*;

/// Made photographs with errors of the cameras.
fn made(folder: &Path) -> PathBuf {
    let out = folder.join("poses");
    let size = ["--photos", "17", "--size", "48x36", "--seed", "3"];
    let arguments = ["demo", "--data-only", "--perturb", "poses", "--out", word(&out)];
    stdout(&[&arguments[..], &size].concat());
    out.join("data")
}

#[test]
fn cameras_are_compared_with_those_of_another_reconstruction() {
    let folder = folder();
    let data = made(folder.path());
    let truth = data.join("truth");
    let found = json(&stdout(&["info", word(&data), "--json", "--cameras", word(&truth)]))["cameras"].clone();
    for key in ["rms_degrees", "rms_percent_of_extent"] {
        let rms = found[key].as_f64().unwrap();
        assert!((0.35..0.65).contains(&rms), "{key}: {rms}");
    }
    // The similarity has been taken out of the errors.
    let similarity = &found["similarity"];
    assert!(
        (similarity["scale"].as_f64().unwrap() - 1.0).abs() < 1e-3,
        "{similarity}"
    );
    assert_eq!(found["photos"].as_array().map(Vec::len), Some(14));
    let same = json(&stdout(&["info", word(&data), "--json", "--cameras", word(&data)]))["cameras"].clone();
    assert!(same["rms_degrees"].as_f64().unwrap() < 1e-9, "{same}");
    let other = error(&["info", word(&data), "--cameras", word(super::data())]);
    assert!(other.contains("has 0 of the training photographs"), "{other}");
}

#[test]
fn a_run_with_refined_poses_writes_them_and_resumes_to_the_byte() {
    let folder = folder();
    let data = made(folder.path());
    let path = |name: &str| folder.path().join(name);
    let (whole, parts, off) = (path("whole"), path("parts"), path("off"));
    let more = ["--refine-poses", "--checkpoint-every", "1", "--set", "sh_degree=0"];
    stdout(&train(word(&data), word(&whole), &more));
    stop(&train(word(&data), word(&parts), &more), &parts, "-INT");
    stdout(&["train", "--resume", word(&parts), "--validate"]);
    stdout(&train(word(&data), word(&off), &[]));
    for name in ["scene.ply", "poses.json", "refined/sparse/0/images.bin"] {
        let bytes = |dir: &Path| fs::read(dir.join(name)).unwrap();
        assert!(bytes(&whole) == bytes(&parts), "{name}: resumed differs");
    }
    assert!(!off.join("poses.json").exists() && !off.join("refined").exists());
    let poses = read_json(&whole.join("poses.json"));
    assert!(poses["rms_degrees"].as_f64().unwrap() > 0.0, "{poses}");
    // The refined reconstruction is one: its cameras are where poses.json says, and the scene is judged by them.
    let refined = whole.join("refined");
    let found = json(&stdout(&["info", word(&data), "--json", "--cameras", word(&refined)]))["cameras"].clone();
    let difference = found["rms_degrees"].as_f64().unwrap() - poses["rms_degrees"].as_f64().unwrap();
    assert!(difference.abs() < 1e-6, "{found}");
    let scene = whole.join("scene.ply");
    let eval = |more: &[&str]| {
        json(&stdout(
            &[&["eval", word(&scene), word(&data), "--json"][..], more].concat(),
        ))
    };
    let (raw, moved) = (eval(&[]), eval(&["--poses", word(&refined)]));
    assert_eq!((&raw["poses"], &moved["poses"]), (&"raw".into(), &"sim3".into()));
    assert_eq!(raw["mean"], read_json(&whole.join("report.json"))["test"]);
    let psnr = |scores: &Value| scores["mean"]["psnr_db"].as_f64().unwrap();
    assert!(
        (psnr(&raw) - psnr(&moved)).abs() < 1e-3,
        "the gauge is that of the data set"
    );
    let aligned = eval(&["--align"]);
    assert_eq!(aligned["poses"], "aligned");
    assert!(
        psnr(&aligned) > psnr(&raw) && aligned["alignment"]["rms_degrees"].is_f64(),
        "{aligned}"
    );
    let trained = eval(&["--poses", word(&refined), "--split", "train"]);
    assert_eq!(trained["mean"], read_json(&whole.join("report.json"))["train"]);
    let refused = path("refused");
    let message = error(&train(word(&data), word(&refused), &["--refine-poses", "--parsimony"]));
    assert!(message.contains("--parsimony") && !refused.exists(), "{message}");
}

#[test]
fn a_transforms_file_is_refined_in_its_own_form() {
    let folder = folder();
    let (made, out) = (folder.path().join("made"), folder.path().join("run"));
    let size = ["--photos", "16", "--size", "96x72", "--out", word(&made)];
    stdout(&[&["demo", "--data-only"][..], &size].concat());
    let data = made.join("data");
    stdout(&train(word(&data), word(&out), &["--refine-poses"]));
    let [given, refined] = [&data, &out.join("refined")].map(|dir| read_json(&dir.join("transforms.json")));
    assert_eq!(
        given["frames"].as_array().map(Vec::len),
        refined["frames"].as_array().map(Vec::len)
    );
    let matrix = |of: &Value, frame: usize| of["frames"][frame]["transform_matrix"].clone();
    assert_eq!(matrix(&given, 0), matrix(&refined, 0), "a test view");
    assert_ne!(matrix(&given, 1), matrix(&refined, 1));
    let (poses, refined) = (read_json(&out.join("poses.json")), out.join("refined"));
    let found = json(&stdout(&["info", word(&data), "--json", "--cameras", word(&refined)]));
    let rms = |of: &Value| of["rms_degrees"].as_f64().unwrap();
    assert!((rms(&found["cameras"]) - rms(&poses)).abs() < 1e-6, "{poses}");
}
