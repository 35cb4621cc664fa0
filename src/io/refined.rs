//! A reconstruction with other poses: the files of a data set, with the poses of some photographs moved and all else as
//! it was.

use super::atomic::write_atomically;
use super::colmap::{RigidMotion, corrected, poses_by_frames};
use super::dataset::Reconstruction;
use super::photo_index::{PhotoIndex, cloud_beside};
use super::{metashape, realitycapture};
use crate::{Error, Result};
use glam::{DMat3, DQuat, DVec3};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Motion of a photograph's pose: a turn of the world about the camera, `rotation · turn`, and a shift of its centre.
pub type PoseMotions = BTreeMap<String, (DQuat, DVec3)>;

/// Writes the reconstruction of the data set at `data` to the folder `out`, with the photographs of these names moved:
/// `sparse/0` in COLMAP's form, binary or text as it was, a `transforms.json`, a table of RealityCapture's or a list of
/// Metashape's. Photographs and masks are not copied, points are; those of COLMAP keep their places.
///
/// # Errors
/// A file that cannot be read, or is no reconstruction, or a folder that cannot be written.
pub fn write(data: &Path, out: &Path, motions: &PoseMotions) -> Result<()> {
    match Reconstruction::find(data)? {
        Some(Reconstruction::Colmap(model)) => write_colmap(&model, &out.join("sparse/0"), motions),
        Some(Reconstruction::Transforms(file)) => write_transforms(&file, out, motions),
        Some(Reconstruction::RealityCapture(file)) => write_list(&file, out, motions, |bytes, motion| {
            realitycapture::moved(std::str::from_utf8(bytes).ok()?, motion)
        }),
        Some(Reconstruction::Metashape(file)) => write_list(&file, out, motions, |bytes, motion| {
            metashape::moved(&file, bytes, motion)
        }),
        None => Err(Error::file(data, "is no data set any more")),
    }
}

/// Motion of a label.
type MotionOfLabel<'a> = &'a dyn Fn(&str) -> Option<(DQuat, DVec3)>;

/// Writes a list of cameras with labels, and the points beside it.
fn write_list(
    file: &Path,
    out: &Path,
    motions: &PoseMotions,
    moved: impl Fn(&[u8], MotionOfLabel<'_>) -> Option<String>,
) -> Result<()> {
    let names = PhotoIndex::of(motions.keys().cloned());
    let motion = |label: &str| motions.get(names.find(label).ok()??).copied();
    let text = moved(&read(file)?, &motion).ok_or_else(|| Error::file(file, "has changed since it was read"))?;
    std::fs::create_dir_all(out).map_err(Error::io(out))?;
    if let Some(points) = cloud_beside(file) {
        save(&out.join(points.file_name().unwrap_or_default()), &read(&points)?)?;
    }
    save(&out.join(file.file_name().unwrap_or_default()), text.as_bytes())
}

fn write_colmap(model: &Path, out: &Path, motions: &PoseMotions) -> Result<()> {
    std::fs::create_dir_all(out).map_err(Error::io(out))?;
    let extension = match model.join("cameras.bin").is_file() {
        true => "bin",
        false => "txt",
    };
    for name in ["cameras", "points3D", "images"] {
        let path = model.join(name).with_extension(extension);
        if !path.is_file() {
            continue;
        }
        let mut bytes = read(&path)?;
        if name == "images" {
            let moved = match extension {
                "bin" => move_binary(&mut bytes, motions, &poses_by_frames(model)),
                _ => move_text(&bytes, motions).map(|text| bytes = text),
            };
            moved.ok_or_else(|| Error::file(&path, "has changed since it was read"))?;
        }
        save(&out.join(name).with_extension(extension), &bytes)?;
    }
    Ok(())
}

/// Moves poses of COLMAP's images.bin in place, those of frames where they differ; `None` if it ends early.
fn move_binary(bytes: &mut [u8], motions: &PoseMotions, frames: &BTreeMap<u64, RigidMotion>) -> Option<()> {
    let count = u64::from_le_bytes(bytes.get(..8)?.try_into().ok()?);
    let mut at = 8;
    for _ in 0..count {
        let pose = at + 4..at + 60;
        let name_at = at + 64;
        let length = bytes.get(name_at..)?.iter().position(|&byte| byte == 0)?;
        let name = String::from_utf8_lossy(&bytes[name_at..name_at + length]).into_owned();
        let id = u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?);
        let given: [f64; 7] = bytemuck::pod_collect_to_vec(bytes.get(pose.clone())?).try_into().ok()?;
        let frame = frames.get(&id.into()).and_then(|frame| corrected(given, frame));
        let mut numbers = frame.unwrap_or(given);
        if let Some(motion) = motions.get(&name) {
            move_pose(&mut numbers, motion);
        }
        bytes[pose].copy_from_slice(bytemuck::bytes_of(&numbers));
        let end = name_at + length + 1;
        let points = u64::from_le_bytes(bytes.get(end..end + 8)?.try_into().ok()?);
        at = usize::try_from(points).ok()?.checked_mul(24)?.checked_add(end + 8)?;
    }
    Some(())
}

