//! Scenes by file name, and the shared scene in all its formats.

use crate::io::{error_at, shared};
use ashfall::io::{ply, splats};
use ashfall::scene::Splats;

#[test]
fn other_formats_say_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.txt", "a"] {
        let path = folder.path().join(name);
        std::fs::write(&path, b"whatever").unwrap();
        assert!(error_at(splats::read(&path), &path).contains(".ply"));
    }
    for (name, word) in [
        ("a.spz", "SPZ"),
        ("A.SPZ", "SPZ"),
        ("a.ksplat", "4096 bytes"),
        ("a.sog", "ZIP"),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, b"whatever").unwrap();
        assert!(error_at(splats::read(&path), &path).contains(word));
    }
    let path = folder.path().join("scene.ksplat");
    assert!(error_at(splats::write(&path, &Splats::default()), &path).contains(".ply"));
    let absent = folder.path().join("absent.ply");
    error_at(splats::read(&absent), &absent);
    error_at(ply::read(folder.path()), folder.path());
}

/// Asserts that splat `i` agrees with an entry of `reference.json`.
fn assert_matches(splats: &Splats, i: usize, entry: &serde_json::Value, tolerance: f32) {
    let numbers = |value: &serde_json::Value| -> Vec<f32> {
        let list = value.as_array().unwrap();
        list.iter().map(|v| v.as_f64().unwrap() as f32).collect()
    };
    let close = |a: &[f32], b: &[f32], what: &str| {
        assert_eq!(a.len(), b.len(), "{what}");
        for (a, b) in a.iter().zip(b) {
            assert!((a - b).abs() <= tolerance, "splat {i}: {what} {a} is not {b}");
        }
    };
    close(&splats.mean[i], &numbers(&entry["position"]), "position");
    close(&splats.log_scale[i], &numbers(&entry["log_scale"]), "scale");
    close(&splats.quaternion[i], &numbers(&entry["quat_wxyz"]), "rotation");
    let opacity = entry["opacity_logit"].as_f64().unwrap() as f32;
    close(&[splats.opacity_logit[i]], &[opacity], "opacity");
    let sh = &splats.sh[i * splats.sh_stride()..][..splats.sh_stride()];
    close(&sh[..3], &numbers(&entry["f_dc"]), "colour");
    for channel in 0..3 {
        let known = numbers(&entry["sh"][channel]);
        let stored: Vec<f32> = sh[3..].iter().skip(channel).step_by(3).copied().collect();
        let count = known.len().min(stored.len());
        close(&stored[..count], &known[..count], "harmonics");
    }
}

#[test]
fn the_shared_scene_reads_as_its_reference() {
    let Some(folder) = shared("splats/playbot") else {
        return;
    };
    let reference = std::fs::read(folder.join("reference.json")).unwrap();
    let reference: serde_json::Value = serde_json::from_slice(&reference).unwrap();
    let entries = reference["splats"].as_array().unwrap();
    for (name, count, degree) in [
        ("playbot_inria_sh3.ply", 8406, 3),
        ("playbot_first1000_sh2_otherorder.ply", 1000, 2),
        ("playbot_first1000_sh0.ply", 1000, 0),
        ("playbot_first100_bigendian.ply", 100, 3),
        ("playbot_first50_ascii.ply", 50, 3),
    ] {
        let loaded = splats::read(&folder.join(name)).unwrap();
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
        assert_eq!((loaded.splats.len(), loaded.splats.sh_degree), (count, degree));
        for (i, entry) in entries.iter().enumerate() {
            assert_matches(&loaded.splats, i, entry, 1e-6);
        }
    }
}

#[test]
fn the_shared_records_are_close_to_the_reference() {
    let Some(folder) = shared("splats/playbot") else {
        return;
    };
    let exact = splats::read(&folder.join("playbot_inria_sh3.ply")).unwrap().splats;
    let loaded = splats::read(&folder.join("playbot.splat")).unwrap();
    let records = loaded.splats;
    assert_eq!((records.len(), records.sh_degree), (exact.len(), 0));
    assert_eq!(records.mean, exact.mean);
    let dot = |i: usize| -> f32 {
        let (a, b) = (records.quaternion[i], exact.quaternion[i]);
        let length = |q: [f32; 4]| q.iter().map(|v| v * v).sum::<f32>().sqrt();
        (0..4).map(|k| a[k] * b[k]).sum::<f32>() / (length(a) * length(b))
    };
    for i in 0..exact.len() {
        let opacity = (records.opacity_logit[i] - exact.opacity_logit[i]).abs();
        assert!(opacity < 1e-3, "splat {i}: opacity is off by {opacity}");
        for axis in 0..3 {
            let scale = (records.log_scale[i][axis] - exact.log_scale[i][axis]).abs();
            assert!(scale < 1e-4, "splat {i}: scale is off by {scale}");
        }
        assert!(dot(i).abs() > (2.0f32).to_radians().cos(), "splat {i}: rotation");
    }
}
