//! Captures in the forms of RealityCapture and Metashape: sound ones pass the capture check, damaged ones are refused
//! before anything is written.

use crate::captures::Expect::{Clean, Fails, Warns};
use crate::captures::{Expect, Fault, SIZE, check, sound};
use crate::common::camera_lists::{cloud, component, metashape, sensor, table};
use ashfall::scene::{Camera, Similarity};
use glam::{DMat3, DVec3};
use std::fs;
use std::path::Path;

fn cameras() -> Vec<(String, Camera)> {
    let views = sound().views.iter().enumerate();
    views.map(|(i, view)| (format!("{i:04}.png"), view.camera)).collect()
}

/// Replaces the model by a list of cameras and a point cloud.
fn list(folder: &Path, name: &str, text: &str) {
    fs::remove_dir_all(folder.join("sparse")).unwrap();
    fs::write(folder.join(name), text).unwrap();
    fs::write(folder.join("points.ply"), cloud(&sound().points)).unwrap();
}

/// RealityCapture's table with one text in place of another.
fn table_with(folder: &Path, old: &str, new: &str) {
    let cameras = cameras();
    let rows = cameras.iter().map(|(name, camera)| (name.as_str(), *camera));
    list(folder, "cameras.csv", &table(rows, [0.0; 6]).replace(old, new));
}

/// Metashape's list with one text in place of another.
fn list_with(folder: &Path, old: &str, new: &str) {
    let (cameras, world) = (
        cameras(),
        Similarity {
            rotation: DMat3::from_rotation_x(0.7) * DMat3::from_rotation_z(2.0),
            scale: 0.25,
            translation: DVec3::new(1.0, -2.0, 3.0),
        },
    );
    let focal = cameras[0].1.focal;
    let calibration = format!("<f>{}</f><b1>{}</b1>", focal.y, focal.x - focal.y);
    let sensor = sensor(0, "frame", SIZE, &calibration);
    let entries = cameras
        .iter()
        .map(|(name, camera)| (name.trim_end_matches(".png"), *camera));
    let text = metashape(entries, &world, [&sensor, &component(&world)]);
    list(folder, "cameras.xml", &text.replace(old, new));
}

#[rustfmt::skip]
const LISTS: &[(&str, Expect, Fault)] = &[
    ("table_sound", Clean, |f| table_with(f, "\r", "")),
    ("table_of_a_camera_too_many", Warns(&["1 of 11 photographs are missing", "0010.png"]),
        |f| table_with(f, "0009.png,", "0010.png,1,2,3,4,5,6,20,0,0,0,0,0,0,0,0\n0009.png,")),
    ("table_with_distortion_removed_already", Warns(&["undistorted already"]), |f| {
        let cameras = cameras();
        let rows = cameras.iter().map(|(name, camera)| (name.as_str(), *camera));
        list(f, "cameras.csv", &table(rows, [-0.35, 0.0, 0.0, 0.0, 0.0, 0.0]));
    }),
    ("table_without_pitch", Fails(&["cameras.csv", "columns pitch are missing"]), |f| table_with(f, "pitch", "tilt")),
    ("table_of_text", Fails(&["cameras.csv", "line 2", "x is \"west"]), |f| table_with(f, "0000.png,", "0000.png,west")),
    ("list_sound", Clean, |f| list_with(f, "\r", "")),
    ("list_with_a_camera_without_pose", Warns(&["1 of 11 cameras have no pose"]),
        |f| list_with(f, "</cameras>", "<camera id=\"99\" label=\"b\"/></cameras>")),
    ("list_of_no_scale", Fails(&["cameras.xml", "scale 0 is not positive"]),
        |f| list_with(f, "<scale>0.25", "<scale>0")),
    ("list_cut_short", Fails(&["cameras.xml", "cannot be parsed as XML"]), |f| list_with(f, "</document>", "")),
];

#[test]
fn tables_and_lists() {
    check(LISTS);
}
