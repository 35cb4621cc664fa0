//! `.ksplat` files of the format's own program, and made ones with damage.

use crate::io::error_at;
use crate::io::fixtures::{Bounds, assert_close, fixture};
use ashfall::io::{LoadedSplats, Source, ksplat};
use ashfall::scene::SH_C0;
use half::f16;
use std::path::Path;

#[test]
fn files_of_the_formats_own_program_decode() {
    for (file, degree) in [
        ("playbot600_sh0.c0.d0.ksplat", 0),
        ("playbot600_sh0.c1.d0.ksplat", 0),
        ("playbot600_sh0.c2.d0.ksplat", 0),
        ("playbot600_sh1.c2.d1.ksplat", 1),
        ("playbot600_sh2.c0.d2.ksplat", 2),
        ("playbot600_sh2.c1.d1.block.ksplat", 1),
        ("playbot600_sh2.c1.d2.ksplat", 2),
        ("playbot600_sh2.c2.d2.ksplat", 2),
    ] {
        let Some((path, wanted)) = fixture("gs3d-0.4.7", file) else {
            return;
        };
        let loaded = ksplat::read(&path).unwrap();
        assert!(loaded.warnings.is_empty(), "{file}: {:?}", loaded.warnings);
        assert_eq!(
            (loaded.splats.sh_degree, loaded.stored.format.as_str()),
            (degree, "KSPLAT")
        );
        let bounds = Bounds {
            // Sums of 16-bit steps and a bucket's centre, rounded to f32 in another order, up to a few units.
            mean: 4e-6,
            // Bytes 0 and 255 are a quarter of a step inside.
            opacity: 0.25 / 255.0 + 1e-6,
            ..Bounds::EXACT
        };
        assert_close(&loaded.splats, &wanted, bounds, file);
    }
}

/// A section to be written: SH degree, splats, room.
type Section = (u16, u32, u32);

/// A file whose splats at place `i` of their section are at (i, 0, 0) from the centre of their bucket at (10 b, 0, 0)
/// for levels 1 and 2, of buckets of two splats and a last one of one.
fn scene(level: u16, sections: &[Section]) -> Vec<u8> {
    let mut bytes = vec![0; 4096];
    bytes[1] = 1;
    let number = |bytes: &mut Vec<u8>, at: usize, value: u32| bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
    number(&mut bytes, 4, sections.len() as u32);
    number(&mut bytes, 8, sections.len() as u32);
    number(&mut bytes, 12, sections.iter().map(|s| s.2).sum());
    number(&mut bytes, 16, sections.iter().map(|s| s.1).sum());
    bytes[20] = level as u8;
    let buckets = |room: u32| if level == 0 { (0, 0) } else { (room / 2, room % 2) };
    for &(degree, count, room) in sections {
        let at = bytes.len();
        bytes.resize(at + 1024, 0);
        let (full, partial) = buckets(room);
        let block = 65_534f32.to_bits();
        let fields = [
            (0, count),
            (4, room),
            (8, 2),
            (12, full + partial),
            (16, block),
            (20, 12),
            (32, full),
            (36, partial),
        ];
        for (offset, value) in fields {
            number(&mut bytes, at + offset, value);
        }
        bytes[at + 40] = degree as u8;
    }
    for &(degree, count, room) in sections {
        let (full, partial) = buckets(room);
        bytes.extend((0..partial).flat_map(|_| 1u32.to_le_bytes()));
        for bucket in 0..full + partial {
            bytes.extend([10.0 * bucket as f32, 0.0, 0.0].iter().flat_map(|v| v.to_le_bytes()));
        }
        for i in 0..count {
            record(&mut bytes, level, degree, i);
        }
        let record_bytes = {
            let mut one = Vec::new();
            record(&mut one, level, degree, 0);
            one.len()
        };
        bytes.resize(bytes.len() + (room - count) as usize * record_bytes, 0);
    }
    bytes
}

fn record(bytes: &mut Vec<u8>, level: u16, degree: u16, i: u32) {
    let float = |value: f32| match level {
        0 => value.to_le_bytes().to_vec(),
        _ => f16::from_f32(value).to_le_bytes().to_vec(),
    };
    match level {
        0 => bytes.extend([i as f32, 0.0, 0.0].iter().flat_map(|v| v.to_le_bytes())),
        // One step is a world unit.
        _ => bytes.extend([32_767 + i as u16, 32_767, 32_767].iter().flat_map(|v| v.to_le_bytes())),
    }
    bytes.extend([1.0, 0.5, 0.0].iter().flat_map(|v| float(*v)));
    bytes.extend([0.0, 0.0, 1.0, 0.0].iter().flat_map(|v| float(*v)));
    bytes.extend([0, 255, 51, 102]);
    let harmonics = 3 * ((usize::from(degree) + 1).pow(2) - 1);
    for k in 0..harmonics {
        match level {
            2 => bytes.push(k as u8),
            _ => bytes.extend(float(k as f32)),
        }
    }
}

fn read(bytes: &[u8]) -> ashfall::Result<LoadedSplats> {
    ksplat::read(Source::bytes(Path::new("scene.ksplat"), bytes))
}

