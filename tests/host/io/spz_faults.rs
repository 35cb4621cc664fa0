//! Damaged and unusual SPZ files.

use crate::io::error_at;
use crate::io::spz::edges;
use ashfall::io::spz::{self, SpzCodes, SpzOptions, SpzVersion};
use ashfall::io::{AxesBy, LoadedSplats, Source};
use ashfall::scene::Axes;
use flate2::Compression;
use flate2::write::GzEncoder;
use std::io::Write;
use std::path::Path;

/// Contents of versions 1 to 3.
fn contents(version: u8, count: u8, degree: u8, flags: u8) -> Vec<u8> {
    let mut bytes = b"NGSP".to_vec();
    bytes.extend([version, 0, 0, 0, count, 0, 0, 0, degree, 12, flags, 0]);
    let position = if version == 1 { 6 } else { 9 };
    let rotation = if version < 3 { 3 } else { 4 };
    let sh = 3 * ((usize::from(degree) + 1).pow(2) - 1);
    let size = usize::from(count) * (position + 1 + 3 + 3 + rotation + sh);
    bytes.extend((0..size).map(|i| (i * 37 % 59) as u8));
    bytes
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::new(6));
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn version_4(degree: u32) -> Vec<u8> {
    let codes = SpzCodes::nearest(&edges(degree, 10.0), &SpzOptions::default());
    codes.bytes(SpzVersion::V4, 3).unwrap()
}

/// `bytes` with others from `at` on.
fn with(bytes: &[u8], at: usize, others: &[u8]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    bytes[at..at + others.len()].copy_from_slice(others);
    bytes
}

fn read(bytes: &[u8]) -> ashfall::Result<LoadedSplats> {
    spz::read(Source::bytes(Path::new("scene.spz"), bytes))
}

fn fault(bytes: &[u8]) -> String {
    let text = error_at(read(bytes), Path::new("scene.spz"));
    assert_eq!(text.lines().count(), 1, "{text}");
    text
}

#[test]
fn damaged_files_are_refused_with_the_reason() {
    let (three, four) = (contents(3, 5, 1, 0), version_4(1));
    let zipped = gzip(&three);
    // Header of 32 bytes, record of 12, table of six entries.
    let frames_at = 44 + 6 * 16;
    let cases: &[(&str, Vec<u8>, &[&str])] = &[
        ("empty", vec![], &["the file is empty"]),
        (
            "text",
            b"whatever".to_vec(),
            &["byte 0", "neither \"NGSP\" nor a gzip stream"],
        ),
        (
            "magic",
            gzip(b"XXXX0123456789abcdef"),
            &["inflated contents", "\"XXXX\" in place of \"NGSP\""],
        ),
        ("short", gzip(b"NGSP"), &["byte 4", "header of 16 bytes"]),
        ("version", gzip(&with(&three, 4, &[77])), &["SPZ version 77"]),
        (
            "raw version",
            with(&three, 4, &[0]),
            &["byte 0 of the file", "SPZ version 0"],
        ),
        ("degree", gzip(&with(&three, 12, &[9])), &["SH degree 9"]),
        (
            "fractional bits",
            gzip(&with(&three, 13, &[200])),
            &["200 fractional bits"],
        ),
        (
            "count",
            gzip(&with(&three, 8, &[255; 4])),
            &["4294967295 splats of 29 bytes", "can hold"],
        ),
        (
            "one more",
            gzip(&with(&three, 8, &[6])),
            &["byte 161", "ends inside the harmonics of 6 splats"],
        ),
        (
            "raw cut",
            three[..20].to_vec(),
            &["5 splats of 29 bytes", "can hold 20 bytes"],
        ),
        (
            "gzip cut",
            zipped[..zipped.len() - 12].to_vec(),
            &["damaged or cut off"],
        ),
        (
            "checksum",
            with(&zipped, zipped.len() - 8, &[1, 2, 3, 4]),
            &["byte 161", "damaged or cut off", "checksum"],
        ),
        (
            "no records",
            gzip(&with(&three, 14, &[2])),
            &["byte 161", "before the extensions"],
        ),
        ("version 4 in gzip", gzip(&four), &["version 4", "no gzip stream"]),
        ("header", four[..31].to_vec(), &["byte 31", "header of 32 bytes"]),
        (
            "count of 4",
            with(&four, 8, &[255; 4]),
            &["byte 8", "4294967295 splats are announced"],
        ),
        ("degree of 4", with(&four, 12, &[5]), &["SH degree 5"]),
        (
            "streams",
            with(&four, 15, &[5]),
            &["byte 15", "5 streams; splats of SH degree 1 have 6"],
        ),
        ("table", with(&four, 16, &[0, 0, 0, 9]), &["byte 16", "does not fit"]),
        ("table in header", with(&four, 16, &[16]), &["byte 16", "at byte 16"]),
        (
            "record",
            with(&four, 36, &[5]),
            &["byte 32", "extension 0", "has 5 bytes, and 4 are left"],
        ),
        (
            "record head",
            with(&four, 36, &[1]),
            &["byte 32", "extension 1 is cut off"],
        ),
        (
            "compressed",
            with(&four, 44, &[255; 8]),
            &["byte 44", "positions of 18446744073709551615"],
        ),
        (
            "uncompressed",
            with(&four, 68, &[65]),
            &["byte 68", "alphas of 65 bytes; all splats have 64"],
        ),
        (
            "count and sizes",
            with(&four, 8, &[65]),
            &["byte 52", "positions of 576 bytes; all splats have 585"],
        ),
        (
            "frame",
            with(&four, frames_at, &[0]),
            &["byte 140", "positions are damaged"],
        ),
        (
            "trailing",
            [&four[..], b"abc"].concat(),
            &["3 bytes after the last stream"],
        ),
        (
            "cut",
            four[..four.len() - 1].to_vec(),
            &["harmonics of", "are left in the file"],
        ),
    ];
    for (name, bytes, words) in cases {
        let text = fault(bytes);
        for word in *words {
            assert!(text.contains(word), "{name}: no {word:?} in: {text}");
        }
    }
}

