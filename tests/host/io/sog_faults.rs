//! Damaged and unusual SOG files: an error or a warning that says what is wrong.

use crate::io::error_at;
use ashfall::io::sog::{self, SogCodes, SogOptions};
use ashfall::io::{LoadedSplats, Source, splats};
use ashfall::scene::{Splats, sh_coefficient_count};
use serde_json::{Value, json};
use std::io::{Cursor, Read, Write};
use std::path::Path;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

/// Files of a bundle by name, `meta.json` first.
struct Bundle {
    meta: Value,
    images: Vec<(String, Vec<u8>)>,
}

impl Bundle {
    /// 40 splats in images of 8 x 8 pixels.
    fn new(sh_degree: u32) -> Bundle {
        let stride = 3 * sh_coefficient_count(sh_degree);
        let value = |i: usize| (i as f32 * 0.73).sin();
        let splats = Splats {
            mean: (0..40).map(|i| [value(i), value(i + 1), value(7 * i)]).collect(),
            quaternion: (0..40).map(|i| [1.0, value(i), value(2 * i), value(3 * i)]).collect(),
            log_scale: (0..40).map(|i| [value(i) - 4.0, value(5 * i), -2.0]).collect(),
            opacity_logit: (0..40).map(value).collect(),
            sh: (0..40 * stride).map(value).collect(),
            sh_degree,
            ..Splats::default()
        };
        let bytes = SogCodes::quantise(&splats, &SogOptions::default()).bytes().unwrap();
        let mut archive = ZipArchive::new(Cursor::new(bytes)).unwrap();
        let mut files: Vec<(String, Vec<u8>)> = (0..archive.len())
            .map(|i| {
                let mut file = archive.by_index(i).unwrap();
                let mut contents = Vec::new();
                file.read_to_end(&mut contents).unwrap();
                (file.name().unwrap().into_owned(), contents)
            })
            .collect();
        let (name, meta) = files.remove(0);
        assert_eq!(name, "meta.json");
        Bundle {
            meta: serde_json::from_slice(&meta).unwrap(),
            images: files,
        }
    }

    fn image(&mut self, name: &str) -> &mut Vec<u8> {
        let found = self.images.iter_mut().find(|(n, _)| n == name);
        &mut found.unwrap().1
    }

    fn rename(&mut self, from: &str, to: &str) {
        let found = self.images.iter_mut().find(|(n, _)| n == from);
        found.unwrap().0 = to.to_owned();
    }

    fn pack(&self) -> Vec<u8> {
        self.pack_as("", CompressionMethod::Stored, self.meta.to_string().as_bytes())
    }

    fn pack_as(&self, folder: &str, method: CompressionMethod, meta: &[u8]) -> Vec<u8> {
        let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
        let options = SimpleFileOptions::default().compression_method(method);
        let images = self
            .images
            .iter()
            .map(|(name, bytes)| (name.as_str(), bytes.as_slice()));
        for (name, contents) in images.chain([("meta.json", meta)]) {
            writer.start_file(format!("{folder}{name}"), options).unwrap();
            writer.write_all(contents).unwrap();
        }
        writer.finish().unwrap().into_inner()
    }
}

fn read(bytes: &[u8]) -> ashfall::Result<LoadedSplats> {
    sog::read(Source::bytes(Path::new("scene.sog"), bytes))
}

/// Asserts that a bundle is refused in one line with these words.
#[track_caller]
fn refused(bytes: &[u8], words: &[&str]) {
    let text = error_at(read(bytes), Path::new("scene.sog"));
    assert!(text.lines().count() == 1, "several lines: {text}");
    for word in words {
        assert!(text.contains(word), "no {word:?} in: {text}");
    }
}

#[track_caller]
fn warned(bytes: &[u8], words: &[&str]) -> LoadedSplats {
    let loaded = read(bytes).unwrap();
    let text = loaded.warnings.join("\n");
    for word in words {
        assert!(text.contains(word), "no {word:?} in: {text}");
    }
    loaded
}

