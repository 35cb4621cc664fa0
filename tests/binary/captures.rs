//! Captures with one fault each, generated: every one is refused or warned about in one line, and a refused one leaves
//! nothing behind.

use ashfall::io::dataset::{self, MaskUse, OpenOptions};
use ashfall::lab::synth::{self, Kind, SynthOptions};
use ashfall::scene::{AlphaMode, Dataset, Photo, PhotoSource};
use ashfall::train::{TrainConfig, Trainer};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Required outcome of a case.
pub(crate) enum Expect {
    /// Loads without a warning.
    Clean,
    /// Loads; one line of warning contains these words.
    Warns(&'static [&'static str]),
    /// One line of error that contains these words.
    Fails(&'static [&'static str]),
}
use Expect::{Clean, Fails, Warns};

/// Makes the fault in a sound data set in a folder.
pub(crate) type Fault = fn(&Path);

pub(crate) const SIZE: [u32; 2] = [96, 72];

fn options() -> SynthOptions {
    SynthOptions {
        views: 10,
        width: SIZE[0],
        height: SIZE[1],
        samples: 1,
        points: 900,
        tracks: true,
        ..SynthOptions::default()
    }
}

/// The sound data set, made once: photographs in `images/images`.
pub(crate) fn sound() -> &'static Dataset {
    static MADE: std::sync::OnceLock<Dataset> = std::sync::OnceLock::new();
    MADE.get_or_init(|| synth::scene(Kind::Demo).dataset(&options()))
}

pub(crate) fn save(dataset: &Dataset, folder: &Path) {
    synth::save_colmap(dataset, &options(), folder).unwrap();
}

pub(crate) fn photo_path(folder: &Path, view: usize) -> PathBuf {
    folder.join(format!("images/{view:04}.png"))
}

fn memory(dataset: &Dataset, view: usize) -> &Photo {
    match &dataset.views[view].photo {
        PhotoSource::Memory(photo) => photo,
        _ => unreachable!("made photographs are in memory"),
    }
}

/// Replaces every photograph by pixels of it: `source` gives column and row, from 0 to the last.
fn remap(folder: &Path, source: fn(usize, usize) -> (usize, usize)) {
    let mut dataset = sound().clone();
    for view in 0..dataset.views.len() {
        let mut photo = memory(&dataset, view).clone();
        let width = photo.width as usize;
        let old = photo.rgba.clone();
        for (place, pixel) in photo.rgba.iter_mut().enumerate() {
            let (column, row) = source(place % width, place / width);
            *pixel = old[row * width + column];
        }
        dataset.views[view].photo = PhotoSource::Memory(photo);
    }
    save(&dataset, folder);
}

/// Writes a mask for some views, grey levels by place.
pub(crate) fn masks(folder: &Path, views: std::ops::Range<usize>, size: [u32; 2], level: fn(u32, u32) -> u8) {
    let masks = folder.join("masks");
    fs::create_dir_all(&masks).unwrap();
    for view in views {
        let mask = image::GrayImage::from_fn(size[0], size[1], |x, y| image::Luma([level(x, y)]));
        mask.save(masks.join(format!("{view:04}.png.png"))).unwrap();
    }
}

fn left_white(x: u32, _: u32) -> u8 {
    if x < 70 { 255 } else { 0 }
}

/// Gives the photograph's name in the model to other bytes.
pub(crate) fn replace(folder: &Path, view: usize, bytes: &[u8]) {
    fs::write(photo_path(folder, view), bytes).unwrap();
}

/// Writes `cameras.txt` and the rest as text, with a line for every camera.
pub(crate) fn cameras(folder: &Path, line: &str) {
    let model = folder.join("sparse/0");
    let mut bytes = (sound().views.len() as u64).to_le_bytes().to_vec();
    let words: Vec<&str> = line.split(' ').collect();
    let id: i32 = words[0].parse().unwrap();
    for camera in 1..=sound().views.len() as u32 {
        bytes.extend(camera.to_le_bytes());
        bytes.extend(id.to_le_bytes());
        for word in &words[1..3] {
            bytes.extend(word.parse::<u64>().unwrap().to_le_bytes());
        }
        for word in &words[3..] {
            bytes.extend(word.parse::<f64>().unwrap().to_le_bytes());
        }
    }
    fs::write(model.join("cameras.bin"), bytes).unwrap();
}

