//! Further captures with one fault each: files of other kinds, pictures that announce more than they hold, tags, masks,
//! lenses, transforms.json, and folders given to `ashfall capture`.

use crate::captures::Expect::{Clean, Fails, Warns};
use crate::captures::{
    Expect, Fault, SIZE, all_jpeg, box_of, cameras, check, encoded, exif, jpeg, masks, replace, segment, sound,
};
use ashfall::lab::synth;
use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

/// A PNG that announces a size and has no pixels.
fn png(width: u32, height: u32) -> Vec<u8> {
    let mut picture = encoded(image::ImageFormat::Png);
    picture[16..20].copy_from_slice(&width.to_be_bytes());
    picture[20..24].copy_from_slice(&height.to_be_bytes());
    picture
}

/// A JPEG with another size in its header.
fn jpeg_of(side: u16) -> Vec<u8> {
    let mut bytes = jpeg(1, false, &[]);
    let place = bytes.windows(2).position(|pair| pair == [0xff, 0xc0]).unwrap();
    bytes[place + 5..place + 7].copy_from_slice(&side.to_be_bytes());
    bytes[place + 7..place + 9].copy_from_slice(&side.to_be_bytes());
    bytes
}

/// A TIFF of one strip that announces a size and has no pixels.
fn tiff(side: u32) -> Vec<u8> {
    let mut bytes = [&b"II*\0"[..], &8u32.to_le_bytes(), &9u16.to_le_bytes()].concat();
    let strip = 12 * side;
    for (tag, value) in [
        (256u16, side),
        (257, side),
        (258, 8),
        (259, 1),
        (262, 1),
        (273, 130),
        (277, 1),
        (278, side),
        (279, strip),
    ] {
        bytes.extend(tag.to_le_bytes());
        bytes.extend(4u16.to_le_bytes());
        bytes.extend(1u32.to_le_bytes());
        bytes.extend(value.to_le_bytes());
    }
    bytes.extend([0; 32]);
    bytes
}

/// A WebP whose header announces the largest canvas.
fn webp() -> Vec<u8> {
    [&b"RIFF\x16\0\0\0WEBPVP8X\x0a\0\0\0\0\0\0\0"[..], &[0xff; 6]].concat()
}