/// Lossless WebP image of one colour.
fn plain(width: u32, height: u32, color: [u8; 4]) -> Vec<u8> {
    let pixels = color.repeat((width * height) as usize);
    let mut config = webp::WebPConfig::new().unwrap();
    (config.lossless, config.exact) = (1, 1);
    let encoder = webp::Encoder::from_rgba(&pixels, width, height);
    encoder.encode_advanced(&config).unwrap().to_vec()
}

/// Bytes with all occurrences of a text replaced by one of the same length: names that no writer of archives takes.
fn patched(mut bytes: Vec<u8>, from: &str, to: &str) -> Vec<u8> {
    assert_eq!(from.len(), to.len());
    for at in 0..=bytes.len() - from.len() {
        if bytes[at..].starts_with(from.as_bytes()) {
            bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
        }
    }
    bytes
}

#[test]
fn broken_lists_are_refused() {
    let good = Bundle::new(1);
    assert!(read(&good.pack()).unwrap().warnings.is_empty());
    let with = |pointer: &str, value: Value| {
        let mut bundle = Bundle::new(1);
        *bundle.meta.pointer_mut(pointer).unwrap() = value;
        bundle.pack()
    };
    refused(&with("/version", json!(99)), &["meta.json", "version is 99"]);
    refused(&with("/count", json!(100)), &["means_l.webp", "8 x 8", "100 splats"]);
    refused(&with("/count", json!(10_000_000)), &["10000000 splats", "at most"]);
    refused(&with("/count", json!(u64::MAX)), &["18446744073709551615 splats"]);
    refused(&with("/count", json!(-1)), &["JSON", "-1"]);
    refused(&with("/means/mins", json!([0, 1])), &["JSON", "3"]);
    refused(&with("/means/files", json!(["means_l.webp"])), &["JSON", "2"]);
    refused(&with("/quats", Value::Null), &["JSON"]);
    refused(
        &with("/scales/codebook", json!([1, 2])),
        &["scales.webp", "codebook of 2 values"],
    );
    refused(&with("/sh0/codebook", json!([])), &["sh0.webp", "codebook of 0 values"]);
    refused(
        &with("/shN/codebook", json!([0.5])),
        &["shN_centroids.webp", "codebook of 1 values"],
    );
    refused(&with("/sh0/codebook/3", json!(1e39)), &["JSON", "out of range"]);
    refused(&with("/sh0/codebook/3", Value::Null), &["value 3", "sh0", "null"]);
    refused(&with("/shN/bands", json!(4)), &["4 bands"]);
    refused(
        &with("/shN/bands", json!(2)),
        &["shN_centroids.webp", "degree 1", "2 bands"],
    );
    refused(&with("/sh0/files", json!(["../../etc/hostname"])), &["stay inside"]);
    refused(&with("/sh0/files", json!(["/etc/hostname"])), &["stay inside"]);
    refused(&with("/sh0/files", json!(["other.webp"])), &["no \"other.webp\""]);
    let mut bundle = Bundle::new(0);
    bundle.meta["model"] = "2dgs".into();
    refused(&bundle.pack(), &["2D Gaussian"]);
    bundle.meta["version"] = Value::Null;
    bundle.meta["model"] = Value::Null;
    refused(&bundle.pack(), &["JSON"]);
    let text = good.meta.to_string();
    let stored = |text: &str| good.pack_as("", CompressionMethod::Stored, text.as_bytes());
    refused(&stored(&text.replace("\"mins\":[", "\"mins\":[NaN,")), &["JSON"]);
    refused(
        &stored(&text.replace("\"count\":40", "\"count\":40,\"count\":41")),
        &["JSON", "count"],
    );
    refused(&stored("whatever"), &["JSON"]);
    refused(&stored(""), &["JSON"]);
    refused(&stored(&"[".repeat(10_000)), &["JSON"]);
}

