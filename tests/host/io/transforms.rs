//! transforms.json: the same scene as COLMAP's, and variations between writers.

use crate::common::files::{self, CENTER, FOCAL, HEIGHT, WIDTH};
use crate::io::{error_at, shared};
use ashfall::io::dataset::{self, OpenOptions};
use ashfall::scene::{AlphaMode, Dataset, PhotoSource, Split};
use serde_json::{Value, json};
use std::path::Path;

fn write(folder: &Path, name: &str, value: &Value) {
    std::fs::write(folder.join(name), value.to_string()).unwrap();
}

pub(crate) fn folder_with(value: &Value) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    files::write_photos(&folder.path().join("images"));
    write(folder.path(), "transforms.json", value);
    folder
}

pub(crate) fn open(folder: &Path) -> ashfall::Result<Dataset> {
    dataset::open(folder, &OpenOptions::default())
}

fn assert_same_cameras(a: &Dataset, b: &Dataset, tolerance: f64) {
    assert_eq!(a.views.len(), b.views.len());
    for (a, b) in a.views.iter().zip(&b.views) {
        let last = |name: &str| name.rsplit('/').next().unwrap().to_owned();
        assert_eq!(last(&a.name), last(&b.name));
        assert!(
            a.camera.rotation.abs_diff_eq(b.camera.rotation, tolerance),
            "{}",
            a.name
        );
        assert!(
            a.camera.position.abs_diff_eq(b.camera.position, tolerance),
            "{}",
            a.name
        );
    }
}

#[test]
fn the_same_scene_has_the_same_cameras_as_in_colmap() {
    let folder = folder_with(&files::transforms());
    let from_json = open(folder.path()).unwrap();
    assert_eq!(from_json.warnings.len(), 1, "no points: {:?}", from_json.warnings);
    let file = folder.path().join("transforms.json");
    assert_same_cameras(&from_json, &open(&file).unwrap(), 0.0);
    files::write_binary(&folder.path().join("sparse"));
    let from_colmap = open(folder.path()).unwrap();
    assert!(!from_colmap.points.is_empty(), "COLMAP comes first where both are");
    assert_same_cameras(&from_json, &from_colmap, 1e-12);
    for (a, b) in from_json.views.iter().zip(&from_colmap.views) {
        assert_eq!(a.camera.focal, b.camera.focal);
        assert_eq!(a.camera.center, b.camera.center);
        assert_eq!((a.camera.width, a.camera.height), (WIDTH, HEIGHT));
    }
}

#[test]
fn the_shared_scene_has_the_same_cameras_in_both_forms() {
    let Some(fox) = shared("fox") else { return };
    let colmap = open(&fox.join("colmap")).unwrap();
    let nerfstudio = open(&fox.join("nerfstudio")).unwrap();
    assert_same_cameras(&colmap, &nerfstudio, 1e-6);
    assert_eq!(nerfstudio.alpha, AlphaMode::Mask);
    assert_eq!(nerfstudio.views[0].camera.focal.to_array(), [343.88, 343.6225]);
    let file = |data: &Dataset| matches!(data.views[0].photo, PhotoSource::File { optics: Some(_), .. });
    assert!(file(&nerfstudio) && !file(&colmap));
}

#[test]
fn the_mini_blender_scene_loads() {
    let Some(path) = shared("nerf_synthetic_mini") else {
        return;
    };
    let options = OpenOptions {
        test_every: 0,
        ..OpenOptions::default()
    };
    let data = dataset::open(&path, &options).unwrap();
    assert_eq!(data.views[0].name, "train/r_0.png");
    assert_eq!(data.views[0].camera.focal.x, 50.0, "a length comes before an angle");
    assert_eq!((data.views[0].camera.width, data.alpha), (50, AlphaMode::Composite));
    let points = ashfall::io::ply::read_points(&path.join("init.ply")).unwrap();
    assert_eq!(points.len(), 100);
    assert!(points.iter().flat_map(|p| p.color).all(|c| (0.0..=1.0).contains(&c)));
}

#[test]
fn a_frame_comes_before_the_root() {
    let mut value = files::transforms();
    let root = value.as_object_mut().unwrap();
    for key in ["fl_y", "cx", "cy"] {
        root.remove(key);
    }
    let angle = 0.8f64;
    let frame = root["frames"][0].as_object_mut().unwrap();
    frame.insert("camera_angle_x".into(), json!(angle));
    frame.insert("cx".into(), json!(5.5));
    frame.insert("k1".into(), json!(0.05));
    let frame = root["frames"][1].as_object_mut().unwrap();
    frame.insert("fl_x".into(), json!(33));
    let data = open(folder_with(&value).path()).unwrap();
    let camera = |name: &str| {
        let view = data.views.iter().find(|v| v.name == name).unwrap();
        let distorted = matches!(view.photo, PhotoSource::File { optics: Some(_), .. });
        (
            view.camera.focal.x,
            view.camera.focal.y,
            view.camera.center.x,
            distorted,
        )
    };
    let from_angle = 0.5 * f64::from(WIDTH) / (0.5 * angle).tan();
    assert_eq!(camera("images/c.png"), (from_angle, from_angle, 5.5, true));
    assert_eq!(camera("images/a b c.png"), (33.0, 33.0, 6.0, false));
    assert_eq!(camera("images/sub/b.png"), (FOCAL[0], FOCAL[0], 6.0, false));
}

