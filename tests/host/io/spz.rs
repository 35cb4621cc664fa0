//! SPZ files: those of independent writers, and our own.

use crate::io::fixtures::{Bounds, assert_close, fixture, unpacked};
use crate::io::{error_at, shared};
use ashfall::io::spz::{self, LEVEL, SpzCodes, SpzOptions, SpzVersion};
use ashfall::io::{AxesBy, ply, splats};
use ashfall::scene::{Axes, ScreenFilter, Splats, sh_coefficient_count};

/// Rounding of floats. Bytes 0 and 255 of opacity, which others decode as 0 and 1, are a quarter of a step inside; w
/// follows from a difference of rounded squares in versions 1 and 2, and is √2⁻²³ off if it is zero.
pub(super) fn decoding(version: u32) -> Bounds {
    Bounds {
        opacity: 0.25 / 255.0 + 1e-6,
        rotation_degrees: if version < 3 {
            0.05
        } else {
            Bounds::EXACT.rotation_degrees
        },
        ..Bounds::EXACT
    }
}

/// Half a step of every code, with harmonics of `bits`; `extra` is a second rounding in the writer.
fn half_steps(fractional_bits: i32, bits: i32, extra: f32) -> Bounds {
    Bounds {
        mean: 0.5f32.powi(fractional_bits + 1) * 1.001,
        log_scale: 1.0 / 32.0 + 1e-6,
        // Three components within half of √½ / 511 are together within 1.2e-3. The largest is 1/2 at least and follows:
        // within √3/2 · 1.2e-3 / (1/2). The angle is twice the distance of the quaternions, 2.4e-3.
        rotation_degrees: 0.28,
        opacity: 0.5 / 255.0 + 1e-6,
        color: 0.5 / 255.0 / 0.15 + 1e-5,
        sh: 0.5f32.powi(bits) + extra + 1e-6,
    }
}

/// Splats with all values moved into the ranges of the codes in `axes`; `sh_most` is the greatest harmonic.
fn clamped(source: &Splats, axes: Axes, sh_most: f32) -> Splats {
    let mut splats = source.clone();
    splats.change_axes(Axes::RDF, axes);
    for scale in splats.log_scale.as_flattened_mut() {
        *scale = scale.clamp(-10.0, 255.0 / 16.0 - 10.0);
    }
    let stride = splats.sh_stride();
    for (i, value) in splats.sh.iter_mut().enumerate() {
        *value = match i % stride < 3 {
            true => value.clamp(-0.5 / 0.15, 0.5 / 0.15),
            false => value.clamp(-1.0, sh_most),
        };
    }
    splats.change_axes(axes, Axes::RDF);
    splats
}

/// Writer, file and version.
const FILES: &[(&str, &str, u32)] = &[
    ("spz-cpp", "playbot600_sh0.rub.v2.spz", 2),
    ("spz-cpp", "playbot600_sh0.rub.v3.spz", 3),
    ("spz-cpp", "playbot600_sh0.rub.v4.spz", 4),
    ("spz-cpp", "playbot600_sh1.luf.v2.spz", 2),
    ("spz-cpp", "playbot600_sh1.rub.v3.aa.spz", 3),
    ("spz-cpp", "playbot600_sh1.rub.v4.aa.spz", 4),
    ("spz-cpp", "playbot600_sh2.ext_rdf.v4.spz", 4),
    ("spz-cpp", "playbot600_sh2.rub.v2.spz", 2),
    ("spz-cpp", "playbot600_sh2.rub.v3.spz", 3),
    ("spz-cpp", "playbot600_sh2.rub.v4.spz", 4),
    ("splat-transform-3.7.0", "playbot600_sh0.v3.spz", 3),
    ("splat-transform-3.7.0", "playbot600_sh0.v4.spz", 4),
    ("splat-transform-3.7.0", "playbot600_sh0_mip.v4.spz", 4),
    ("splat-transform-3.7.0", "playbot600_sh1.v3.spz", 3),
    ("splat-transform-3.7.0", "playbot600_sh1.v4.spz", 4),
    ("splat-transform-3.7.0", "playbot600_sh2.v3.spz", 3),
    ("splat-transform-3.7.0", "playbot600_sh2.v4.spz", 4),
    ("gsply-0.4.6", "playbot600_sh0.v3.spz", 3),
    ("gsply-0.4.6", "playbot600_sh0.v4.fb16.spz", 4),
    ("gsply-0.4.6", "playbot600_sh2.v3.spz", 3),
    ("gsply-0.4.6", "playbot600_sh2.v4.fb16.spz", 4),
    ("spz-rs-0.0.1", "playbot600_sh2.rs.spz", 3),
    ("handmade", "playbot600_sh1.raw.v1.spz", 1),
];

