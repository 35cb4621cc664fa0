//! Surfels from the command line: training, resumption, drawing, meshes, scores and files.

use super::*;

#[test]
fn runs_of_surfels_resume_to_the_byte_with_either_strategy_and_filter() {
    let folder = folder();
    let data = word(data());
    for (strategy, mode, signal) in [("adc", "default", "-INT"), ("mcmc", "mip", "-KILL")] {
        let path = |name: &str| folder.path().join(format!("{strategy}_{name}"));
        let (whole, parts) = (path("whole"), path("parts"));
        let options = ["--kind", "surfel", "--strategy", strategy, "--mode", mode];
        let more = [&options[..], &["--max-splats", "500", "--checkpoint-every", "1"]].concat();
        stdout(&train(data, word(&whole), &more));
        stop(&train(data, word(&parts), &more), &parts, signal);
        stdout(&["train", "--resume", word(&parts), "--validate"]);
        let bytes = |dir: &Path| fs::read(dir.join("scene.ply")).unwrap_or_default();
        assert!(!bytes(&whole).is_empty());
        assert!(bytes(&whole) == bytes(&parts), "{strategy}: resumed differs");
        check_mode(&parts, mode);
        let report = read_json(&parts.join("report.json"));
        assert_eq!(report["config"]["kind"], "surfel");
        let scene = parts.join("scene.ply");
        assert_eq!(json(&stdout(&["info", word(&scene), "--json"]))["kind"], "surfel");
        let header = String::from_utf8_lossy(&bytes(&parts)).into_owned();
        assert!(header.contains("property float scale_1") && !header.contains("scale_2"));
    }
}

#[test]
fn surfels_are_drawn_meshed_and_exported() {
    let folder = folder();
    let (data, path) = (word(data()), |name: &str| folder.path().join(name));
    let (run_dir, few) = (path("run"), path("few"));
    stdout(&train(data, word(&run_dir), &["--kind", "surfel"]));
    let scene = run_dir.join("scene.ply");
    for show in ["depth", "normal"] {
        let out = path(show);
        stdout(&[
            "render",
            word(&scene),
            "--cameras",
            data,
            "--out",
            word(&out),
            "--show",
            show,
        ]);
        let files = fs::read_dir(&out).unwrap().map(|file| file.unwrap().path());
        assert_eq!(
            files
                .filter(|path| path.extension().is_some_and(|e| e == "png"))
                .count(),
            12
        );
    }
    let mesh = path("mesh.ply");
    stdout(&["mesh", word(&scene), data, "--out", word(&mesh)]);
    assert!(mesh.exists());
    let solid = path("solid.ply");
    stdout(&["export", word(&scene), "--as-3d", "--out", word(&solid)]);
    let info = |path: &Path| json(&stdout(&["info", word(path), "--json"]));
    assert_eq!(info(&solid)["kind"], "3d");
    let again = path("again.ply");
    stdout(&["export", word(&scene), "--out", word(&again)]);
    assert_eq!(info(&again)["kind"], "surfel");
    let told = run(&["export", word(&scene), "--out", word(&path("scene.spz"))]);
    let warning = String::from_utf8_lossy(&told.stderr).into_owned();
    assert!(
        told.status.success() && warning.contains("no place for surfels"),
        "{warning}"
    );
    let pruned = path("pruned.ply");
    let prune = ["prune", word(&scene), data, "--out", word(&pruned)];
    let refused = error(&[&prune[..], &["--merge", "0.5"]].concat());
    assert!(refused.contains("--merge") && !pruned.exists(), "{refused}");
    stdout(&[&prune[..], &["--refit", "2"]].concat());
    assert_eq!(info(&pruned)["kind"], "surfel");
    stdout(&train(data, word(&few), &["--kind", "surfel", "--parsimony"]));
    assert_eq!(info(&few.join("scene.ply"))["kind"], "surfel");
    let needles = [
        "train",
        data,
        "--out",
        word(&few),
        "--kind",
        "surfel",
        "--against",
        "needles",
    ];
    assert!(error(&needles).contains("max_aspect"));
    let original = error(&[
        "render",
        word(&scene),
        "--orbit",
        "2",
        "--out",
        word(&path("o")),
        "--compat",
        "original",
    ]);
    assert!(original.contains("surfels"), "{original}");
}