/// A file of version 4 and degree 0 with these frames in place of its own.
fn with_frames(frames: [Vec<u8>; 5]) -> Vec<u8> {
    let mut bytes = b"NGSP\x04\0\0\0\x02\0\0\0\0\x0c\0\x05\x20\0\0\0".to_vec();
    bytes.resize(32, 0);
    for (frame, size) in frames.iter().zip([18u64, 2, 6, 6, 8]) {
        bytes.extend((frame.len() as u64).to_le_bytes());
        bytes.extend(size.to_le_bytes());
    }
    bytes.extend(frames.concat());
    bytes
}

#[test]
fn frames_must_inflate_to_their_size() {
    let frame = |size: usize| zstd::bulk::compress(&vec![7; size], 3).unwrap();
    // Without the size in the frame.
    let streamed = |size: usize| {
        let mut encoder = zstd::stream::write::Encoder::new(Vec::new(), 3).unwrap();
        encoder.include_contentsize(false).unwrap();
        encoder.write_all(&vec![7; size]).unwrap();
        encoder.finish().unwrap()
    };
    let frames = |first: Vec<u8>| with_frames([first, frame(2), frame(6), frame(6), frame(8)]);
    assert_eq!(read(&frames(frame(18))).unwrap().splats.len(), 2);
    assert_eq!(read(&frames(streamed(18))).unwrap().splats.len(), 2);
    assert!(fault(&frames(frame(19))).contains("inflate to 19 bytes; 18 are announced"));
    assert!(fault(&frames(streamed(19))).contains("inflate to more than the 18 bytes"));
    assert!(fault(&frames(streamed(17))).contains("inflate to fewer than the 18 bytes"));
    let two = [frame(18), frame(1)].concat();
    assert!(fault(&frames(two)).contains("bytes before their stream"));
    assert!(fault(&frames(Vec::new())).contains("positions"));
}

#[test]
fn every_prefix_is_an_error() {
    let files = [1, 2, 3].map(|version| contents(version, 4, 1, 0));
    let zipped = files.iter().map(|file| gzip(file)).collect::<Vec<_>>();
    let fours = [version_4(0), version_4(3)];
    for file in files.iter().chain(&zipped).chain(&fours) {
        assert!(read(file).unwrap().warnings.is_empty());
        for length in 0..file.len() {
            fault(&file[..length]);
        }
    }
}