/// COLMAP's images.txt with moved poses; `None` if a line is no image.
fn move_text(bytes: &[u8], motions: &PoseMotions) -> Option<Vec<u8>> {
    let text = std::str::from_utf8(bytes).ok()?;
    let (mut moved, mut is_points) = (String::new(), false);
    for line in text.lines() {
        let is_record = !line.trim_start().starts_with('#') && !is_points && !line.trim().is_empty();
        // Each record is followed by a line of points, which may be empty; comments may stand anywhere.
        is_points = is_record || (is_points && line.trim_start().starts_with('#'));
        let words: Vec<&str> = line.split_whitespace().collect();
        let name = words.get(9..).map(|name| name.join(" ")).unwrap_or_default();
        match motions.get(&name).filter(|_| is_record) {
            Some(motion) => {
                let mut numbers = [0.0; 7];
                for (number, word) in numbers.iter_mut().zip(&words[1..8]) {
                    *number = word.parse().ok()?;
                }
                move_pose(&mut numbers, motion);
                let numbers = numbers.map(|number| number.to_string()).join(" ");
                moved += &format!("{} {numbers} {} {name}", words[0], words[8]);
            }
            None => moved += line,
        }
        moved.push('\n');
    }
    Some(moved.into_bytes())
}

/// Moves `view_from_world`: quaternion w, x, y, z and translation.
fn move_pose(numbers: &mut [f64; 7], (turn, shift): &(DQuat, DVec3)) {
    let [w, x, y, z, translation @ ..] = *numbers;
    let rotation = DQuat::from_xyzw(x, y, z, w).normalize();
    let center = -(rotation.inverse() * DVec3::from(translation)) + *shift;
    let rotation = rotation * *turn;
    let translation = -(rotation * center);
    *numbers = [
        rotation.w,
        rotation.x,
        rotation.y,
        rotation.z,
        translation.x,
        translation.y,
        translation.z,
    ];
}

fn write_transforms(file: &Path, out: &Path, motions: &PoseMotions) -> Result<()> {
    let bytes = read(file)?;
    let changed = || Error::file(file, "has changed since it was read");
    let mut root: Value = serde_json::from_slice(&bytes).map_err(|_| changed())?;
    let points = root.get("ply_file_path").and_then(Value::as_str).map(PathBuf::from);
    let frames = root
        .get_mut("frames")
        .and_then(Value::as_array_mut)
        .ok_or_else(changed)?;
    for frame in frames {
        let name = frame.get("file_path").and_then(Value::as_str).unwrap_or_default();
        let name = name.replace('\\', "/");
        let Some(motion) = motions.get(name.trim_start_matches("./")) else {
            continue;
        };
        let matrix = frame.get("transform_matrix").cloned().unwrap_or_default();
        let rows: Vec<Vec<f64>> = serde_json::from_value(matrix).map_err(|_| changed())?;
        frame["transform_matrix"] = json!(moved_matrix(rows, motion).ok_or_else(changed)?);
    }
    std::fs::create_dir_all(out).map_err(Error::io(out))?;
    let name = file.file_name().unwrap_or("transforms.json".as_ref());
    save(&out.join(name), format!("{root:#}\n").as_bytes())?;
    let folder = file.parent().unwrap_or(Path::new("."));
    match points.filter(|name| folder.join(name).is_file()) {
        Some(name) => {
            let to = out.join(&name);
            if let Some(parent) = to.parent() {
                std::fs::create_dir_all(parent).map_err(Error::io(parent))?;
            }
            save(&to, &read(&folder.join(name))?)
        }
        None => Ok(()),
    }
}