#[test]
fn broken_archives_are_refused() {
    let bundle = Bundle::new(1);
    let good = bundle.pack();
    refused(&[], &["ZIP"]);
    refused(b"whatever", &["ZIP"]);
    refused(&good[..good.len() / 2], &["ZIP"]);
    for length in (0..good.len()).step_by(97) {
        assert!(read(&good[..length]).is_err(), "{length} bytes");
    }
    let mut flipped = good.clone();
    let at = good.windows(4).position(|w| w == b"VP8L").unwrap();
    flipped[at + 12] ^= 1;
    refused(&flipped, &["means_l.webp", "unpacked"]);
    refused(&patched(good.clone(), "meta.json", "mama.json"), &["no \"meta.json\""]);
    refused(&patched(good.clone(), "meta.json", "../a.json"), &["stay inside"]);
    refused(&patched(good.clone(), "meta.json", "/etc/json"), &["stay inside"]);
    refused(&patched(good.clone(), "means_u.webp", "means_l.webp"), &["same name"]);
    let mut streamed = Bundle::new(0);
    streamed.rename("sh0.webp", "lod-meta.json");
    refused(&streamed.pack(), &["no \"sh0.webp\""]);
    let streamed = streamed.pack_as("a/b/", CompressionMethod::Stored, b"{}");
    refused(&streamed, &["streamed", "levels of detail"]);
}

#[test]
fn broken_images_are_refused() {
    let with = |name: &str, contents: Vec<u8>| {
        let mut bundle = Bundle::new(1);
        *bundle.image(name) = contents;
        bundle.pack()
    };
    refused(&with("quats.webp", Vec::new()), &["quats.webp", "empty"]);
    refused(
        &with("quats.webp", b"some text".to_vec()),
        &["quats.webp", "neither a WebP nor a PNG"],
    );
    let image = plain(8, 8, [1, 2, 3, 4]);
    refused(
        &with("quats.webp", image[..image.len() - 4].to_vec()),
        &["quats.webp", "cut short"],
    );
    refused(
        &with("quats.webp", plain(8, 12, [0; 4])),
        &["quats.webp", "8 x 12", "first image 8 x 8"],
    );
    refused(
        &with("means_l.webp", plain(4, 4, [0; 4])),
        &["means_l.webp", "4 x 4", "too few"],
    );
    refused(
        &with("shN_centroids.webp", plain(193, 1, [0; 4])),
        &["shN_centroids.webp", "193 x 1"],
    );
    let pixels = [9; 8 * 8 * 4];
    let lossy = webp::Encoder::from_rgba(&pixels, 8, 8).encode(50.0).to_vec();
    refused(&with("sh0.webp", lossy), &["sh0.webp", "losses"]);
    let mut noise = plain(8, 8, [1, 2, 3, 4]);
    let length = noise.len();
    noise[25..length].fill(0xff);
    refused(&with("sh0.webp", noise), &["sh0.webp", "decoded"]);
}

/// Images of one colour and deflated zeros are small files of any size.
#[test]
fn bombs_are_refused_unpacked() {
    let mut bundle = Bundle::new(0);
    *bundle.image("means_l.webp") = plain(4096, 4096, [0; 4]);
    refused(&bundle.pack(), &["means_l.webp", "4096 x 4096"]);
    let zeros = vec![b' '; 50 << 20];
    let bytes = Bundle::new(0).pack_as("", CompressionMethod::Deflated, &zeros);
    assert!(bytes.len() < 100_000);
    refused(&bytes, &["meta.json", "52428800 bytes"]);
    let mut bundle = Bundle::new(0);
    *bundle.image("sh0.webp") = zeros;
    let meta = bundle.meta.to_string();
    refused(
        &bundle.pack_as("", CompressionMethod::Deflated, meta.as_bytes()),
        &["sh0.webp", "52428800 bytes"],
    );
    // All images agree, and only the length of the file speaks against two million splats.
    let mut bundle = Bundle::new(0);
    for (_, image) in &mut bundle.images {
        *image = plain(1448, 1448, [0, 0, 0, 252]);
    }
    bundle.meta["count"] = json!(2_000_000);
    refused(&bundle.pack(), &["2000000 splats", "at most"]);
    bundle.meta["count"] = json!(70_000);
    refused(&bundle.pack(), &["means_l.webp", "1448 x 1448"]);
}