#[test]
fn files_of_other_writers_decode_as_stored() {
    for &(writer, file, version) in FILES {
        let Some((path, wanted)) = fixture(writer, file) else {
            return;
        };
        let loaded = spz::read(&path).unwrap();
        assert!(loaded.warnings.is_empty(), "{file}: {:?}", loaded.warnings);
        let stated = file.contains(".ext_");
        let (axes, by) = match stated {
            true => (Axes::RDF, AxesBy::File),
            false => (Axes::RUB, AxesBy::Assumption),
        };
        assert_eq!(loaded.stored.format, format!("SPZ {version}"), "{file}");
        assert_eq!((loaded.stored.axes, loaded.stored.axes_by), (axes, by), "{file}");
        let mip = file.contains(".aa.") || file.contains("_mip.");
        assert_eq!(loaded.splats.filter == ScreenFilter::Mip, mip, "{file}");
        assert_close(&loaded.splats, &wanted, decoding(version), file);
    }
}

#[test]
fn files_of_other_writers_are_close_to_their_source() {
    let sources = FILES
        .iter()
        .filter(|(writer, ..)| !["spz-rs-0.0.1", "handmade"].contains(writer));
    for &(writer, file, version) in sources {
        let Some((path, _)) = fixture(writer, file) else {
            return;
        };
        let stem = &file[..file.find('.').unwrap()];
        let source = ply::read(&shared(&format!("formats/source/{stem}.ply")).unwrap());
        let mut source = source.unwrap().splats;
        if file.contains(".luf.") {
            source.change_axes(Axes::LUF, Axes::RDF);
        }
        let axes = match writer {
            "spz-cpp" if !file.contains(".ext_rdf.") => Axes::RUB,
            _ => Axes::RDF,
        };
        let bits = match writer {
            "gsply-0.4.6" => 8,
            _ => 4,
        };
        let fractional = if file.contains("fb16") { 16 } else { 12 };
        // The `spz` library rounds to 8 bits first.
        let mut bounds = half_steps(fractional, bits, 1.0 / 256.0);
        if version < 3 {
            bounds.rotation_degrees = 10.7;
        }
        // Other writers store the axes of their source without saying so.
        let loaded = match writer {
            "spz-cpp" => splats::read(&path).unwrap(),
            _ => splats::read_in_axes(&path, Some(axes)).unwrap(),
        };
        assert_eq!(loaded.stored.axes, axes, "{file}");
        let wanted = clamped(&source, axes, 127.0 / 128.0);
        assert_close(&loaded.splats, &wanted, bounds, file);
    }
}

/// The first file was packed from LUF, so the library's own conversion is to LUF.
#[test]
fn axes_are_turned_as_the_library_turns_them() {
    for (file, axes) in [
        ("playbot600_sh1.luf.v2.spz", Axes::LUF),
        ("playbot600_sh2.ext_rdf.v4.spz", Axes::RDF),
    ] {
        let Some((path, _)) = fixture("spz-cpp", file) else {
            return;
        };
        let expected = shared(&format!("formats/expected/spz-cpp__{file}.rdf.ply.gz")).unwrap();
        let mut wanted = unpacked(&expected);
        wanted.change_axes(axes, Axes::RDF);
        let found = splats::read(&path).unwrap().splats;
        assert_close(&found, &wanted, decoding(2), file);
    }
}

