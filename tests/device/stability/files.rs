//! Section 10 of the catalogue, and the bindings of 10b: one small test of each entry. Damaged files are tested in
//! tests/host/io, tests/binary/broken.rs and tests/slow/fuzz.
//!
//! * 101: EXR files are written, never read: there is no reader to attack.

use crate::common::files;
use crate::common::scenes;
use crate::stability::lab::{Lab, lab};
use crate::stability::trained::train;
use ashfall::io::dataset::{self, OpenOptions};
use ashfall::io::{photo, splats};
use ashfall::render::{Blocks, Precision, of_degree, plane_count};
use ashfall::scene::{Camera, Dataset, View};
use ashfall::train::TrainConfig;
use glam::{DMat3, DVec3};
use std::fs;
use std::path::Path;

/// A file is read back bit for bit; a truncated file is an error that names it; an invalid splat is dropped alone.
#[test]
fn f097_ply() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.ply");
    let mut scene = scenes::gentle(1097, 5, 8, 8, 1).splats;
    splats::write(&path, &scene).unwrap();
    assert!(splats::read(&path).unwrap().splats == scene);
    let bytes = fs::read(&path).unwrap();
    for end in (0..bytes.len()).step_by(7) {
        fs::write(&path, &bytes[..end]).unwrap();
        let error = splats::read(&path).unwrap_err().to_string();
        assert!(error.contains("scene.ply"), "{end} bytes: {error}");
    }
    scene.opacity_logit[2] = f32::NAN;
    splats::write(&path, &scene).unwrap();
    let loaded = splats::read(&path).unwrap();
    assert_eq!((loaded.splats.len(), loaded.warnings.len()), (4, 1));
}

/// Names and cameras of the views of the data set made by `write`.
fn views(write: &dyn Fn(&Path)) -> Vec<(String, Camera)> {
    let folder = tempfile::tempdir().unwrap();
    files::write_photos(&folder.path().join("images"));
    write(folder.path());
    let dataset = dataset::open(folder.path(), &OpenOptions::default()).unwrap();
    let view = |v: &View| (v.name.rsplit('/').next().unwrap().to_owned(), v.camera);
    dataset.views.iter().map(view).collect()
}

/// The same reconstruction as text and as binary is the same data set; ids have gaps, and names have spaces.
#[test]
fn f098_colmap() {
    let text = views(&|folder| files::write_text(&folder.join("sparse/0")));
    let binary = views(&|folder| files::write_binary(&folder.join("sparse/0")));
    assert_eq!(text, binary);
    assert_eq!(text.len(), 3);
}

/// As transforms.json it has the same cameras, up to the inversion of their matrices.
#[test]
fn f099_transforms() {
    let text = views(&|folder| files::write_text(&folder.join("sparse/0")));
    let json = views(&|folder| {
        let text = files::transforms().to_string();
        fs::write(folder.join("transforms.json"), text).unwrap();
    });
    assert_eq!(text.len(), json.len());
    for ((name, camera), (other, theirs)) in text.iter().zip(&json) {
        assert_eq!(
            (name, camera.focal, camera.center),
            (other, theirs.focal, theirs.center)
        );
        assert!((camera.position - theirs.position).length() < 1e-9);
        assert!((camera.rotation * theirs.rotation.transpose()).abs_diff_eq(DMat3::IDENTITY, 1e-9));
    }
}

/// The data set of `transforms.json` in `folder`, translated by `offset` in double precision.
fn moved(folder: &Path, offset: DVec3) -> Dataset {
    files::write_photos(&folder.join("images"));
    let mut file = files::transforms();
    for frame in file["frames"].as_array_mut().unwrap() {
        for (row, by) in offset.to_array().into_iter().enumerate() {
            let place = &mut frame["transform_matrix"][row][3];
            *place = (place.as_f64().unwrap() + by).into();
        }
    }
    file["ply_file_path"] = "points.ply".into();
    fs::write(folder.join("transforms.json"), file.to_string()).unwrap();
    let rows: String = files::points()
        .iter()
        .map(|(_, point)| DVec3::from(point.position) + offset)
        .map(|p| format!("{} {} {}\n", p.x, p.y, p.z))
        .collect();
    let header = "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\n\
                  property double z\nend_header\n";
    fs::write(folder.join("points.ply"), header.to_owned() + &rows).unwrap();
    dataset::open(folder, &OpenOptions::default()).unwrap()
}

