//! Malicious files: findings of fuzzing, and attacks beyond the length of its inputs.

use ashfall::io::colmap::Files;
use ashfall::io::{Source, colmap, photo, ply};
use std::path::Path;
use std::time::{Duration, Instant};

fn refused<T>(result: ashfall::Result<T>) -> String {
    match result {
        Ok(_) => panic!("it was accepted"),
        Err(error) => error.to_string(),
    }
}

fn model(camera: &str, image: &str) -> ashfall::Result<ashfall::io::Listing> {
    let source = |name: &'static str, text| Source::bytes(Path::new(name), str::as_bytes(text));
    let files = Files {
        binary: false,
        cameras: source("cameras.txt", camera),
        images: source("images.txt", image),
        points: None,
        rigs: None,
    };
    colmap::read_files(&files, Path::new("images"))
}

#[test]
fn cameras_that_single_precision_cannot_hold_are_refused() {
    let pose = |t: &str, name: &str| format!("1 1 0 0 0 {t} 0 0 1 {name}\n\n");
    let good = "1 PINHOLE 8 6 9 9 4 3\n";
    assert!(model(good, &pose("1e18", "a.png")).is_ok());
    assert!(refused(model(good, &pose("1e39", "a.png"))).contains("camera at"));
    assert!(refused(model(good, &pose("1e308", "a.png"))).contains("camera at"));
    let focal = |f: &str| model(&format!("1 PINHOLE 8 6 {f} 9 4 3\n"), &pose("0", "a.png"));
    assert!(focal("1e-3").is_ok() && focal("1e12").is_ok());
    assert!(refused(focal("1e-310")).contains("the limits"));
    assert!(refused(focal("1e300")).contains("cameras.txt: line 1"));
    let center = "1 PINHOLE 8 6 9 9 4 1e39\n";
    assert!(refused(model(center, &pose("0", "a.png"))).contains("the limits"));
}

#[test]
fn names_hold_no_commands_to_a_terminal() {
    let name = "a\u{1b}]0;owned\u{7}.png";
    let text = refused(model(
        "1 PINHOLE 8 6 9 9 4 3\n",
        &format!("1 1 0 0 0 0 0 0 1 {name}\n\n"),
    ));
    assert!(text.contains("is refused") && !text.contains('\u{1b}'), "{text:?}");
}

/// A PNG header of 1-bit pixels and a JPEG frame header, both padded with zeros in place of pixel data.
fn headers(width: u16, height: u16, bytes: usize) -> [Vec<u8>; 2] {
    let mut png = b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR\0\0".to_vec();
    png.extend(width.to_be_bytes());
    png.extend([0, 0]);
    png.extend(height.to_be_bytes());
    png.extend([1, 0, 0, 0, 0]);
    let crc = crc32fast::hash(&png[12..]);
    png.extend(crc.to_be_bytes());
    png.resize(bytes.max(png.len()), 0);
    let mut jpeg = b"\xff\xd8\xff\xc0\0\x0b\x08".to_vec();
    jpeg.extend(height.to_be_bytes());
    jpeg.extend(width.to_be_bytes());
    jpeg.extend([1, 1, 0x11, 0]);
    jpeg.resize(bytes.max(jpeg.len()), 0);
    [png, jpeg]
}

#[test]
fn a_size_that_the_file_cannot_hold_is_refused_unread() {
    let name = Path::new("a");
    // 32,768 × 8,192 pixels fit in 32,514 bytes of PNG, or in 524,288 of JPEG.
    for (kind, least) in [(0, 32_514), (1, 524_288)] {
        let size = |bytes| {
            let file = &headers(32_768, 8192, bytes)[kind];
            photo::dimensions(Source::bytes(name, file))
        };
        assert_eq!(size(least).unwrap(), (32_768, 8192));
        assert!(refused(size(least - 1)).contains("more than its"));
    }
    assert!(refused(photo::decode(Source::bytes(name, &headers(9999, 9999, 64)[0]))).contains("9999 x 9999"));
}

#[test]
fn a_photograph_of_a_thousand_scans_is_refused() {
    let mut bytes = headers(8, 8, 0)[1].clone();
    bytes.extend([0xff, 0xda, 0, 3, 0].repeat(1000));
    bytes.extend([0xff, 0xd9]);
    let text = refused(photo::decode(Source::bytes(Path::new("a.jpg"), &bytes)));
    assert!(text.contains("more than 256 JPEG scans"), "{text}");
}

/// Each property and element is compared with all before it: quadratic time in a header of a megabyte.
#[test]
fn a_header_of_endless_names_is_refused_soon() {
    let header = |line: &dyn Fn(usize) -> String| {
        let lines: String = (0..50_000).map(line).collect();
        format!("ply\nformat ascii 1.0\nelement vertex 0\n{lines}end_header\n")
    };
    let texts = [
        (
            header(&|i| format!("property char a{i}\n")),
            "more than 4096 properties",
        ),
        (header(&|i| format!("element a{i} 0\n")), "more than 4096 elements"),
    ];
    for (text, rule) in texts {
        let start = Instant::now();
        let fault = refused(ply::read(Source::bytes(Path::new("a.ply"), text.as_bytes())));
        assert!(fault.contains(rule), "{fault}");
        assert!(start.elapsed() < Duration::from_secs(10), "{:?}", start.elapsed());
    }
}