#[test]
fn extensions_and_sizes_may_be_missing() {
    let mut value = files::transforms();
    let root = value.as_object_mut().unwrap();
    root.remove("w");
    root.remove("h");
    for frame in root["frames"].as_array_mut().unwrap() {
        let name = frame["file_path"].as_str().unwrap().trim_end_matches(".png").to_owned();
        frame["file_path"] = json!(name.replace('/', "\\"));
    }
    let folder = folder_with(&value);
    let data = open(folder.path()).unwrap();
    assert_eq!(data.views[0].name, "images/a b c");
    assert_eq!(
        (data.views[0].camera.width, data.views[0].camera.height),
        (WIDTH, HEIGHT)
    );
    assert_eq!(data.views[0].camera.center.to_array(), CENTER);
    // Without photographs the size is unknown.
    std::fs::remove_dir_all(folder.path().join("images")).unwrap();
    let cameras_only = OpenOptions {
        photos_required: false,
        ..OpenOptions::default()
    };
    let file = folder.path().join("transforms.json");
    let text = error_at(dataset::open(folder.path(), &cameras_only), &file);
    assert!(text.contains("frame 0") && text.contains("\"w\""), "{text}");
    write(folder.path(), "transforms.json", &files::transforms());
    let data = dataset::open(folder.path(), &cameras_only).unwrap();
    assert!(data.views.iter().all(|v| v.photo == PhotoSource::Absent));
    assert!(open(folder.path()).is_err());
}

#[test]
fn point_clouds_come_along() {
    let mut value = files::transforms();
    value["ply_file_path"] = json!("points/cloud.ply");
    let folder = folder_with(&value);
    let data = open(folder.path()).unwrap();
    assert!(
        data.warnings[0].contains("cloud.ply: the point cloud is missing"),
        "{:?}",
        data.warnings
    );
    std::fs::create_dir(folder.path().join("points")).unwrap();
    let cloud = "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\n\
                 property double z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
                 end_header\n0 0.25 0 255 0 51\nnan 0 0 1 2 3\n0.5 0 0 0 0 0\n";
    std::fs::write(folder.path().join("points/cloud.ply"), cloud).unwrap();
    let data = open(folder.path()).unwrap();
    assert_eq!(data.points.len(), 2);
    assert_eq!(data.points[0].position, [0.0, 0.25, 0.0]);
    assert_eq!(data.points[0].color, [1.0, 0.0, 0.2]);
    assert!(data.warnings[0].contains("1 of 3 points"), "{:?}", data.warnings);
    // Behind all cameras: probably another coordinate system.
    let flipped = cloud
        .replace("0 0.25 0 255", "0 0 -90 255")
        .replace("0.5 0 0 0", "0 0 -91 0");
    std::fs::write(folder.path().join("points/cloud.ply"), flipped).unwrap();
    let data = open(folder.path()).unwrap();
    assert!(
        data.warnings.iter().any(|w| w.contains("coordinate system")),
        "{:?}",
        data.warnings
    );
    value["ply_file_path"] = json!("../cloud.ply");
    write(folder.path(), "transforms.json", &value);
    assert!(error_at(open(folder.path()), folder.path()).contains("refused"));
}

#[test]
fn blenders_split_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    files::write_photos(&folder.path().join("images"));
    let whole = files::transforms();
    let part = |range: std::ops::Range<usize>| {
        let mut part = whole.clone();
        part["frames"] = json!(whole["frames"].as_array().unwrap()[range].to_vec());
        part
    };
    write(folder.path(), "transforms_train.json", &part(0..2));
    write(folder.path(), "transforms_test.json", &part(2..3));
    let data = open(folder.path()).unwrap();
    let names = |split| -> Vec<&str> {
        let indices = data.split(split).into_iter();
        indices.map(|i| data.views[i].name.as_str()).collect()
    };
    assert_eq!(names(Split::Test), ["images/sub/b.png"]);
    assert_eq!(names(Split::Train), ["images/a b c.png", "images/c.png"]);
    let all_to_train = OpenOptions {
        test_every: 0,
        ..OpenOptions::default()
    };
    let data = dataset::open(folder.path(), &all_to_train).unwrap();
    assert_eq!((data.views.len(), data.split(Split::Test).len()), (2, 0));
}