#[test]
fn sections_of_all_degrees_and_levels_are_read() {
    for level in 0..=2 {
        let loaded = read(&scene(level, &[(1, 3, 3), (2, 2, 2), (0, 1, 1)])).unwrap();
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
        let splats = loaded.splats;
        assert_eq!((splats.len(), splats.sh_degree), (6, 2));
        let bucket = |b: f32| if level == 0 { 0.0 } else { 10.0 * b };
        let x = [0.0, 1.0, 2.0 + bucket(1.0), 0.0, 1.0, 0.0];
        assert!(
            splats.mean.iter().zip(x).all(|(mean, x)| *mean == [x, 0.0, 0.0]),
            "{:?}",
            splats.mean
        );
        assert_eq!(splats.quaternion[5], [0.0, 0.0, 1.0, 0.0]);
        let [a, b, c] = splats.log_scale[5];
        assert!(a == 0.0 && (b + 2f32.ln()).abs() < 1e-6 && c < -20.0 && c.is_finite());
        assert!((splats.opacity_logit[5] - (0.4f32 / 0.6).ln()).abs() < 1e-6);
        let value = |k: f32| if level == 2 { k / 255.0 * 3.0 - 1.5 } else { k };
        let close = |found: &[f32], wanted: &[f32]| found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-5);
        let color = [-0.5 / SH_C0, 0.5 / SH_C0, -0.3 / SH_C0];
        let band_1 = [0.0, 3.0, 6.0, 1.0, 4.0, 7.0, 2.0, 5.0, 8.0].map(value);
        let rows: Vec<&[f32]> = splats.sh.chunks_exact(27).collect();
        for row in &rows[..5] {
            assert!(close(&row[..3], &color) && close(&row[3..12], &band_1), "{row:?}");
        }
        assert!(rows[0][12..].iter().all(|v| *v == 0.0));
        // The second coefficient of band 2: the file has five of each channel, after nine of band 1.
        assert!(close(&rows[3][15..18], &[10.0, 15.0, 20.0].map(value)), "{:?}", rows[3]);
        assert!(close(&rows[5][..3], &color) && rows[5][3..].iter().all(|v| *v == 0.0));
    }
}

#[test]
fn files_saved_while_loading_are_read_as_far_as_they_go() {
    for level in 0..=2 {
        let loaded = read(&scene(level, &[(1, 3, 3), (1, 1, 4)])).unwrap();
        assert_eq!(loaded.splats.len(), 4);
        let said = loaded.warnings.concat();
        assert!(
            said.contains("holds 4 of the 7 splats") && said.starts_with("scene.ksplat: "),
            "{said}"
        );
    }
}

/// `bytes` with a number at `at`.
fn with(bytes: &[u8], at: usize, value: u32) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
    bytes
}

#[test]
fn damaged_files_are_refused_with_the_reason() {
    let good = scene(1, &[(1, 3, 3)]);
    // Offsets of the section's header, its partial lengths, bucket centres, and splats.
    let (section, splats) = (4096, 5120 + 4 + 2 * 12);
    let cases: &[(&str, Vec<u8>, &[&str])] = &[
        ("empty", vec![], &["byte 0", "header of 4096 bytes"]),
        ("text", vec![b'a'; 5000], &["no KSPLAT scene", "97.97 in place of 0.1"]),
        ("version", with(&good, 0, 0x0200), &["0.2 in place of 0.1"]),
        ("level", with(&good, 20, 3), &["compression level 3"]),
        ("sections", with(&good, 4, u32::MAX), &["4294967295 section headers"]),
        (
            "section header",
            good[..5000].to_vec(),
            &["1 section headers", "904 bytes left"],
        ),
        ("count", with(&good, section, 4), &["4 splats has room for 3 only"]),
        (
            "large count",
            with(&with(&good, section, u32::MAX), section + 4, u32::MAX),
            &["4294967295 splats of at least"],
        ),
        ("degree", with(&good, section + 40, 3), &["SH degree 3"]),
        ("bucket bytes", with(&good, section + 20, 16), &["buckets of 16 bytes"]),
        (
            "partial buckets",
            with(&good, section + 36, u32::MAX),
            &["4294967295 lengths of partial buckets"],
        ),
        (
            "buckets",
            with(&good, section + 12, u32::MAX),
            &["4294967295 centres of buckets"],
        ),
        ("few buckets", with(&good, 5120, 0), &["outside of all buckets"]),
        (
            "no buckets",
            with(&with(&good, section + 32, 0), 5120, 2),
            &["byte 5232", "outside of all buckets"],
        ),
        ("room", with(&good, section + 4, 9000), &["holds 3 of the 9000 splats"]),
        (
            "cut",
            good[..good.len() - 1].to_vec(),
            &["byte 5148", "splats of at least 42 bytes"],
        ),
    ];
    assert_eq!(splats + 3 * 42, good.len());
    for (name, bytes, words) in cases {
        let text = match read(bytes) {
            // Room without splats at the end is that of a file saved while loading.
            Ok(loaded) if *name == "room" => loaded.warnings.concat(),
            outcome => error_at(outcome, Path::new("scene.ksplat")),
        };
        assert_eq!(text.lines().count(), 1, "{text}");
        for word in *words {
            assert!(text.contains(word), "{name}: no {word:?} in: {text}");
        }
    }
}

#[test]
fn every_prefix_is_an_error() {
    for level in 0..=2 {
        let good = scene(level, &[(1, 3, 3), (0, 2, 2)]);
        for length in 0..good.len() {
            error_at(read(&good[..length]), Path::new("scene.ksplat"));
        }
    }
}

#[test]
fn headers_that_count_otherwise_and_trailing_bytes_are_told() {
    let good = scene(0, &[(0, 2, 2)]);
    let warned = |bytes: &[u8]| read(bytes).unwrap().warnings.concat();
    assert!(warned(&with(&good, 16, 9)).contains("its header counts 9 splats, its sections 2"));
    assert!(warned(&[&good[..], b"abc"].concat()).contains("the 3 bytes after the last section"));
    // NaN as a position.
    let none = with(&good, 5120, f32::NAN.to_bits());
    assert!(warned(&none).contains("1 of 2 splats hold values that are not finite"));
}
