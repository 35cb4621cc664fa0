//! Round trips through splat-transform, an independent reader and writer; `make clients` installs and runs it.

use ashfall::io::splats;
use ashfall::scene::{Axes, Splats};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Formats that splat-transform both reads and writes.
const ENDS: [&str; 3] = ["spz", "sog", "compressed.ply"];

/// Splats of degree 3 within the range of every format.
fn scene() -> Splats {
    let count = 600;
    let wave = |i: usize| (i as f32 * 1.37).sin();
    Splats {
        mean: (0..count)
            .map(|i| [3.0 * wave(i), wave(i * 7), 2.0 * wave(i * 3 + 1)])
            .collect(),
        quaternion: (0..count)
            .map(|i| [wave(i), wave(i + 5), wave(i * 2 + 3), 1.1])
            .collect(),
        log_scale: (0..count)
            .map(|i| [wave(i) - 4.0, wave(i + 2) - 3.0, wave(i + 4) - 5.0])
            .collect(),
        opacity_logit: (0..count).map(|i| 3.0 * wave(i * 5)).collect(),
        sh: (0..48 * count).map(|i| 0.4 * wave(i * 11)).collect(),
        sh_degree: 3,
        ..Splats::default()
    }
}

/// Converts a file by splat-transform.
fn convert(from: &Path, to: &Path) {
    let program = std::env::var_os("SPLAT_TRANSFORM").expect("SPLAT_TRANSFORM is set by `make clients`");
    let output = Command::new(program)
        .args(["-w", "-g", "cpu"])
        .args([from, to])
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// Asserts that both programs decode a file to the same splats, in its order, to the rounding of floats.
fn assert_agreement(file: &Path, end: &str) {
    let decoded = PathBuf::from(format!("{}.decoded.ply", file.display()));
    convert(file, &decoded);
    let ours = splats::read(file).unwrap();
    let mut theirs = splats::read(&decoded).unwrap().splats;
    // splat-transform passes over the axes that SPZ 4 states.
    theirs.change_axes(ours.stored.axes, Axes::RDF);
    let ours = ours.splats;
    assert_eq!((ours.len(), ours.sh_degree), (theirs.len(), theirs.sh_degree), "{end}");
    let sigmoid = |logits: &[f32]| -> Vec<f32> { logits.iter().map(|l| 1.0 / (1.0 + (-l).exp())).collect() };
    let pairs = [
        (
            "means",
            ours.mean.as_flattened().to_vec(),
            theirs.mean.as_flattened().to_vec(),
            2e-5,
        ),
        ("scales", ours.log_scale.concat(), theirs.log_scale.concat(), 2e-5),
        // The middle of an interval stands for its end.
        (
            "opacities",
            sigmoid(&ours.opacity_logit),
            sigmoid(&theirs.opacity_logit),
            0.3 / 255.0,
        ),
        ("harmonics", ours.sh.clone(), theirs.sh.clone(), 2e-5),
    ];
    for (name, a, b, bound) in pairs {
        let worst = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst <= bound, "{end}: {name} differ by {worst}");
    }
    for (a, b) in ours.quaternion.iter().zip(&theirs.quaternion) {
        let length = |q: &[f32; 4]| q.iter().map(|v| v * v).sum::<f32>().sqrt();
        let cosine = a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>().abs() / (length(a) * length(b));
        assert!(cosine > 1.0 - 1e-5, "{end}: {a:?}, {b:?}");
    }
}

#[test]
#[ignore = "installs splat-transform from npm: `make clients`"]
fn splat_transform_agrees() {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("source.ply");
    splats::write(&source, &scene()).unwrap();
    for end in ENDS {
        let [ours, theirs] = ["ours", "theirs"].map(|name| folder.path().join(format!("{name}.{end}")));
        splats::write(&ours, &scene()).unwrap();
        assert_agreement(&ours, end);
        convert(&source, &theirs);
        let loaded = splats::read_in_axes(&theirs, Some(Axes::RDF)).unwrap().splats;
        assert_eq!((loaded.len(), loaded.sh_degree), (600, 3), "{end}");
        let center = |splats: &Splats| splats.mean.iter().map(|m| f64::from(m[0])).sum::<f64>();
        assert!((center(&loaded) - center(&scene())).abs() < 1.0, "{end}");
    }
}