fn deep(format: image::ImageFormat) -> Vec<u8> {
    let picture = image::load_from_memory(&encoded(image::ImageFormat::Png))
        .unwrap()
        .to_rgb16();
    let mut bytes = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

fn white(_: u32, _: u32) -> u8 {
    255
}

fn black(_: u32, _: u32) -> u8 {
    0
}

/// White masks, the first of them another file.
fn first_mask(folder: &Path, bytes: &[u8]) {
    masks(folder, 0..10, SIZE, white);
    fs::write(folder.join("masks/0000.png.png"), bytes).unwrap();
}

const OTHER: &[&str] = &["0001.png", "neither a PNG nor a JPEG, WebP or TIFF image"];

#[rustfmt::skip]
const PHOTOS: &[(&str, Expect, Fault)] = &[
    ("photo_gif", Fails(OTHER), |f| replace(f, 1, b"GIF89a\x60\0\x48\0\0\0\0;")),
    ("photo_bmp", Fails(OTHER), |f| replace(f, 1, b"BM\x36\0\0\0\0\0\0\0\x36\0\0\0\x28\0\0\0")),
    ("photo_psd", Fails(OTHER), |f| replace(f, 1, b"8BPS\0\x01\0\0\0\0\0\0\0\x03")),
    ("photo_jpeg_xl", Fails(OTHER), |f| replace(f, 1, b"\0\0\0\x0cJXL \x0d\x0a\x87\x0a")),
    ("photo_web_page", Fails(OTHER), |f| replace(f, 1, b"<!DOCTYPE html><title>404</title>")),
    ("photo_zeros", Fails(OTHER), |f| replace(f, 1, &[0; 4096])),
    ("photo_png_announces_much", Fails(&["0001.png", "announces 16000 x 12000"]),
        |f| replace(f, 1, &png(16_000, 12_000))),
    ("photo_png_announces_too_much", Fails(&["0001.png", "4294967295"]), |f| replace(f, 1, &png(u32::MAX, u32::MAX))),
    ("photo_jpeg_announces_much", Fails(&["0001.png", "announces 16000 x 16000"]), |f| replace(f, 1, &jpeg_of(16_000))),
    ("photo_jpeg_of_no_size", Fails(&["0001.png", "0 x 0"]), |f| replace(f, 1, &jpeg_of(0))),
    ("photo_tiff_announces_much", Fails(&["0001.png", "announces 16000 x 16000"]), |f| replace(f, 1, &tiff(16_000))),
    ("photo_tiff_without_pixels", Fails(&["0001.png", "96 x 96", "aspect ratio"]), |f| replace(f, 1, &tiff(96))),
    ("photo_webp_announces_much", Fails(&["0001.png", "cannot be decoded"]), |f| replace(f, 1, &webp())),
    ("photo_png_16_bit", Clean, |f| replace(f, 1, &deep(image::ImageFormat::Png))),
    ("photo_tiff_16_bit", Clean, |f| replace(f, 1, &deep(image::ImageFormat::Tiff))),
    ("photo_is_a_folder", Warns(&["1 of 10 photographs are missing", "0001.png"]), |f| {
        fs::remove_file(f.join("images/0001.png")).unwrap();
        fs::create_dir(f.join("images/0001.png")).unwrap();
    }),
    ("photos_turned_twice_by_exif", Warns(&["turned by 180 degrees"]), |f| all_jpeg(f, true, &[exif(8)])),
    ("photos_turned_in_part", Warns(&["5 of 10 photographs are turned", "EXIF"]), |f| {
        (0..5).for_each(|view| replace(f, view, &jpeg(view, true, &[exif(6)])));
    }),
    ("photos_exif_of_no_orientation", Clean, |f| all_jpeg(f, false, &[exif(9)])),
    ("photos_exif_upside_down_by_tag_alone", Clean, |f| all_jpeg(f, false, &[exif(3)])),
    ("photos_exif_cut_short", Clean, |f| all_jpeg(f, false, &[segment(0xe1, b"Exif\0\0II")])),
    ("photos_in_adobe_rgb", Warns(&["Adobe RGB", "as if they were sRGB"]), |f| {
        let profile = [&b"ICC_PROFILE\0\x01\x01"[..], &[0; 40], b"Adobe RGB (1998)"].concat();
        all_jpeg(f, false, &[segment(0xe2, &profile)]);
    }),
    ("photos_in_a_strange_profile", Warns(&["profile unknown", "as if they were sRGB"]), |f| {
        all_jpeg(f, false, &[segment(0xe2, &[&b"ICC_PROFILE\0\x01\x01"[..], &[7; 40]].concat())]);
    }),
    ("photos_of_a_larger_camera", Warns(&["10 of 10 photographs have another size", "scaled"]), |f| {
        let focal = 100.0 * sound().views[0].camera.focal.x;
        cameras(f, &format!("1 9600 7200 {focal} {focal} 4800 3600"));
    }),
    ("photos_of_a_wider_camera", Fails(&[".png", "96 x 72", "aspect ratio", "9600 x 5400"]),
        |f| cameras(f, "1 9600 5400 9000 9000 4800 2700")),
    ("camera_larger_than_any", Fails(&["cameras.bin", "4000000 x 3000000"]),
        |f| cameras(f, "1 4000000 3000000 90 90 48 36")),
];

#[rustfmt::skip]
const MASKS_AND_LENSES: &[(&str, Expect, Fault)] = &[
    ("masks_white", Clean, |f| masks(f, 0..10, SIZE, white)),
    ("masks_black", Warns(&["100 %", "--masks inverted"]), |f| masks(f, 0..10, SIZE, black)),
    ("masks_grey", Warns(&["100 %", "--masks inverted"]), |f| masks(f, 0..10, SIZE, |_, _| 127)),
    ("masks_folder_is_empty", Warns(&["no mask of any photograph"]), |f| fs::create_dir(f.join("masks")).unwrap()),
    ("mask_heic", Fails(&["0000.png.png", "HEIC", "heif-convert"]), |f| first_mask(f, &box_of(b"heic"))),
    ("mask_announces_much", Fails(&["0000.png.png", "announces 16000 x 12000"]),
        |f| first_mask(f, &png(16_000, 12_000))),
    ("mask_of_one_pixel", Fails(&["0000.png.png", "1 x 1 pixels"]), |f| masks(f, 0..10, [1, 1], white)),
    ("mask_16_bit", Clean, |f| {
        masks(f, 0..10, SIZE, white);
        let mask = image::ImageBuffer::from_pixel(SIZE[0], SIZE[1], image::Luma([u16::MAX]));
        mask.save(f.join("masks/0000.png.png")).unwrap();
    }),
    ("lens_fov_nan", Fails(&["cameras.bin", "FOV", "not finite"]), |f| cameras(f, "7 96 72 90 90 48 36 nan")),
    ("lens_fisheye_zero_focal", Fails(&["cameras.bin", "focal", "not positive"]), |f| cameras(f, "8 96 72 0 48 36 0")),
    ("lens_thin_prism_nan", Fails(&["cameras.bin", "THIN_PRISM_FISHEYE", "not finite"]),
        |f| cameras(f, "10 96 72 90 90 48 36 0 0 0 0 0 0 0 nan")),
    ("lens_rad_tan_infinite", Fails(&["cameras.bin", "RAD_TAN_THIN_PRISM_FISHEYE", "not finite"]),
        |f| cameras(f, "11 96 72 90 90 48 36 0 0 0 0 0 0 0 0 0 0 0 inf")),
    ("lens_division_nan", Fails(&["cameras.bin", "SIMPLE_DIVISION", "not finite"]),
        |f| cameras(f, "12 96 72 90 48 36 nan")),
    ("lens_fisheye_center_nan", Fails(&["cameras.bin", "principal point"]), |f| cameras(f, "15 96 72 90 90 nan 36")),
    ("lens_parameters_missing", Fails(&["cameras.bin"]), |f| cameras(f, "11 96 72 90 90 48 36")),
    ("lens_huge_coefficient", Fails(&[".png", "shows nothing"]), |f| cameras(f, "5 96 72 90 90 48 36 -1e30 0 0 0")),
    ("lens_panorama_of_no_size", Fails(&["cameras.bin", "0 x 0"]), |f| cameras(f, "17 0 0 0 0")),
    ("model_with_damaged_rigs_and_frames", Warns(&["rigs.bin", "poses are those of the images"]), |f| {
        for name in ["rigs.bin", "frames.bin"] {
            fs::write(f.join("sparse/0").join(name), [1, 0, 0, 0, 0, 0, 0, 0, 1, 2, 3]).unwrap();
        }
    }),
];

/// Data set in nerfstudio's form with values in place of others, in the root or in the second frame.
fn transforms(folder: &Path, in_root: &[(&str, Value)], in_frame: &[(&str, Value)]) {
    fs::remove_dir_all(folder).unwrap();
    synth::save(sound(), folder).unwrap();
    let path = folder.join("transforms.json");
    let mut tree: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    for (name, value) in in_root {
        tree[name] = value.clone();
        for frame in tree["frames"].as_array_mut().unwrap() {
            frame.as_object_mut().unwrap().remove(*name);
        }
    }
    for (name, value) in in_frame {
        tree["frames"][1][name] = value.clone();
    }
    fs::write(path, tree.to_string()).unwrap();
}

#[rustfmt::skip]
const TRANSFORMS: &[(&str, Expect, Fault)] = &[
    ("transforms_sound", Clean, |f| transforms(f, &[], &[])),
    ("transforms_vr", Fails(&["transforms.json", "VR180_L", "not supported"]),
        |f| transforms(f, &[("camera_model", json!("VR180_L"))], &[])),
    ("transforms_model_is_a_number", Fails(&["transforms.json", "camera_model", "text"]),
        |f| transforms(f, &[("camera_model", json!(5))], &[])),
    ("transforms_fisheye_text", Fails(&["transforms.json", "k1"]),
        |f| transforms(f, &[("camera_model", json!("OPENCV_FISHEYE")), ("k1", json!("small"))], &[])),
    ("transforms_fisheye_of_a_frame", Fails(&["transforms.json", "frame 1", "focal"]),
        |f| transforms(f, &[("camera_model", json!("OPENCV_FISHEYE"))], &[("fl_x", json!(-3))])),
    ("transforms_rational_without_a_model", Fails(&["transforms.json", "k5", "FULL_OPENCV"]),
        |f| transforms(f, &[], &[("k5", json!(0.1))])),
    ("transforms_fisheye_folded", Fails(&[".png", "shows nothing"]),
        |f| transforms(f, &[("camera_model", json!("OPENCV_FISHEYE")), ("k1", json!(-1e30))], &[])),
    ("transforms_size_is_a_fraction", Fails(&["transforms.json", "frame 1"]),
        |f| transforms(f, &[], &[("w", json!(96.5))])),
    ("transforms_size_is_huge", Fails(&["transforms.json", "frame 1"]), |f| transforms(f, &[], &[("w", json!(4e6))])),
    ("transforms_mask_is_no_picture", Fails(&["images/0001.txt", "neither a PNG"]), |f| {
        transforms(f, &[], &[("mask_path", json!("images/0001.txt"))]);
        fs::write(f.join("images/0001.txt"), "white").unwrap();
    }),
    ("transforms_center_is_a_list", Fails(&["transforms.json", "frame 1", "cx"]),
        |f| transforms(f, &[], &[("cx", json!([48]))])),
];

#[test]
fn photographs() {
    check(PHOTOS);
}

#[test]
fn masks_and_lenses() {
    check(MASKS_AND_LENSES);
}

#[test]
fn frames() {
    check(TRANSFORMS);
}

/// Prepares photographs and an output folder.
type Setting = fn(photos: &Path, out: &Path);

#[rustfmt::skip]
const CAPTURES: &[(&str, &[&str], Setting)] = &[
    ("two_photographs", &["photos", "has 2 photographs", "3 are needed"],
        |p, _| fs::remove_file(p.join("2.png")).unwrap()),
    ("heic", &["1.heic", "HEIC", "heif-convert"], |p, _| fs::write(p.join("1.heic"), box_of(b"heic")).unwrap()),
    ("raw", &["1.dng", "raw image", "dcraw"], |p, _| fs::write(p.join("1.dng"), tiff(96)).unwrap()),
    ("empty", &["1.png", "empty"], |p, _| fs::write(p.join("1.png"), "").unwrap()),
    ("announces_much", &["1.png", "announces 16000 x 12000"],
        |p, _| fs::write(p.join("1.png"), png(16_000, 12_000)).unwrap()),
    ("out_is_a_file", &["out"], |_, o| fs::write(o, "").unwrap()),
    ("state_is_damaged", &["capture.json", "cannot be read"], |_, o| {
        fs::create_dir(o).unwrap();
        fs::write(o.join("capture.json"), "{").unwrap();
    }),
];

/// Every file in a folder, or the file itself, with its bytes.
fn contents(path: &Path) -> Vec<(String, Vec<u8>)> {
    let Ok(entries) = fs::read_dir(path) else {
        return fs::read(path).map(|bytes| (String::new(), bytes)).into_iter().collect();
    };
    let file = |path: &Path| (path.display().to_string(), fs::read(path).unwrap());
    entries.map(|entry| file(&entry.unwrap().path())).collect()
}

#[cfg(unix)]
#[test]
fn folders_to_capture() {
    use std::os::unix::fs::PermissionsExt;
    let mut faults = Vec::new();
    for (name, words, setting) in CAPTURES {
        let folder = tempfile::tempdir().unwrap();
        let [photos, tools, out] = ["photos", "tools", "out"].map(|part| folder.path().join(part));
        fs::create_dir(&photos).unwrap();
        for index in 0..3 {
            fs::write(photos.join(format!("{index}.png")), encoded(image::ImageFormat::Png)).unwrap();
        }
        fs::create_dir(&tools).unwrap();
        fs::write(tools.join("colmap"), "#!/bin/sh\necho 'COLMAP 3.8 -- stand-in'\n").unwrap();
        fs::set_permissions(tools.join("colmap"), fs::Permissions::from_mode(0o755)).unwrap();
        setting(&photos, &out);
        let before = contents(&out);
        let mut command = Command::new(env!("CARGO_BIN_EXE_ashfall"));
        command.env("PATH", &tools).stdin(Stdio::null()).arg("capture");
        let output = command.arg(&photos).arg("--out").arg(&out).output().unwrap();
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        let is_named = text.starts_with("error: ") && text.lines().count() == 1;
        let is_named = is_named && words.iter().all(|word| text.contains(word));
        if output.status.code() != Some(1) || !is_named || contents(&out) != before {
            faults.push(format!("{name}: {:?}, {text}", output.status.code()));
        }
    }
    assert!(faults.is_empty(), "{} faults:\n{}", faults.len(), faults.join("\n"));
}
