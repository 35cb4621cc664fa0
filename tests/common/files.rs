//! The same small reconstruction in every format: COLMAP binary, COLMAP text, transforms.json.

use ashfall::scene::Point;
use glam::{DMat3, DQuat, DVec3};
use std::fmt::Write as _;
use std::path::Path;

/// A view: its name, `view_from_world` and translation.
pub(crate) struct Pose {
    pub(crate) id: u32,
    pub(crate) name: &'static str,
    pub(crate) quaternion: DQuat,
    pub(crate) translation: DVec3,
}

impl Pose {
    pub(crate) fn rotation(&self) -> DMat3 {
        DMat3::from_quat(self.quaternion)
    }

    pub(crate) fn position(&self) -> DVec3 {
        -(self.rotation().transpose() * self.translation)
    }
}

pub(crate) const WIDTH: u32 = 12;
pub(crate) const HEIGHT: u32 = 8;
pub(crate) const FOCAL: [f64; 2] = [20.5, 21.25];
pub(crate) const CENTER: [f64; 2] = [6.125, 3.75];

/// Poses with unordered ids with gaps, one name with spaces, one in a folder.
pub(crate) fn poses() -> Vec<Pose> {
    [(7, "c.png"), (2, "a b c.png"), (40, "sub/b.png")]
        .into_iter()
        .enumerate()
        .map(|(i, (id, name))| {
            let axis = DVec3::new(0.3, 1.0, 0.2 * i as f64).normalize();
            Pose {
                id,
                name,
                quaternion: DQuat::from_axis_angle(axis, 0.1 + 0.2 * i as f64),
                translation: DVec3::new(0.25 * i as f64, -0.5, 4.0),
            }
        })
        .collect()
}

/// Points by id, unordered and with gaps.
pub(crate) fn points() -> Vec<(u64, Point)> {
    [900, 3, 41, 7]
        .into_iter()
        .map(|id| {
            let t = id as f32 / 1000.0;
            let point = Point {
                position: [t - 0.4, 0.3 - t, 0.5 * t].map(f64::from),
                color: [t, 0.5, 1.0 - t].map(|c| (c * 255.0).round() / 255.0),
            };
            (id, point)
        })
        .collect()
}

pub(crate) fn byte(channel: f32) -> u8 {
    (channel * 255.0).round() as u8
}

/// Writes a photograph for each view below `folder`.
pub(crate) fn write_photos(folder: &Path) {
    for pose in poses() {
        let path = folder.join(pose.name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        let pixel = |x: u32, y: u32| image::Rgb([(x * 20) as u8, (y * 30) as u8, pose.id as u8]);
        image::RgbImage::from_fn(WIDTH, HEIGHT, pixel).save(&path).unwrap();
    }
}

/// Writes `cameras`, `images` and `points3D` as `.bin`.
pub(crate) fn write_binary(model: &Path) {
    std::fs::create_dir_all(model).unwrap();
    let mut cameras = 1u64.to_le_bytes().to_vec();
    cameras.extend(5u32.to_le_bytes());
    cameras.extend(1u32.to_le_bytes());
    cameras.extend(u64::from(WIDTH).to_le_bytes());
    cameras.extend(u64::from(HEIGHT).to_le_bytes());
    for parameter in FOCAL.into_iter().chain(CENTER) {
        cameras.extend(parameter.to_le_bytes());
    }
    std::fs::write(model.join("cameras.bin"), cameras).unwrap();

    let mut images = (poses().len() as u64).to_le_bytes().to_vec();
    for (i, pose) in poses().into_iter().enumerate() {
        images.extend(pose.id.to_le_bytes());
        let DQuat { x, y, z, w } = pose.quaternion;
        for value in [w, x, y, z].into_iter().chain(pose.translation.to_array()) {
            images.extend(value.to_le_bytes());
        }
        images.extend(5u32.to_le_bytes());
        images.extend(pose.name.as_bytes());
        images.push(0);
        images.extend((i as u64).to_le_bytes());
        for _ in 0..i {
            images.extend([1.5f64, 2.5].map(f64::to_le_bytes).concat());
            images.extend(u64::MAX.to_le_bytes());
        }
    }
    std::fs::write(model.join("images.bin"), images).unwrap();

    let mut file = (points().len() as u64).to_le_bytes().to_vec();
    for (id, point) in points() {
        file.extend(id.to_le_bytes());
        for value in point.position {
            file.extend(value.to_le_bytes());
        }
        file.extend(point.color.map(byte));
        file.extend(0.5f64.to_le_bytes());
        file.extend(2u64.to_le_bytes());
        file.extend([7u32, 0, 2, 1].map(u32::to_le_bytes).concat());
    }
    std::fs::write(model.join("points3D.bin"), file).unwrap();
}

/// Writes the same as `.txt`; the first view has no 2D point, so its second line is empty.
pub(crate) fn write_text(model: &Path) {
    std::fs::create_dir_all(model).unwrap();
    let [fx, fy] = FOCAL;
    let [cx, cy] = CENTER;
    let cameras = format!("# Camera list\n\n5 PINHOLE {WIDTH} {HEIGHT} {fx} {fy} {cx} {cy}\n");
    std::fs::write(model.join("cameras.txt"), cameras).unwrap();

    let mut images = String::from("# Image list with two lines of data per image:\n");
    for (i, pose) in poses().into_iter().enumerate() {
        let DQuat { x, y, z, w } = pose.quaternion;
        let DVec3 { x: tx, y: ty, z: tz } = pose.translation;
        let (id, name) = (pose.id, pose.name);
        writeln!(images, "{id} {w} {x} {y} {z} {tx} {ty} {tz} 5 {name}").unwrap();
        writeln!(images, "{}", "1.5 2.5 -1 ".repeat(i)).unwrap();
    }
    std::fs::write(model.join("images.txt"), images).unwrap();

    let mut file = String::from("# 3D point list\n");
    for (id, point) in points() {
        let [x, y, z] = point.position;
        let [r, g, b] = point.color.map(byte);
        writeln!(file, "{id} {x} {y} {z} {r} {g} {b} 0.5 7 0 2 1").unwrap();
    }
    std::fs::write(model.join("points3D.txt"), file).unwrap();
}

/// The rows of a view's `transform_matrix`: camera to world, y up, z backward.
pub(crate) fn transform_matrix(pose: &Pose) -> Vec<Vec<f64>> {
    let flip = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    let linear = (pose.rotation().transpose() * flip).transpose();
    let position = pose.position();
    let row = |axis: DVec3, p: f64| vec![axis.x, axis.y, axis.z, p];
    vec![
        row(linear.x_axis, position.x),
        row(linear.y_axis, position.y),
        row(linear.z_axis, position.z),
        vec![0.0, 0.0, 0.0, 1.0],
    ]
}

/// The whole `transforms.json`, photographs below `images/`.
pub(crate) fn transforms() -> serde_json::Value {
    let frames: Vec<_> = poses()
        .iter()
        .map(|pose| {
            serde_json::json!({
                "file_path": format!("./images/{}", pose.name),
                "transform_matrix": transform_matrix(pose),
            })
        })
        .collect();
    serde_json::json!({
        "camera_model": "OPENCV",
        "fl_x": FOCAL[0], "fl_y": FOCAL[1], "cx": CENTER[0], "cy": CENTER[1],
        "w": WIDTH, "h": HEIGHT,
        "applied_transform": [[0, 1, 0, 5], [1, 0, 0, 0], [0, 0, -1, 0]],
        "frames": frames,
    })
}