/// A JPEG of a view with further segments behind its first marker.
pub(crate) fn jpeg(view: usize, turned: bool, segments: &[Vec<u8>]) -> Vec<u8> {
    let photo = memory(sound(), view);
    let rgb: Vec<u8> = photo.rgba.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect();
    let mut picture = image::RgbImage::from_raw(photo.width, photo.height, rgb).unwrap();
    if turned {
        // Stored pixels that a viewer turns to the right (orientation 6) to see the scene upright.
        picture = image::imageops::rotate270(&picture);
    }
    let mut bytes = Vec::new();
    let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 95);
    picture.write_with_encoder(encoder).unwrap();
    let rest = bytes.split_off(2);
    bytes.extend(segments.concat());
    bytes.extend(rest);
    bytes
}

pub(crate) fn segment(marker: u8, content: &[u8]) -> Vec<u8> {
    let length = (content.len() as u16 + 2).to_be_bytes();
    [&[0xff, marker], &length[..], content].concat()
}

/// EXIF data with an orientation.
pub(crate) fn exif(orientation: u8) -> Vec<u8> {
    let entry = [0x12, 0x01, 3, 0, 1, 0, 0, 0, orientation, 0, 0, 0];
    let head = [b'I', b'I', 42, 0, 8, 0, 0, 0, 1, 0];
    segment(0xe1, &[b"Exif\0\0", &head[..], &entry[..], &[0; 4]].concat())
}

pub(crate) fn all_jpeg(folder: &Path, turned: bool, segments: &[Vec<u8>]) {
    for view in 0..sound().views.len() {
        replace(folder, view, &jpeg(view, turned, segments));
    }
}