/// Edges of every range, then splats in between.
pub(super) fn edges(degree: u32, reach: f32) -> Splats {
    let count = 64;
    let wave = |seed: f32, i: usize| (seed + 12.9898 * i as f32).sin();
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let mut quaternion = Vec::new();
    for largest in 0..4 {
        for sign in [1.0, -1.0] {
            let mut q = [0.3, -0.2, 0.1, -0.25];
            q[largest] = 0.9 * sign;
            quaternion.push(q);
        }
    }
    quaternion.extend([
        [0.5; 4],
        [-0.5, 0.5, -0.5, 0.5],
        [3.0, -4.0, 0.0, 12.0],
        [half, 0.0, 0.0, -half],
    ]);
    quaternion.push([1e-4, 0.6, -0.8, 0.0]);
    quaternion.extend((quaternion.len()..count).map(|i| [1.0, 2.0, 3.0, 4.0].map(|seed| wave(seed, i) + 1e-3)));
    let filled = |edges: &[f32], seed: f32, scale: f32| -> Vec<f32> {
        let rest = (edges.len()..3 * count).map(|i| scale * wave(seed, i));
        edges.iter().copied().chain(rest).collect()
    };
    let triples = |values: Vec<f32>| values.as_chunks::<3>().0.to_vec();
    let positions = [
        reach,
        -reach,
        0.0,
        1000.0,
        -1000.0,
        1.0 / 4096.0,
        0.5 / 4096.0,
        -1.5 / 4096.0,
        1e-9,
    ];
    let stride = 3 * sh_coefficient_count(degree);
    let mut sh: Vec<f32> = (0..count * stride).map(|i| 1.2 * wave(6.0, i)).collect();
    let rows = [1.7, -1.7, -5.0, 1.0, -1.0, 0.0, 0.0625, -0.0625, 0.03125, 6.0, -6.0];
    for (row, value) in sh.chunks_exact_mut(stride).zip(rows) {
        row.fill(value);
    }
    Splats {
        mean: triples(filled(&positions, 1.0, 20.0)),
        quaternion,
        log_scale: triples(filled(&[-12.0, -10.0, 0.0, 7.0, 5.9375, 1.0 / 32.0], 2.0, 6.0)),
        opacity_logit: filled(&[12.0, -12.0, 0.0, 30.0, -30.0], 3.0, 5.0)[..count].to_vec(),
        sh,
        sh_degree: degree,
        filter: if degree == 1 {
            ScreenFilter::Mip
        } else {
            ScreenFilter::Classic
        },
        ..Splats::default()
    }
}

#[test]
fn nearest_codes_are_within_half_a_step() {
    for (reach, most, taken) in [
        (2047.9, 12, 12),
        (2048.0, 12, 11),
        (1000.0, 16, 13),
        (1e5, 12, 6),
        (1e9, 12, 0),
    ] {
        for bits in 1..=8u32 {
            let source = edges(3, reach);
            let options = SpzOptions {
                fractional_bits: most,
                sh_bits: [bits; 3],
                ..SpzOptions::default()
            };
            let codes = SpzCodes::nearest(&source, &options);
            assert_eq!(codes.fractional_bits, taken, "±{reach}");
            let sh_most = 1.0 - 2f32.powi(1 - bits as i32);
            let mut wanted = clamped(&source, Axes::RUB, sh_most);
            for mean in wanted.mean.as_flattened_mut() {
                *mean = mean.clamp(-8_388_608.0, 8_388_608.0);
            }
            // The greatest code is one less than the least.
            let mut bounds = half_steps(taken as i32, bits as i32, 0.0);
            bounds.mean *= if taken == 0 { 2.0 } else { 1.0 };
            assert_close(&codes.decode(), &wanted, bounds, &format!("±{reach}, {bits} bits"));
        }
    }
}

#[test]
fn bits_of_harmonics_are_those_of_their_band() {
    let codes = SpzCodes::nearest(&edges(3, 100.0), &SpzOptions::default());
    assert_eq!(codes.sh_stride(), 45);
    for row in codes.sh.chunks_exact(45) {
        assert!(row[..9].iter().all(|code| code % 8 == 0));
        assert!(row[9..].iter().all(|code| code % 16 == 0));
    }
    assert!(
        codes
            .sh
            .chunks_exact(45)
            .any(|row| row[..9].iter().any(|code| code % 16 != 0))
    );
}

#[test]
fn our_files_read_back_as_their_codes_decode() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.spz");
    for degree in 0..=3 {
        for name in ["RUB", "RDF", "LUF", "RBD"] {
            let axes = Axes::parse(name).unwrap();
            let options = SpzOptions {
                axes,
                ..SpzOptions::default()
            };
            let codes = SpzCodes::nearest(&edges(degree, 2048.0), &options);
            let wanted = codes.decode();
            assert!(wanted.len() == 64 && !wanted.is_empty() && codes.len() == 64);
            codes.write(&path, SpzVersion::V4, 3).unwrap();
            let loaded = splats::read(&path).unwrap();
            assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
            assert_eq!((loaded.stored.axes, loaded.stored.axes_by), (axes, AxesBy::File));
            assert_eq!(loaded.splats, wanted, "{name} of degree {degree}");
            let bytes = std::fs::read(&path).unwrap();
            assert_eq!(
                bytes,
                codes.bytes(SpzVersion::V4, 3).unwrap(),
                "equal codes, equal files"
            );
            let streams = codes.stream_bytes(3).unwrap();
            let present = if degree == 0 { 5 } else { 6 };
            assert_eq!(streams.iter().sum::<usize>() + 44 + 16 * present, bytes.len());
            codes.write(&path, SpzVersion::V3, 9).unwrap();
            let loaded = splats::read_in_axes(&path, Some(axes)).unwrap();
            assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
            assert_eq!(loaded.stored.format, "SPZ 3");
            assert_eq!(loaded.splats, wanted, "{name} of degree {degree}");
        }
    }
}

