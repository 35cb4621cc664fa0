//! Section 10 of the catalogue, and the bindings of 10b: one small test of each entry. What bytes may do to the loaders
//! is the business of tests/io, tests/broken and tests/fuzz.
//!
//! * 101: EXR files are written, never read: no reader of ours can be led astray by one.

use crate::file_scenes;
use crate::lab::{Lab, lab};
use crate::scenes;
use ashfall::io::dataset::{self, OpenOptions};
use ashfall::io::{photo, splats};
use ashfall::render::{Blocks, plane_count};
use ashfall::scene::{Camera, View};
use glam::DMat3;
use std::fs;
use std::path::Path;

/// What is written is read, bit for bit; a file that ends anywhere is an error that names it; a splat that is none goes
/// alone.
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

/// Names and cameras of the views of a data set that `write` makes.
fn views(write: &dyn Fn(&Path)) -> Vec<(String, Camera)> {
    let folder = tempfile::tempdir().unwrap();
    file_scenes::write_photos(&folder.path().join("images"));
    write(folder.path());
    let dataset = dataset::open(folder.path(), &OpenOptions::default()).unwrap();
    let view = |v: &View| (v.name.rsplit('/').next().unwrap().to_owned(), v.camera);
    dataset.views.iter().map(view).collect()
}

/// The same reconstruction as text and as binary is the same data set; ids have gaps, and names have spaces.
#[test]
fn f098_colmap() {
    let text = views(&|folder| file_scenes::write_text(&folder.join("sparse/0")));
    let binary = views(&|folder| file_scenes::write_binary(&folder.join("sparse/0")));
    assert_eq!(text, binary);
    assert_eq!(text.len(), 3);
}

/// And as transforms.json it has the same cameras, up to the inversion of their matrices.
#[test]
fn f099_transforms() {
    let text = views(&|folder| file_scenes::write_text(&folder.join("sparse/0")));
    let json = views(&|folder| {
        let text = file_scenes::transforms().to_string();
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

/// What claims to be larger than any photograph is refused before anything is decoded.
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
    assert!(
        error.contains("bomb.png") && error.contains("65535"),
        "{error}"
    );
    fs::write(&path, []).unwrap();
    assert!(
        photo::decode(path.as_path()).is_err(),
        "an empty file is a picture"
    );
}

/// The check sum of a PNG's chunk.
fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32, &byte: &u8| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| {
            (crc >> 1) ^ if crc & 1 == 1 { 0xedb8_8320 } else { 0 }
        })
    };
    !bytes.iter().fold(u32::MAX, step)
}

/// Bindings that reach less far hold fewer splats each, and all of them together hold all.
#[test]
fn f104_reach_of_a_binding() {
    let lab: Lab = lab();
    for reach in [1u64 << 20, 1 << 24, 1 << 27] {
        let mut caps = lab.gpu().caps().clone();
        caps.max_storage_range = reach;
        for degree in 0..=3 {
            let (room, planes) = (700_001, plane_count(degree));
            let blocks = Blocks::new(&caps, room, degree);
            let mut next = 0;
            for block in blocks.of(room) {
                assert_eq!(block.first, next);
                next = block.splats().end;
                assert!(
                    block.stride * planes * 16 <= reach as usize && block.count <= block.stride
                );
            }
            assert_eq!(next, room, "splats without a block");
        }
    }
}

/// No index of a shader exceeds 32 bits: blocks end before, however many splats there are.
#[test]
fn f105_indices_of_32_bits() {
    let mut caps = lab().gpu().caps().clone();
    (caps.max_storage_range, caps.max_allocation) = (u64::MAX, u64::MAX);
    for degree in 0..=3 {
        let blocks = Blocks::new(&caps, 400_000_000, degree);
        for block in blocks.of(400_000_000) {
            let elements = block.stride as u64 * plane_count(degree) as u64;
            assert!(
                elements <= u64::from(u32::MAX),
                "{elements} elements of a block"
            );
        }
    }
}