/// Bytes of a photograph in another format.
pub(crate) fn encoded(format: image::ImageFormat) -> Vec<u8> {
    let photo = memory(sound(), 1);
    let rgb: Vec<u8> = photo.rgba.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect();
    let picture = image::RgbImage::from_raw(photo.width, photo.height, rgb).unwrap();
    let mut bytes = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

pub(crate) fn box_of(brand: &[u8; 4]) -> Vec<u8> {
    [&[0, 0, 0, 24], &b"ftyp"[..], brand, &[0; 40]].concat()
}

/// Moves the cameras' rotations by signs of their axes.
fn signs(folder: &Path, signs: [f64; 3]) {
    let mut dataset = sound().clone();
    for view in &mut dataset.views {
        view.camera.rotation = glam::DMat3::from_diagonal(signs.into()) * view.camera.rotation;
    }
    save(&dataset, folder);
    for view in 0..dataset.views.len() {
        assert!(photo_path(folder, view).is_file());
    }
}

#[rustfmt::skip]
const CASES: &[(&str, Expect, Fault)] = &[
    ("sound", Clean, |_| ()),
    ("masks_sound", Clean, |f| masks(f, 0..10, SIZE, left_white)),
    ("masks_of_half_size", Clean, |f| masks(f, 0..10, [48, 36], |x, _| if x < 35 { 255 } else { 0 })),
    ("masks_of_another_size", Fails(&[".png.png", "mask of 50 x 72 pixels", "96 x 72"]),
        |f| masks(f, 0..10, [50, 72], left_white)),
    ("masks_for_some", Warns(&["3 of 10 photographs have masks"]), |f| masks(f, 0..3, SIZE, left_white)),
    ("masks_the_other_way_round", Warns(&["73 %", "--masks inverted"]),
        |f| masks(f, 0..10, SIZE, |x, _| if x < 70 { 0 } else { 255 })),
    ("masks_of_other_names", Warns(&["no mask of any photograph", "NAME.jpg.png"]), |f| {
        fs::create_dir(f.join("masks")).unwrap();
        image::GrayImage::new(4, 3).save(f.join("masks/a.png")).unwrap();
    }),
    ("mask_is_text", Fails(&["0000.png.png", "neither a PNG nor a JPEG"]), |f| {
        masks(f, 0..10, SIZE, left_white);
        fs::write(f.join("masks/0000.png.png"), "white").unwrap();
    }),
    ("mask_is_empty", Fails(&["0000.png.png", "empty"]), |f| {
        masks(f, 0..10, SIZE, left_white);
        fs::write(f.join("masks/0000.png.png"), "").unwrap();
    }),
    ("mask_is_cut_short", Fails(&["0001.png.png", "cannot be decoded"]), |f| {
        masks(f, 0..10, SIZE, left_white);
        let path = f.join("masks/0001.png.png");
        let bytes = fs::read(&path).unwrap();
        fs::write(path, &bytes[..bytes.len() / 2]).unwrap();
    }),
    ("photo_heic", Fails(&["0001.png", "HEIC", "heif-convert"]), |f| replace(f, 1, &box_of(b"heic"))),
    ("photo_mif1", Fails(&["0001.png", "HEIC", "heif-convert"]), |f| replace(f, 1, &box_of(b"mif1"))),
    ("photo_avif", Fails(&["0001.png", "AVIF", "heif-convert"]), |f| replace(f, 1, &box_of(b"avif"))),
    ("photo_cr3", Fails(&["0001.png", "raw image", "dcraw"]), |f| replace(f, 1, &box_of(b"crx "))),
    ("photo_raf", Fails(&["0001.png", "raw image", "dcraw"]), |f| replace(f, 1, b"FUJIFILMCCD-RAW 0201")),
    ("photo_tiff", Clean, |f| replace(f, 1, &encoded(image::ImageFormat::Tiff))),
    ("photo_webp", Clean, |f| replace(f, 1, &encoded(image::ImageFormat::WebP))),
    ("photo_tiff_cut_short", Fails(&["0001.png", "cannot be decoded"]), |f| {
        let bytes = encoded(image::ImageFormat::Tiff);
        replace(f, 1, &bytes[..bytes.len() / 2]);
    }),
    ("photo_tiff_magic_alone", Fails(&["0001.png", "cannot be decoded"]), |f| replace(f, 1, b"II*\0")),
    ("photo_webp_cut_short", Fails(&["0001.png", "cannot be decoded"]), |f| {
        let bytes = encoded(image::ImageFormat::WebP);
        replace(f, 1, &bytes[..bytes.len() / 2]);
    }),
    ("photo_webp_magic_alone", Fails(&["0001.png", "cannot be decoded"]), |f| replace(f, 1, b"RIFF\x04\0\0\0WEBP")),
    ("photos_turned_by_exif", Warns(&["10 of 10 photographs are turned", "EXIF"]), |f| all_jpeg(f, true, &[exif(6)])),
    ("photos_turned_without_exif", Fails(&[".png", "72 x 96", "aspect ratio", "96 x 72"]),
        |f| all_jpeg(f, true, &[])),
    ("photos_upright_with_exif", Clean, |f| all_jpeg(f, false, &[exif(6)])),
    ("photos_exif_damaged", Clean, |f| all_jpeg(f, false, &[segment(0xe1, b"Exif\0\0II*\0\xff\xff\xff\xff")])),
    ("photos_in_display_p3", Warns(&["Display P3", "as if they were sRGB"]), |f| {
        let profile = [&b"ICC_PROFILE\0\x01\x01"[..], &[0; 40], b"Display P3"].concat();
        all_jpeg(f, false, &[segment(0xe2, &profile)]);
    }),
    ("photos_upside_down", Warns(&["turned by 180 degrees"]), |f| remap(f, |x, y| (95 - x, 71 - y))),
    ("photos_mirrored", Warns(&["mirrored left to right"]), |f| remap(f, |x, y| (95 - x, y))),
    ("photos_mirrored_down", Warns(&["mirrored top to bottom"]), |f| remap(f, |x, y| (x, 71 - y))),
    ("photos_of_another_capture", Warns(&["do not show the points"]), |f| {
        remap(f, |x, y| ((x * 37 + y * 11) % 96, (y * 29 + x * 5) % 72));
    }),
    ("one_wrong_photo", Warns(&["0003.png does not show the points"]), |f| {
        let noise = image::RgbImage::from_fn(96, 72, |x, y| image::Rgb([(x * 37 % 97 * y % 251) as u8; 3]));
        noise.save(photo_path(f, 3)).unwrap();
    }),
    ("cameras_y_up", Warns(&["y up and z backward"]), |f| signs(f, [1.0, -1.0, -1.0])),
    ("lens_removed_already", Warns(&["undistorted already"]), |f| {
        let focal = sound().views[0].camera.focal.x;
        cameras(f, &format!("4 96 72 {focal} {focal} 48 36 -0.35 0 0 0"));
    }),
    ("lens_model_18", Fails(&["cameras.bin", "model id 18"]), |f| cameras(f, "18 96 72 90 48 36")),
    ("lens_fisheye_nan", Fails(&["cameras.bin", "OPENCV_FISHEYE", "not finite"]),
        |f| cameras(f, "5 96 72 90 90 48 36 nan 0 0 0")),
    ("lens_eucm_infinite", Fails(&["cameras.bin", "EUCM", "not finite"]), |f| cameras(f, "16 96 72 90 90 48 36 inf 1")),
    ("lens_fisheye_negative_focal", Fails(&["cameras.bin", "focal", "not positive"]),
        |f| cameras(f, "14 96 72 -90 48 36")),
    ("lens_sees_nothing", Fails(&[".png", "shows nothing"]),
        |f| cameras(f, "5 96 72 20 20 900 36 -0.5 0 0 0")),
    ("lens_panorama", Warns(&["10 wide photographs are seen as 60"]), |f| cameras(f, "17 96 72 96 72")),
    ("lens_full_opencv_with_a_zero_tail", Clean, |f| {
        let focal = sound().views[0].camera.focal.x;
        cameras(f, &format!("6 96 72 {focal} {focal} 48 36 0 0 0 0 0 0 0 0"));
    }),
];

/// Warnings of a data set, as `train` prints them, after everything that comes before the first write.
fn load(folder: &Path) -> ashfall::Result<Vec<String>> {
    let opened = dataset::open(folder, &OpenOptions::default())?;
    let mut warnings = opened.warnings.clone();
    warnings.extend(dataset::check_capture(&opened)?);
    for view in &opened.views {
        ashfall::io::photo::load(view)?;
    }
    Ok(warnings)
}

fn judge(expect: &Expect, outcome: &ashfall::Result<Vec<String>>) -> Result<(), String> {
    let holds = |text: &str, words: &[&str]| {
        let missing: Vec<_> = words.iter().filter(|word| !text.contains(**word)).collect();
        match missing.is_empty() && text.lines().count() == 1 {
            true => Ok(()),
            false => Err(format!("{missing:?} not in, or several lines: {text}")),
        }
    };
    match (expect, outcome) {
        (Clean, Ok(warnings)) if warnings.is_empty() => Ok(()),
        (Warns(words), Ok(warnings)) => {
            let all = warnings.join(" | ");
            let found = warnings.iter().any(|warning| holds(warning, words).is_ok());
            found.then_some(()).ok_or(format!("{words:?} in none of: {all}"))
        }
        (Fails(words), Err(error)) => holds(&error.to_string(), words),
        (_, Ok(warnings)) => Err(format!("loaded with {warnings:?}")),
        (_, Err(error)) => Err(format!("failed: {error}")),
    }
}

#[test]
fn every_fault_is_named_and_a_refused_capture_leaves_nothing() {
    check(CASES);
}

/// Checks the outcome of each case, by name.
pub(crate) fn check(cases: &[(&str, Expect, Fault)]) {
    let mut faults = Vec::new();
    for (name, expect, fault) in cases {
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join("data");
        save(sound(), &data);
        fault(&data);
        let outcome = load(&data);
        if let Err(what) = judge(expect, &outcome) {
            faults.push(format!("{name}: {what}"));
        }
        if let Fails(words) = expect {
            faults.extend(refused(name, &data, words));
        }
    }
    assert!(faults.is_empty(), "{} faults:\n{}", faults.len(), faults.join("\n"));
}

/// Faults of a run that must be refused before it writes anything.
fn refused(name: &str, data: &Path, words: &[&str]) -> Option<String> {
    let out = data.join("../out");
    let mut command = Command::new(env!("CARGO_BIN_EXE_ashfall"));
    command
        .stdin(Stdio::null())
        .arg("train")
        .arg(data)
        .arg("--out")
        .arg(&out);
    let output = command.args(["--iterations", "1"]).output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    let last = text.lines().last().unwrap_or_default().to_owned();
    let is_named = last.starts_with("error: ") && words.iter().all(|word| last.contains(word));
    let is_whole = output.status.code() == Some(1) && is_named && !out.exists() && !text.contains("panicked");
    (!is_whole).then(|| format!("{name}: {:?}, {text}", output.status.code()))
}

#[test]
fn raw_files_are_known_by_their_names() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.DNG", "a.nef", "a.cr2"] {
        let path = folder.path().join(name);
        fs::write(&path, encoded(image::ImageFormat::Tiff)).unwrap();
        let error = ashfall::io::photo::dimensions(&path).unwrap_err().to_string();
        assert!(error.contains("raw image") && error.contains("dcraw"), "{error}");
    }
}