/// Geodetic coordinates, as in drone surveys: positions are relative to an origin near the cameras, which the scene
/// stores, without loss for cameras or points. Tolerance: two roundings in double precision at that distance, 2 · 2⁻⁵³
/// · 2²³ < 2e-9.
#[test]
fn f019_positions_are_counted_from_near_the_cameras() {
    let folder = tempfile::tempdir().unwrap();
    let near = moved(folder.path(), DVec3::ZERO);
    assert_eq!(near.origin, DVec3::ZERO);
    let offset = DVec3::new(6.0e5, 5.1e6, 120.0);
    let mut far = moved(folder.path(), offset);
    assert!(far.warnings.iter().any(|w| w.contains("far from the origin")));
    let same = |a: DVec3, b: DVec3| (a - b).length() < 2e-9;
    for (a, b) in far.views.iter().zip(&near.views) {
        assert!(a.camera.position.length() < 10.0);
        assert!(same(a.camera.position + far.origin, b.camera.position + offset));
    }
    for (a, b) in far.points.iter().zip(&near.points) {
        assert!(same(
            DVec3::from(a.position) + far.origin,
            DVec3::from(b.position) + offset
        ));
    }
    // A trained scene and its file store the origin.
    let splats = train(&lab(), &far, &TrainConfig::for_iterations(3));
    assert_eq!(splats.origin, far.origin);
    assert!(splats.mean.iter().flatten().all(|x| x.abs() < 10.0));
    let path = folder.path().join("scene.ply");
    splats::write(&path, &splats).unwrap();
    assert!(splats::read(&path).unwrap().splats == splats);
    // A scene of another program has the coordinates of the files.
    far.set_origin(DVec3::ZERO);
    assert!(same(
        far.views[0].camera.position,
        near.views[0].camera.position + offset
    ));
    let text = fs::read(&path).unwrap();
    let text = text.strip_prefix(b"ply\n").unwrap();
    fs::write(&path, [b"ply\ncomment SplatOrigin: 1 2 nan\n", text].concat()).unwrap();
    let error = splats::read(&path).unwrap_err().to_string();
    assert!(error.contains("scene.ply") && error.contains("1 2 nan"), "{error}");
}

/// A declared size beyond any photograph is refused before decoding.
#[test]
fn f100_images() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bomb.png");
    // A PNG's signature and its header: 65,535 × 65,535 pixels of RGB.
    let mut bytes = vec![0x89, b'P', b'N', b'G', 13, 10, 26, 10, 0, 0, 0, 13];
    let mut header = b"IHDR".to_vec();
    header.extend([0, 0, 0xff, 0xff, 0, 0, 0xff, 0xff, 8, 2, 0, 0, 0]);
    bytes.extend(&header);
    bytes.extend(crc32(&header).to_be_bytes());
    fs::write(&path, &bytes).unwrap();
    let error = photo::decode(path.as_path()).unwrap_err().to_string();
    assert!(error.contains("bomb.png") && error.contains("65535"), "{error}");
    fs::write(&path, []).unwrap();
    assert!(photo::decode(path.as_path()).is_err(), "an empty file is a picture");
}

/// CRC-32 of a PNG chunk.
fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32, &byte: &u8| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| {
            (crc >> 1) ^ if crc & 1 == 1 { 0xedb8_8320 } else { 0 }
        })
    };
    !bytes.iter().fold(u32::MAX, step)
}

/// Narrower bindings hold fewer splats each, and all splats together.
#[test]
fn f104_reach_of_a_binding() {
    let lab: Lab = lab();
    for reach in [1u64 << 20, 1 << 24, 1 << 27] {
        let mut caps = lab.gpu().caps().clone();
        caps.max_storage_range = reach;
        for degree in 0..=3 {
            let (room, planes) = (700_001, plane_count(degree));
            let blocks = Blocks::new(&caps, of_degree(room, degree), Precision::Full);
            let mut next = 0;
            for block in blocks.of(blocks.room) {
                assert_eq!(block.first, next);
                next = block.slots().end;
                assert!(block.stride * planes * 16 <= reach as usize && block.count <= block.stride);
            }
            assert_eq!(next, room, "splats without a block");
        }
    }
}

/// Shader indices fit in 32 bits: blocks end before, at any splat count.
#[test]
fn f105_indices_of_32_bits() {
    let mut caps = lab().gpu().caps().clone();
    (caps.max_storage_range, caps.max_allocation) = (u64::MAX, u64::MAX);
    for degree in 0..=3 {
        let blocks = Blocks::new(&caps, of_degree(400_000_000, degree), Precision::Full);
        for block in blocks.of(blocks.room) {
            let elements = block.stride as u64 * plane_count(degree) as u64;
            assert!(elements <= u64::from(u32::MAX), "{elements} elements of a block");
        }
    }
}
