//! Compressed `.ply` scenes: files of independent writers, our own, and damaged ones.

use crate::io::fixtures::{Bounds, assert_close, edges, fixture};
use crate::io::{error_at, for_every_prefix};
use ashfall::io::ply;
use ashfall::io::ply::compressed::{self, CompressedPlyCodes};
use ashfall::scene::{ScreenFilter, Splats};
use std::path::Path;

#[test]
fn files_of_other_writers_decode() {
    let writers = [
        ("splat-transform-3.7.0", &["sh0", "sh0_mip", "sh1", "sh2"][..]),
        ("gsply-0.4.6", &["sh0", "sh2"]),
    ];
    for (writer, scenes) in writers {
        for scene in scenes {
            let file = format!("playbot600_{scene}.compressed.ply");
            let Some((path, wanted)) = fixture(writer, &file) else {
                return;
            };
            let found = ply::read(&path).unwrap();
            assert_eq!(found.stored.format, "compressed PLY");
            assert_eq!(
                found.splats.filter == ScreenFilter::Mip,
                scene.ends_with("mip"),
                "{file}"
            );
            let bounds = Bounds {
                // Opacities of bytes 0 and 255 stand for the middle of their interval.
                opacity: 0.25 / 255.0 + 1e-6,
                ..Bounds::EXACT
            };
            assert_close(&found.splats, &wanted, bounds, &file);
        }
    }
}

/// Splats in the order of the codes.
fn ordered(splats: &Splats) -> Splats {
    let order = ashfall::scene::kd_order(&splats.mean, 256);
    splats.picked(&order.iter().map(|&i| i as usize).collect::<Vec<_>>())
}

fn written(codes: &CompressedPlyCodes, path: &Path) -> Splats {
    codes.write(path).unwrap();
    assert_eq!(std::fs::metadata(path).unwrap().len(), codes.byte_count());
    let loaded = ply::read(path).unwrap();
    assert_eq!(loaded.warnings, Vec::<String>::new());
    loaded.splats
}

#[test]
fn codes_are_nearest_and_survive_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.compressed.ply");
    for degree in 0..=3 {
        let mut splats = edges(degree);
        splats.up = Some(glam::DVec3::new(0.0, -0.6, 0.8));
        let codes = CompressedPlyCodes::nearest(&splats);
        let found = written(&codes, &path);
        assert_eq!(found, codes.decode());
        assert_eq!([found.filter, splats.filter], [ScreenFilter::Mip; 2]);
        assert_eq!((found.origin, found.up), (splats.origin, splats.up));
        // Half steps: ranges of 2,000 units at 10 bits, of 20 at 10 bits, of 3.4 at 8 bits; 8-bit opacity; 10-bit
        // quaternions of √2; harmonics within ±4.
        let bounds = Bounds {
            mean: 4096.0 / 1023.0 / 2.0 * 1.001,
            log_scale: 19.0 / 1023.0 / 2.0 * 1.01,
            rotation_degrees: 0.2,
            opacity: 0.5 / 255.0 + 1e-6,
            color: 12.0 / 255.0 / 2.0 * 1.01,
            sh: 1.0 / 64.0 + 1e-6,
        };
        let mut wanted = ordered(&splats);
        wanted.sh.iter_mut().for_each(|v| *v = v.clamp(-6.0, 6.0));
        let stride = wanted.sh_stride();
        for (i, v) in wanted.sh.iter_mut().enumerate() {
            *v = if i % stride < 3 { *v } else { v.clamp(-4.0, 4.0) };
        }
        assert_close(&found, &wanted, bounds, "edges");
    }
}

#[test]
fn empty_bands_are_left_out() {
    let mut splats = edges(3);
    let stride = splats.sh_stride();
    splats.sh.iter_mut().enumerate().for_each(|(i, v)| {
        if i % stride >= 12 {
            *v = 0.0;
        }
    });
    assert_eq!(CompressedPlyCodes::nearest(&splats).scene.sh_degree, 1);
    splats.sh.iter_mut().enumerate().for_each(|(i, v)| {
        if i % stride >= 3 {
            *v = 0.0;
        }
    });
    assert_eq!(CompressedPlyCodes::nearest(&splats).scene.sh_degree, 0);
    let nothing = CompressedPlyCodes::nearest(&Splats::default());
    assert_eq!(nothing.decode(), Splats::default());
}

#[test]
fn damage_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.compressed.ply");
    compressed::write(&path, &edges(1)).unwrap();
    let whole = std::fs::read(&path).unwrap();
    for_every_prefix(
        &whole,
        &path,
        |p| ply::read(p),
        |length, result| {
            assert!(result.is_err(), "{length} bytes of {} are a scene", whole.len());
        },
    );
    let end = b"end_header\n";
    let at = whole.windows(end.len()).position(|w| w == end).unwrap();
    let header = String::from_utf8(whole[..at].to_vec()).unwrap();
    for (from, to, words) in [
        ("element chunk 1\n", "element chunk 2\n", "2 chunks of 256 splats"),
        ("element chunk 1\n", "element chunk 0\n", "0 chunks of 256 splats"),
        (
            "element chunk 1\n",
            "element chunk 9999999999999\n",
            "9999999999999 chunks",
        ),
        ("element vertex", "element vertices", "no element \"vertex\""),
        (
            "uint packed_scale",
            "float packed_scale",
            "no property \"packed_scale\" of type uint",
        ),
        ("packed_color", "packed_colour", "no property \"packed_color\""),
        (
            "float min_x",
            "list uchar float min_x",
            "no property \"min_x\" of type float",
        ),
        ("float max_b", "double max_b", "no property \"max_b\" of type float"),
        ("uchar f_rest_8\n", "uchar other\n", "8 f_rest properties"),
        ("uchar f_rest_8\n", "uchar f_rest_9\n", "no property \"f_rest_8\""),
        (
            "uchar f_rest_8\n",
            "uchar f_rest_8\nproperty list uchar uchar more\n",
            "\"more\" is a list",
        ),
    ] {
        assert!(header.contains(from), "{from}");
        let mut bytes = header.replacen(from, to, 1).into_bytes();
        bytes.extend(&whole[at..]);
        std::fs::write(&path, &bytes).unwrap();
        let text = error_at(ply::read(&path), &path);
        assert!(text.contains(words), "{from}: {text}");
    }
}