/// Data set in nerfstudio's form with a value of `mask_path` in its second frame.
fn with_mask_path(folder: &Path, value: serde_json::Value) -> ashfall::Result<Dataset> {
    synth::save(sound(), folder).unwrap();
    let path = folder.join("transforms.json");
    let mut json: serde_json::Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    json["frames"][1]["mask_path"] = value;
    fs::write(&path, json.to_string()).unwrap();
    dataset::open(folder, &OpenOptions::default())
}

#[test]
fn masks_of_frames_are_read_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    masks(folder, 0..1, SIZE, left_white);
    let data = with_mask_path(folder, "./masks/0000.png.png".into()).unwrap();
    assert_eq!(data.alpha, AlphaMode::Mask);
    let photo = ashfall::io::photo::load(&data.views[1]).unwrap();
    assert_eq!((photo.rgba[10][3], photo.rgba[80]), (255, [0; 4]));
    let error = |value: serde_json::Value| with_mask_path(folder, value).unwrap_err().to_string();
    for (value, words) in [
        ("masks/none.png".into(), "none.png"),
        ("../../etc/hostname".into(), "stay inside"),
        (7.into(), "not a text"),
    ] {
        let text = error(value);
        assert!(text.contains(words) && text.lines().count() == 1, "{text}");
    }
}

