//! Invalid transforms.json files.

use crate::common::files;
use crate::io::error_at;
use crate::io::transforms::{folder_with, open};
use glam::DMat3;
use serde_json::{Value, json};

#[test]
fn matrices_that_are_no_poses_are_refused() {
    let changed = |matrix: Value| {
        let mut value = files::transforms();
        value["frames"][1]["transform_matrix"] = matrix;
        let folder = folder_with(&value);
        (open(folder.path()), folder)
    };
    let fault = |matrix: Value| {
        let (result, folder) = changed(matrix);
        let text = error_at(result, &folder.path().join("transforms.json"));
        assert!(text.contains("frame 1"), "{text}");
        text
    };
    let diagonal =
        |x: f64, y: f64, z: f64, shear: f64| json!([[x, shear, 0, 0], [0, y, 0, 0], [0, 0, z, 0], [0, 0, 0, 1]]);
    assert!(fault(diagonal(0.0, 1.0, 1.0, 0.0)).contains("singular"));
    assert!(fault(diagonal(0.0, 0.0, 0.0, 0.0)).contains("singular"));
    assert!(fault(diagonal(1.0, 1.0, -1.0, 0.0)).contains("reflection"));
    assert!(fault(diagonal(1.0, 1.0, 1.0, 0.5)).contains("sheared"));
    assert!(fault(diagonal(1.0, 2.0, 1.0, 0.0)).contains("sheared"));
    assert!(fault(json!([[1, 0], [0, 1]])).contains("4 rows"));
    assert!(fault(json!("none")).contains("4 rows"));
    let (scaled, _folder) = changed(diagonal(3.0, 3.0, 3.0, 0.0));
    let scaled = scaled.unwrap();
    assert!(
        scaled.warnings[0].contains("1 rotations are scaled"),
        "{:?}",
        scaled.warnings
    );
    // Three rows are enough, and deviations by rounding of single precision are not a scale.
    let noisy = 1.0 + 3e-7;
    let (three, _folder) = changed(json!([[noisy, 0, 1e-7, 1], [0, 1, 0, 2], [0, 0, 1, 3]]));
    let three = three.unwrap();
    assert_eq!(three.warnings.len(), 1, "no points: {:?}", three.warnings);
    for data in [scaled, three] {
        for view in data.views {
            let square = view.camera.rotation * view.camera.rotation.transpose();
            assert!(square.abs_diff_eq(DMat3::IDENTITY, 1e-12));
        }
    }
}

#[test]
fn names_stay_inside_the_folder() {
    for name in ["/etc/hostname", "../x.png", "images/../../x.png", "", "..\\x.png"] {
        let mut value = files::transforms();
        value["frames"][2]["file_path"] = json!(name);
        let folder = folder_with(&value);
        let text = error_at(open(folder.path()), &folder.path().join("transforms.json"));
        assert!(text.contains("frame 2") && text.contains("refused"), "{text}");
    }
}

#[test]
fn lenses_beyond_the_model_are_refused() {
    for (key, value, word) in [
        ("camera_model", json!("ORTHOPHOTO"), "ORTHOPHOTO"),
        ("camera_model", json!(7), "not a text"),
        ("k4", json!(0.1), "k4"),
        ("k6", json!(0.1), "k6"),
        ("k3", json!([]), "\"k3\""),
        ("w", json!(12.5), "12.5"),
        ("w", json!(1e9), "1000000000"),
        ("h", json!(-3), "-3"),
        ("k1", json!("no"), "\"k1\""),
    ] {
        let mut scene = files::transforms();
        scene[key] = value;
        let folder = folder_with(&scene);
        let text = error_at(open(folder.path()), &folder.path().join("transforms.json"));
        assert!(text.contains(word), "{text}");
    }
    let mut scene = files::transforms();
    scene["k3"] = json!(0.1);
    scene["k4"] = Value::Null;
    open(folder_with(&scene).path()).unwrap();
    scene["k4"] = json!(0.01);
    for model in ["FULL_OPENCV", "OPENCV_FISHEYE"] {
        scene["camera_model"] = json!(model);
        open(folder_with(&scene).path()).unwrap();
    }
}
