//! Data set files: PNG photographs, `transforms.json`, points as `.ply`.

use crate::error::{Error, Result};
use crate::scene::{Dataset, Photo, PhotoSource, Point, View};
use glam::DMat3;
use std::path::Path;

/// Writes `dataset`, with photographs in memory or absent, to the folder `dir`, which is created: one PNG per view
/// under its name, `points.ply`, and a `transforms.json` in nerfstudio's form (camera to world, y up and z backward,
/// intrinsics per frame). Existing files of these names are replaced.
pub fn save(dataset: &Dataset, dir: &Path) -> Result<()> {
    for view in &dataset.views {
        let path = dir.join(&view.name);
        if let Some(parent) = path.parent() {
            std::fs::create_dir_all(parent).map_err(Error::io(parent))?;
        }
        match &view.photo {
            PhotoSource::Memory(photo) => save_photo(photo, &path)?,
            PhotoSource::Absent => {}
            PhotoSource::File { path, .. } => {
                return Err(Error::file(path, "not in memory: only made data sets are saved"));
            }
        }
    }
    let frames: Vec<_> = dataset.views.iter().map(frame).collect();
    let transforms = serde_json::json!({
        "camera_model": "OPENCV",
        "ply_file_path": "points.ply",
        "frames": frames,
    });
    let path = dir.join("transforms.json");
    std::fs::write(&path, format!("{transforms:#}\n")).map_err(Error::io(&path))?;
    let path = dir.join("points.ply");
    std::fs::write(&path, points_ply(&dataset.points)).map_err(Error::io(&path))
}

pub(super) fn save_photo(photo: &Photo, path: &Path) -> Result<()> {
    let bytes = photo.rgba.as_flattened();
    let (width, height) = (photo.width, photo.height);
    let opaque = photo.rgba.iter().all(|pixel| pixel[3] == 255);
    let written = if opaque {
        let rgb: Vec<u8> = photo.rgba.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect();
        image::save_buffer(path, &rgb, width, height, image::ColorType::Rgb8)
    } else {
        image::save_buffer(path, bytes, width, height, image::ColorType::Rgba8)
    };
    written.map_err(|error| Error::file(path, format!("cannot write the picture: {error}")))
}

fn frame(View { name, camera, .. }: &View) -> serde_json::Value {
    // Columns: the camera's x, its y (up), its z (backward), its position, in the world.
    let axes = camera.rotation.transpose() * DMat3::from_diagonal([1.0, -1.0, -1.0].into());
    let row = |i: usize| [axes.x_axis[i], axes.y_axis[i], axes.z_axis[i], camera.position[i]];
    serde_json::json!({
        "file_path": name,
        "w": camera.width,
        "h": camera.height,
        "fl_x": camera.focal.x,
        "fl_y": camera.focal.y,
        "cx": camera.center.x,
        "cy": camera.center.y,
        "transform_matrix": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
    })
}

fn points_ply(points: &[Point]) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\n\
         property float x\nproperty float y\nproperty float z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
        points.len()
    )
    .into_bytes();
    for point in points {
        bytes.extend(point.position.iter().flat_map(|v| (*v as f32).to_le_bytes()));
        bytes.extend(point.color.map(Photo::level));
    }
    bytes
}