#[test]
fn masked_pixels_have_no_influence() {
    let gpu = ashfall::Gpu::create(&Default::default()).unwrap();
    let trained = |paint: [u8; 4]| {
        let folder = tempfile::tempdir().unwrap();
        let mut dataset = sound().clone();
        for view in 0..dataset.views.len() {
            let mut photo = memory(&dataset, view).clone();
            let hidden = photo.rgba.iter_mut().enumerate().filter(|(place, _)| place % 96 >= 70);
            hidden.for_each(|(_, pixel)| *pixel = paint);
            dataset.views[view].photo = PhotoSource::Memory(photo);
        }
        save(&dataset, folder.path());
        masks(folder.path(), 0..10, SIZE, left_white);
        let opened = dataset::open(folder.path(), &OpenOptions::default()).unwrap();
        let config = TrainConfig::for_iterations(20);
        let mut trainer = Trainer::new(&gpu, &opened, config).unwrap();
        while !trainer.is_done() {
            trainer.step().unwrap();
        }
        trainer.splats().unwrap()
    };
    let (red, blue) = (trained([255, 0, 0, 255]), trained([0, 0, 255, 255]));
    assert!(red == blue, "paint behind a mask changes the scene");
}

#[test]
fn masks_can_be_inverted_and_switched_off() {
    let folder = tempfile::tempdir().unwrap();
    save(sound(), folder.path());
    masks(folder.path(), 0..10, SIZE, left_white);
    let alpha = |usage: MaskUse| {
        let options = OpenOptions {
            masks: usage,
            ..OpenOptions::default()
        };
        let data = dataset::open(folder.path(), &options).unwrap();
        let photo = ashfall::io::photo::load(&data.views[0]).unwrap();
        [photo.rgba[10][3], photo.rgba[80][3]]
    };
    assert_eq!(alpha(MaskUse::Ignore), [255, 0]);
    assert_eq!(alpha(MaskUse::Inverted), [0, 255]);
    assert_eq!(alpha(MaskUse::Off), [255, 255]);
}