/// Camera to world, of any scale, moved; `None` unless it has three rows of four numbers.
fn moved_matrix(mut rows: Vec<Vec<f64>>, (turn, shift): &(DQuat, DVec3)) -> Option<Vec<Vec<f64>>> {
    if rows.len() < 3 || rows.iter().any(|row| row.len() != 4) {
        return None;
    }
    let back = DMat3::from_quat(turn.inverse());
    for column in 0..4 {
        let old = DVec3::new(rows[0][column], rows[1][column], rows[2][column]);
        let new = if column < 3 { back * old } else { old + *shift };
        for (row, value) in rows.iter_mut().zip(new.to_array()) {
            row[column] = value;
        }
    }
    Some(rows)
}

fn read(path: &Path) -> Result<Vec<u8>> {
    std::fs::read(path).map_err(Error::io(path))
}

fn save(path: &Path, bytes: &[u8]) -> Result<()> {
    write_atomically(path, |file| file.write_all(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A turn of 90° about z and a shift, for a photograph with a space in its name.
    fn motions() -> PoseMotions {
        let turn = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
        [("b c.jpg".to_owned(), (turn, DVec3::new(1.0, 0.0, 0.0)))].into()
    }

    #[test]
    fn poses_of_text_move_and_all_else_stays() {
        let text = "# images\n7 1 0 0 0 0 0 0 1 a.jpg\n\n8 1 0 0 0 2 0 0 1 b c.jpg\n# comment\n1 1 0 0 0 0 0 0 1\n\n";
        let moved = move_text(text.as_bytes(), &motions()).unwrap_or_default();
        let moved = String::from_utf8_lossy(&moved).into_owned();
        let (old, new): (Vec<&str>, Vec<&str>) = (text.lines().collect(), moved.lines().collect());
        for line in [0, 1, 2, 4, 5, 6] {
            assert_eq!(new[line], old[line], "{line}");
        }
        assert!(new[3].starts_with("8 ") && new[3].ends_with(" 1 b c.jpg"), "{}", new[3]);
        let numbers: Vec<f64> = new[3]
            .split(' ')
            .skip(1)
            .take(7)
            .filter_map(|word| word.parse().ok())
            .collect();
        // The centre was (-2, 0, 0) and is (-1, 0, 0); the turn takes its opposite, (1, 0, 0), to (0, 1, 0).
        let half = 0.5_f64.sqrt();
        let wanted = [half, 0.0, 0.0, half, 0.0, 1.0, 0.0];
        assert!(
            numbers.iter().zip(wanted).all(|(n, w)| (n - w).abs() < 1e-12),
            "{numbers:?}"
        );
    }

    #[test]
    fn binary_poses_move_in_place_and_a_short_file_is_none() {
        let mut bytes = 1_u64.to_le_bytes().to_vec();
        bytes.extend(8_u32.to_le_bytes());
        let pose = [1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0_f64];
        bytes.extend(pose.map(f64::to_le_bytes).as_flattened());
        bytes.extend(1_u32.to_le_bytes());
        bytes.extend(b"b c.jpg\0");
        bytes.extend(1_u64.to_le_bytes());
        bytes.extend([9; 24]);
        let (mut moved, mut other) = (bytes.clone(), bytes.clone());
        assert!(move_binary(&mut moved, &motions(), &BTreeMap::new()).is_some());
        assert!(move_binary(&mut other, &PoseMotions::new(), &BTreeMap::new()).is_some());
        assert_eq!(other, bytes);
        assert_eq!((&moved[..12], &moved[68..]), (&bytes[..12], &bytes[68..]));
        assert_ne!(moved[12..68], bytes[12..68]);
        for length in [4, 30, 70, 80] {
            assert!(
                move_binary(&mut bytes[..length].to_vec(), &motions(), &BTreeMap::new()).is_none(),
                "{length}"
            );
        }
    }
}