/// Warnings of a file that is read.
fn warned(bytes: &[u8]) -> (LoadedSplats, String) {
    let loaded = read(bytes).unwrap();
    let warnings = loaded.warnings.join("\n");
    assert!(
        loaded.warnings.iter().all(|w| w.starts_with("scene.spz: ")),
        "{warnings}"
    );
    (loaded, warnings)
}

#[test]
fn unusual_files_are_read_with_a_warning() {
    let (loaded, said) = warned(&gzip(&contents(3, 3, 4, 0)));
    assert!(said.contains("degree 4 were left out"), "{said}");
    let splats = loaded.splats;
    assert_eq!((splats.sh_degree, splats.sh.len()), (3, 3 * 48));
    // The second splat's harmonics begin after 24 coefficients of the first.
    let code = |i: usize| contents(3, 3, 4, 0)[16 + 3 * 20 + 72 + i];
    assert!((0..45).all(|i| 128.0 + 128.0 * splats.sh[48 + 3 + i] == f32::from(code(i))));

    let tree = [contents(3, 3, 1, 0x82), vec![9; 40]].concat();
    let (loaded, said) = warned(&gzip(&tree));
    assert!(
        loaded.splats.len() == 3 && said.contains("0x80") && !said.contains("\n"),
        "{said}"
    );
    let (_, said) = warned(&gzip(&contents(2, 3, 1, 0x14)));
    assert!(said.contains("unknown flags 0x14"), "{said}");
    let (_, said) = warned(&with(&version_4(1), 14, &[0x42]));
    assert!(said.contains("unknown flags 0x40"), "{said}");
    let (_, said) = warned(&[contents(3, 3, 1, 0), vec![1]].concat());
    assert!(said.contains("after the last splat were ignored"), "{said}");
    let (_, said) = warned(&[gzip(&contents(3, 3, 1, 0)), vec![1, 2]].concat());
    assert!(said.contains("the 2 bytes after the gzip stream"), "{said}");
}

#[test]
fn extensions_give_axes_and_others_are_skipped() {
    let record = |kind: u32, contents: &[u8]| {
        let head = [kind.to_le_bytes(), (contents.len() as u32).to_le_bytes()].concat();
        [&head, contents].concat()
    };
    let orbit = record(0xadbe_0002, &[0; 12]);
    let axes = |value: u8| record(0xadbe_0003, &[value, 0, 0, 0]);
    let file = |records: &[Vec<u8>]| gzip(&[contents(2, 3, 0, 2), records.concat()].concat());
    let (loaded, said) = warned(&file(&[orbit.clone(), axes(7)]));
    assert_eq!((loaded.stored.axes, loaded.stored.axes_by), (Axes::LUF, AxesBy::File));
    assert_eq!(said, "");
    let (loaded, said) = warned(&file(&[
        record(0x1234_0001, b"ab"),
        record(5, b""),
        axes(99),
        orbit.clone(),
    ]));
    assert_eq!(
        (loaded.stored.axes, loaded.stored.axes_by),
        (Axes::RUB, AxesBy::Assumption)
    );
    assert!(
        said.contains("0x12340001 is not known") && said.contains("unknown value 99"),
        "{said}"
    );
    assert_eq!(loaded.warnings.len(), 2, "{said}");
    let cut = file(&[orbit[..15].to_vec()]);
    assert!(fault(&cut).contains("has 12 bytes, and 7 are left"));
}

#[test]
fn contents_beyond_the_splats_are_not_inflated() {
    let bomb = [contents(2, 10, 2, 0), vec![0; 40_000_000]].concat();
    let (loaded, said) = warned(&gzip(&bomb));
    assert_eq!(loaded.splats.len(), 10);
    assert!(said.contains("after the last splat were ignored"), "{said}");
}

#[test]
fn positions_of_version_1_that_are_not_finite_are_dropped() {
    // 0x7e00 is a half float without a value.
    let (loaded, said) = warned(&with(&contents(1, 3, 0, 0), 16, &[0, 0x7e]));
    assert!(loaded.splats.len() == 2 && said.contains("1 of 3 splats"), "{said}");
}