#[test]
fn irregular_codes_are_read_with_a_warning() {
    let mut bundle = Bundle::new(1);
    *bundle.image("shN_labels.webp") = plain(8, 8, [0, 1, 0, 255]);
    let loaded = warned(&bundle.pack(), &["40 of 40 splats", "labels beyond the 64 entries"]);
    assert!(
        loaded
            .splats
            .sh
            .chunks_exact(12)
            .all(|sh| sh[3..].iter().all(|v| *v == 0.0))
    );
    let mut bundle = Bundle::new(0);
    *bundle.image("quats.webp") = plain(8, 8, [9, 9, 9, 251]);
    let loaded = warned(&bundle.pack(), &["40 of 40 splats", "no rotation"]);
    assert_eq!(loaded.splats.quaternion, [[1.0, 0.0, 0.0, 0.0]; 40]);
    // A fault of early versions of splat-transform.
    let mut bundle = Bundle::new(0);
    bundle.meta["sh0"]["codebook"][0] = Value::Null;
    warned(&bundle.pack(), &["first value", "sh0", "null"]);
    let mut bundle = Bundle::new(0);
    bundle.meta["means"]["maxs"] = json!([1e9, 0, 0]);
    warned(&bundle.pack(), &["not finite", "dropped"]);
    let mut bundle = Bundle::new(0);
    bundle.meta["model"] = "fog".into();
    warned(&bundle.pack(), &["unknown model \"fog\""]);
}

#[test]
fn bundles_of_other_writers_are_read() {
    let bundle = Bundle::new(1);
    let wanted = read(&bundle.pack()).unwrap();
    let meta = bundle.meta.to_string();
    for (folder, method) in [
        ("", CompressionMethod::Deflated),
        ("scene/", CompressionMethod::Stored),
        ("scene/", CompressionMethod::Deflated),
    ] {
        let bytes = bundle.pack_as(folder, method, meta.as_bytes());
        assert_eq!(read(&bytes).unwrap(), wanted, "{folder} {method}");
    }
    let mut png = Bundle::new(1);
    let contents = std::mem::take(png.image("quats.webp"));
    let pixels = image::load_from_memory(&contents).unwrap().into_rgba8();
    let mut encoded = Cursor::new(Vec::new());
    pixels.write_to(&mut encoded, image::ImageFormat::Png).unwrap();
    *png.image("quats.webp") = encoded.into_inner();
    assert_eq!(read(&png.pack()).unwrap(), wanted);
    // The extended form of WebP, with a profile before the image.
    let mut extended = Bundle::new(1);
    let image = extended.image("scales.webp");
    let body = image.split_off(12);
    image.extend(b"VP8X\x0a\0\0\0\x20\0\0\0\x07\0\0\x07\0\0ICCP\x03\0\0\0abc\0");
    image.extend(body);
    assert_eq!(read(&extended.pack()).unwrap(), wanted);
    let mut mip = Bundle::new(1);
    mip.meta["antialias"] = true.into();
    assert_eq!(
        read(&mip.pack()).unwrap().splats.filter,
        ashfall::scene::ScreenFilter::Mip
    );
}

#[test]
fn folders_stay_inside_and_name_their_files() {
    let folder = tempfile::tempdir().unwrap();
    let bundle = Bundle::new(1);
    let path = folder.path().join("meta.json");
    std::fs::write(&path, bundle.meta.to_string()).unwrap();
    error_at(splats::read(&path), &folder.path().join("means_l.webp"));
    for (name, contents) in &bundle.images {
        std::fs::write(folder.path().join(name), contents).unwrap();
    }
    assert_eq!(
        splats::read(&path).unwrap().splats,
        read(&bundle.pack()).unwrap().splats
    );
    let image = folder.path().join("sh0.webp");
    std::fs::write(&image, b"nothing").unwrap();
    assert!(error_at(splats::read(&path), &image).contains("neither"));
    let outside = bundle.meta.to_string().replace("sh0.webp", "../sh0.webp");
    std::fs::write(&path, outside).unwrap();
    assert!(error_at(splats::read(&path), &path).contains("stay inside"));
    let streamed = folder.path().join("lod-meta.json");
    std::fs::write(&streamed, b"{}").unwrap();
    assert!(error_at(splats::read(&streamed), &streamed).contains("streamed"));
    let long = folder.path().join("a-meta.json");
    std::fs::write(&long, vec![b' '; (1 << 20) + 1]).unwrap();
    assert!(error_at(splats::read(&long), &long).contains("1048577 bytes"));
}