#[test]
fn axes_without_a_value_are_refused_in_version_4() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.spz");
    let axes = Axes::parse("UFR").unwrap();
    let options = SpzOptions {
        axes,
        ..SpzOptions::default()
    };
    let codes = SpzCodes::nearest(&edges(1, 10.0), &options);
    assert!(error_at(codes.write(&path, SpzVersion::V4, 3), &path).contains("no value for the axes UFR"));
    assert!(!path.exists());
    codes.write(&path, SpzVersion::V3, 3).unwrap();
    let loaded = splats::read_in_axes(&path, Some(axes)).unwrap();
    assert_eq!(loaded.splats, codes.decode());
}

#[test]
fn scenes_are_written_with_default_options() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.SPZ");
    for source in [edges(2, 10.0), edges(1, 10.0)] {
        splats::write(&path, &source).unwrap();
        let codes = SpzCodes::nearest(&source, &SpzOptions::default());
        assert_eq!(
            std::fs::read(&path).unwrap(),
            codes.bytes(SpzVersion::V4, LEVEL).unwrap()
        );
        assert_eq!(splats::read(&path).unwrap().splats, codes.decode());
    }
    let none = Splats::default();
    splats::write(&path, &none).unwrap();
    let loaded = splats::read(&path).unwrap();
    assert!(loaded.splats.is_empty() && loaded.warnings.concat().contains("holds no splats"));
}

#[test]
fn version_4_has_the_layout_of_the_format() {
    for degree in [0, 2] {
        let codes = SpzCodes::nearest(&edges(degree, 100.0), &SpzOptions::default());
        let bytes = codes.bytes(SpzVersion::V4, 12).unwrap();
        let streams = if degree == 0 { 5 } else { 6 };
        let head = [4, 0, 0, 0, 64, 0, 0, 0, degree as u8, 12, 2, streams, 44, 0, 0, 0];
        assert_eq!(bytes[..4], *b"NGSP");
        assert_eq!(bytes[4..20], head);
        assert_eq!(bytes[20..32], [0; 12]);
        assert_eq!(bytes[32..44], [3, 0, 0xbe, 0xad, 4, 0, 0, 0, 4, 0, 0, 0]);
        let number = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
        let mut at = 44 + 16 * usize::from(streams);
        let mut contents = Vec::new();
        for i in 0..usize::from(streams) {
            let size = number(44 + 16 * i);
            contents.push(zstd::bulk::decompress(&bytes[at..at + size], 1 << 20).unwrap());
            assert_eq!(contents[i].len(), number(52 + 16 * i));
            at += size;
        }
        assert_eq!(at, bytes.len(), "the last frame ends at the end of the file");
        assert_eq!(contents[0][..3], codes.position[0][0].to_le_bytes()[..3]);
        assert_eq!(contents[1], codes.alpha);
        assert_eq!(contents[2], codes.color.as_flattened());
        assert_eq!(contents[3], codes.scale.as_flattened());
        assert_eq!(contents[4][4..8], codes.rotation[1].to_le_bytes());
        assert_eq!(contents.get(5).cloned().unwrap_or_default(), codes.sh);
    }
}

#[test]
fn version_3_is_one_stream_without_extensions() {
    let codes = SpzCodes::nearest(&edges(1, 100.0), &SpzOptions::default());
    let bytes = codes.bytes(SpzVersion::V3, 19).unwrap();
    let mut contents = Vec::new();
    std::io::Read::read_to_end(&mut flate2::read::GzDecoder::new(&*bytes), &mut contents).unwrap();
    assert_eq!(contents.len(), 16 + 64 * (9 + 1 + 3 + 3 + 4 + 9));
    assert_eq!(contents[..16], *b"NGSP\x03\0\0\0\x40\0\0\0\x01\x0c\x01\0");
    assert_eq!(contents[16 + 64 * 20..], codes.sh);
    // No time of writing.
    assert_eq!(bytes[4..8], [0; 4]);
}

#[test]
fn other_roundings_of_harmonics_are_kept() {
    let mut codes = SpzCodes::nearest(&edges(3, 100.0), &SpzOptions::default());
    let mut next = 7u8;
    for code in &mut codes.sh {
        next = next.wrapping_mul(37).wrapping_add(11);
        *code = next;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.spz");
    codes.write(&path, SpzVersion::V4, 3).unwrap();
    let loaded = spz::read(&path).unwrap().splats;
    let row = &loaded.sh[48 + 3..96];
    assert!(
        row.iter()
            .zip(&codes.sh[45..])
            .all(|(v, code)| 128.0 + 128.0 * v == f32::from(*code))
    );
}
