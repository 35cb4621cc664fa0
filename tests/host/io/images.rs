//! Written images: PNG rounds to 8 bits, EXR keeps every bit.

use crate::io::files_in;
use ashfall::io::{exr, photo, png};
use ashfall::scene::Photo;

#[test]
fn bytes_are_rounded_and_clamped() {
    for byte in 0..=255u8 {
        let value = f32::from(byte) / 255.0;
        assert_eq!(png::to_byte(value), byte);
        assert_eq!(png::to_byte(value + 0.49 / 255.0), byte);
        assert_eq!(png::to_byte(value - 0.49 / 255.0), byte);
    }
    let odd = [-1.0, 2.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
    assert_eq!(odd.map(png::to_byte), [0, 255, 0, 255, 0]);
}

#[test]
fn png_files_are_read_as_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let color = |i: u8| [i, 100 + i, 255 - i];
    let pixels: Vec<[f32; 3]> = (0..6).map(|i| color(i).map(|c| f32::from(c) / 255.0)).collect();
    png::write_rgb(&path, 3, 2, &pixels).unwrap();
    let photo = photo::decode(&path).unwrap();
    assert_eq!((photo.width, photo.height), (3, 2));
    for (i, pixel) in photo.rgba.iter().enumerate() {
        let [r, g, b] = color(i as u8);
        assert_eq!(*pixel, [r, g, b, 255]);
    }
    let transparent = Photo {
        width: 2,
        height: 2,
        rgba: vec![[1, 2, 3, 4], [5, 6, 7, 0], [0, 0, 0, 255], [255, 255, 255, 128]],
    };
    png::write_photo(&path, &transparent).unwrap();
    assert_eq!(photo::decode(&path).unwrap(), transparent);
    let floats: Vec<[f32; 4]> = transparent
        .rgba
        .iter()
        .map(|p| p.map(|c| f32::from(c) / 255.0))
        .collect();
    png::write_rgba(&path, 2, 2, &floats).unwrap();
    assert_eq!(photo::decode(&path).unwrap(), transparent);
    assert_eq!(files_in(folder.path()), ["a.png"]);
}

#[test]
fn exr_files_keep_every_bit() {
    use ::exr::prelude::*;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let odd = [f32::MAX, -0.0, 1e-40, f32::INFINITY, 0.1, 2.5];
    let rgba: Vec<[f32; 4]> = (0..6).map(|i| [odd[i], i as f32, -1.5, 0.25]).collect();
    let depth: Vec<f32> = (0..6).map(|i| 10.0 + odd[5 - i]).collect();
    let normal: Vec<[f32; 3]> = (0..6).map(|i| [odd[i], f32::NAN, -(i as f32)]).collect();
    exr::write(&path, 3, 2, &rgba, &depth, Some(&normal)).unwrap();
    let image = read_first_flat_layer_from_file(&path).unwrap();
    assert_eq!(image.layer_data.size, Vec2(3, 2));
    let channel = |name: &str| -> Vec<u32> {
        let list = &image.layer_data.channel_data.list;
        let found = list.iter().find(|c| c.name.eq(name)).unwrap();
        match &found.sample_data {
            FlatSamples::F32(values) => values.iter().map(|v| v.to_bits()).collect(),
            other => panic!("{name} is not stored as f32: {other:?}"),
        }
    };
    for (i, name) in ["R", "G", "B", "A"].into_iter().enumerate() {
        let expected: Vec<u32> = rgba.iter().map(|p| p[i].to_bits()).collect();
        assert_eq!(channel(name), expected, "{name}");
    }
    let expected: Vec<u32> = depth.iter().map(|v| v.to_bits()).collect();
    assert_eq!(channel("Z"), expected);
    for (i, name) in ["N.X", "N.Y", "N.Z"].into_iter().enumerate() {
        let expected: Vec<u32> = normal.iter().map(|n| n[i].to_bits()).collect();
        assert_eq!(channel(name), expected, "{name}");
    }
    assert_eq!(files_in(folder.path()), ["a.exr"]);
}
