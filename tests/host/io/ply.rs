//! PLY splats: every degree, every encoding, every truncation.

use crate::io::{error_at, files_in, for_every_prefix};
use ashfall::io::ply;
use ashfall::scene::{Primitive, ScreenFilter, Splats};
use std::fmt::Write as _;
use std::io::Write as _;

/// Splats with distinct numbers, among them special values.
fn example(count: usize, sh_degree: u32, filter: ScreenFilter) -> Splats {
    let mut state = 1u32 + sh_degree;
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / 8_388_608.0 - 1.0
    };
    let mut splats = Splats {
        sh_degree,
        filter,
        ..Splats::default()
    };
    for i in 0..count {
        splats.mean.push([next(), -0.0, 1e-40 * next()]);
        splats
            .quaternion
            .push([next(), 3.0 * next(), next(), f32::MIN_POSITIVE]);
        splats.log_scale.push([f32::MAX, next(), -f32::MAX]);
        splats.opacity_logit.push(next() * i as f32);
        let stride = splats.sh_stride();
        splats.sh.extend((0..stride).map(|_| next()));
    }
    splats
}

fn bits(splats: &Splats) -> Vec<u32> {
    let all = splats.mean.as_flattened().iter();
    let all = all.chain(splats.quaternion.as_flattened());
    let all = all.chain(splats.log_scale.as_flattened());
    let all = all.chain(&splats.opacity_logit).chain(&splats.sh);
    all.map(|v| v.to_bits()).collect()
}

#[test]
fn what_is_written_is_read_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.ply");
    for degree in 0..=3 {
        for filter in [ScreenFilter::Classic, ScreenFilter::Mip] {
            let splats = example(5, degree, filter);
            ply::write(&path, &splats).unwrap();
            let loaded = ply::read(&path).unwrap();
            assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
            assert_eq!(loaded.splats, splats);
            assert_eq!(bits(&loaded.splats), bits(&splats));
        }
    }
    assert_eq!(files_in(folder.path()), ["scene.ply"], "nothing is left behind");
}

#[test]
fn the_layout_is_the_usual_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.ply");
    ply::write(&path, &example(3, 3, ScreenFilter::Mip)).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    let names: Vec<&str> = header
        .lines()
        .filter_map(|line| line.strip_prefix("property float "))
        .collect();
    assert_eq!(names.len(), 62);
    assert_eq!(names[..7], ["x", "y", "z", "nx", "ny", "nz", "f_dc_0"]);
    assert_eq!(
        names[53..],
        [
            "f_rest_44",
            "opacity",
            "scale_0",
            "scale_1",
            "scale_2",
            "rot_0",
            "rot_1",
            "rot_2",
            "rot_3"
        ]
    );
    assert!(header.contains("comment SplatRenderMode: mip\n"));
    assert_eq!(bytes.len() - end, 3 * 248, "62 floats a splat");
}

/// Numbers of one splat by property name, in a non-standard order.
fn shuffled(splats: &Splats, i: usize) -> Vec<(String, f32)> {
    let sh = &splats.sh[i * splats.sh_stride()..][..splats.sh_stride()];
    let rest = sh.len() / 3 - 1;
    let mut named: Vec<(String, f32)> = vec![("opacity".into(), splats.opacity_logit[i])];
    for k in 0..rest * 3 {
        let (channel, coefficient) = (k / rest, k % rest + 1);
        named.push((format!("f_rest_{k}"), sh[coefficient * 3 + channel]));
    }
    named.extend((0..4).map(|k| (format!("rot_{k}"), splats.quaternion[i][k])));
    for (k, axis) in ["x", "y", "z"].into_iter().enumerate().rev() {
        named.push((axis.into(), splats.mean[i][k]));
        named.push((format!("scale_{k}"), splats.log_scale[i][k]));
        named.push((format!("f_dc_{k}"), sh[k]));
    }
    named
}

/// The file of the splats with foreign elements before (one with a list) and a foreign property among theirs.
fn encoded(splats: &Splats, format: &str, kind: &str, line_end: &str) -> Vec<u8> {
    let count = splats.len();
    let mut header = format!(
        "ply\nformat {format} 1.0\ncomment made for a test\nobj_info none\n\
         element camera 2\nproperty double fov\nproperty list uchar short sizes\n\
         element empty 0\nproperty float nothing\nelement vertex {count}\n"
    );
    for (at, (name, _)) in shuffled(splats, 0).iter().enumerate() {
        if at == 2 {
            header += "property ushort label\n";
        }
        writeln!(header, "property {kind} {name}").unwrap();
    }
    header += "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    let mut file = header.replace('\n', line_end).into_bytes();
    let text = format == "ascii";
    let mut put = |bytes: &[u8], word: String| {
        if text {
            write!(file, "{word} ").unwrap();
        } else if format == "binary_big_endian" {
            file.extend(bytes.iter().rev());
        } else {
            file.extend(bytes);
        }
    };
    let newline = |put: &mut dyn FnMut(&[u8], String)| put(&[], line_end.to_owned());
    for sizes in [vec![4i16, -5], vec![]] {
        put(&1.5f64.to_le_bytes(), "1.5".into());
        put(&[sizes.len() as u8], sizes.len().to_string());
        for size in sizes {
            put(&size.to_le_bytes(), size.to_string());
        }
        newline(&mut put);
    }
    for i in 0..count {
        for (at, (_, value)) in shuffled(splats, i).into_iter().enumerate() {
            if at == 2 {
                put(&7u16.to_le_bytes(), "7".into());
            }
            match kind {
                "float" => put(&value.to_le_bytes(), value.to_string()),
                _ => put(&f64::from(value).to_le_bytes(), f64::from(value).to_string()),
            }
        }
        newline(&mut put);
    }
    file
}

#[test]
fn every_encoding_order_and_type_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.ply");
    for degree in 0..=3 {
        let splats = example(4, degree, ScreenFilter::Classic);
        for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
            for kind in ["float", "double", "float32", "float64"] {
                let kind_stored = if kind.ends_with("64") { "double" } else { kind };
                let stored = if kind == "float32" { "float" } else { kind_stored };
                for line_end in ["\n", "\r\n"] {
                    std::fs::write(&path, encoded(&splats, format, stored, line_end)).unwrap();
                    let loaded = ply::read(&path).unwrap();
                    assert_eq!(bits(&loaded.splats), bits(&splats), "{format} {kind} {degree}");
                    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
                }
            }
        }
    }
}

#[test]
fn a_file_cut_anywhere_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.ply");
    let splats = example(2, 1, ScreenFilter::Classic);
    ply::write(&path, &splats).unwrap();
    let contents = std::fs::read(&path).unwrap();
    for_every_prefix(
        &contents,
        &path,
        |path| ply::read(path),
        |_, result| {
            error_at(result, &path);
        },
    );
    // Text, lists and foreign elements: a prefix may be a valid file by chance, but never with more splats.
    for format in ["ascii", "binary_big_endian"] {
        let contents = encoded(&splats, format, "float", "\n");
        for_every_prefix(
            &contents,
            &path,
            |path| ply::read(path),
            |_, result| match result {
                Ok(loaded) => assert_eq!(loaded.splats.len(), 2),
                Err(error) => assert!(error.to_string().contains("scene.ply")),
            },
        );
    }
}

#[test]
fn no_damage_to_the_header_is_fatal() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.ply");
    let contents = encoded(
        &example(1, 0, ScreenFilter::Classic),
        "binary_little_endian",
        "float",
        "\n",
    );
    let header = contents.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    for at in 0..header {
        for byte in [b'\n', b' ', b'9', b'-', 0, 0xff] {
            let mut damaged = contents.clone();
            damaged[at] = byte;
            std::fs::write(&path, damaged).unwrap();
            // Some damage is harmless, as in a comment; required is only that reading terminates.
            if let Ok(loaded) = ply::read(&path) {
                assert!(loaded.splats.len() <= 1);
            }
        }
    }
}

#[test]
fn the_last_comment_on_the_mode_wins() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.ply");
    ply::write(&path, &example(1, 0, ScreenFilter::Mip)).unwrap();
    let text = |from: &str, to: &str| {
        let bytes = std::fs::read(&path).unwrap();
        let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
        [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
    };
    let mip = "comment SplatRenderMode: mip\n";
    let other = folder.path().join("other.ply");
    let mode_of = |comment: &str| {
        std::fs::write(&other, text(mip, comment)).unwrap();
        ply::read(&other)
    };
    let loaded = mode_of("comment SplatRenderMode: mip\ncomment antialiased 0\n").unwrap();
    assert_eq!(loaded.splats.filter, ScreenFilter::Classic);
    assert_eq!(
        mode_of("comment antialiased 1\n").unwrap().splats.filter,
        ScreenFilter::Mip
    );
    assert_eq!(mode_of("").unwrap().splats.filter, ScreenFilter::Classic);
    let unknown = mode_of("comment SplatRenderMode: future\n").unwrap();
    assert!(unknown.warnings[0].contains("\"future\""), "{:?}", unknown.warnings);
    let surfels = mode_of("comment SplatRenderMode: 2dgs\n").unwrap().splats;
    assert_eq!(
        (surfels.primitive, surfels.filter),
        (Primitive::Surfel, ScreenFilter::Classic)
    );
}

/// Surfels with ordinary numbers.
fn surfels(count: usize, filter: ScreenFilter) -> Splats {
    let mut splats = example(count, 1, filter);
    splats.primitive = Primitive::Surfel;
    for (i, log_scale) in splats.log_scale.iter_mut().enumerate() {
        *log_scale = [-1.0 - i as f32, -2.0 + 0.5 * i as f32, 0.0];
    }
    splats.set_thickness();
    splats
}

#[test]
fn surfels_have_two_scales_and_their_normals() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.ply");
    for filter in [ScreenFilter::Classic, ScreenFilter::Mip] {
        let splats = surfels(7, filter);
        ply::write(&path, &splats).unwrap();
        assert_eq!(std::fs::metadata(&path).unwrap().len(), ply::byte_count(&splats));
        let loaded = ply::read(&path).unwrap();
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
        assert_eq!(loaded.splats, splats);
        assert_eq!(bits(&loaded.splats), bits(&splats));
        let bytes = std::fs::read(&path).unwrap();
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        let header = std::str::from_utf8(&bytes[..end]).unwrap();
        assert!(header.contains("comment SplatRenderMode: 2dgs\n"));
        assert!(header.contains("scale_1") && !header.contains("scale_2"));
        let row: &[u8] = &bytes[end..];
        let number = |i: usize| f32::from_le_bytes(row[4 * i..4 * i + 4].try_into().unwrap());
        let normal = glam::Vec3::new(number(3), number(4), number(5));
        let [w, x, y, z] = splats.quaternion[0];
        let axes = glam::Mat3::from_quat(glam::Quat::from_xyzw(x, y, z, w).normalize());
        assert!((normal - axes.z_axis).length() < 1e-6, "{normal}");
    }
}

#[test]
fn flat_files_of_other_programs_are_surfels_and_say_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.ply");
    let mut splats = surfels(5, ScreenFilter::Classic);
    splats.primitive = Primitive::Gaussian3d;
    let read = |splats: &Splats, stated: bool| {
        ply::write(&path, splats).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let comment = b"comment SplatRenderMode: default\n";
        let at = bytes.windows(comment.len()).position(|w| w == comment).unwrap();
        let kept = if stated { at + comment.len() } else { at };
        std::fs::write(&path, [&bytes[..kept], &bytes[at + comment.len()..]].concat()).unwrap();
        ply::read(&path).unwrap()
    };
    // A hundredth, as exported, is thick; a millionth of the larger scale, and nothing at all, are flat.
    assert_eq!(read(&splats, false).splats.primitive, Primitive::Gaussian3d);
    for third in [-21.0, f32::NEG_INFINITY] {
        splats.log_scale.iter_mut().for_each(|s| s[2] = third);
        let loaded = read(&splats, false);
        assert_eq!(loaded.splats.primitive, Primitive::Surfel, "{third}");
        assert!(loaded.warnings[0].contains("2D Gaussians"), "{:?}", loaded.warnings);
        assert!(
            loaded
                .splats
                .log_scale
                .iter()
                .all(|s| s[2].is_finite() && s[2] < s[0].min(s[1]))
        );
        assert_eq!(
            read(&splats, true).splats.primitive,
            Primitive::Gaussian3d,
            "it states otherwise"
        );
    }
    splats.log_scale[3][2] = -3.0;
    assert_eq!(
        read(&splats, false).splats.primitive,
        Primitive::Gaussian3d,
        "one is not flat"
    );
}

#[test]
fn surfels_become_thin_splats_elsewhere() {
    let folder = tempfile::tempdir().unwrap();
    let splats = surfels(5, ScreenFilter::Classic);
    for name in [
        "scene.spz",
        "scene.splat",
        "scene.compressed.ply",
        "scene.glb",
        "scene.sog",
    ] {
        let path = folder.path().join(name);
        let lost = ashfall::io::splats::losses(&path, &splats);
        assert!(lost.iter().any(|l| l.contains("surfels")), "{name}: {lost:?}");
        ashfall::io::splats::write(&path, &splats).unwrap();
        let loaded = ashfall::io::splats::read(path.as_path()).unwrap().splats;
        assert_eq!(loaded.primitive, Primitive::Gaussian3d);
        let thinness = |s: &[f32; 3]| s[2] - s[0].min(s[1]);
        let off = loaded.log_scale.iter().map(|s| (thinness(s) - 0.01_f32.ln()).abs());
        assert!(off.fold(0.0, f32::max) < 0.1, "{name}: {:?}", loaded.log_scale);
    }
    let path = folder.path().join("scene.ply");
    assert!(ashfall::io::splats::losses(&path, &splats).is_empty());
}

#[test]
fn the_upward_direction_is_a_comment() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.ply");
    let mut splats = example(3, 0, ScreenFilter::Classic);
    let plain = ply::byte_count(&splats);
    splats.up = Some(glam::DVec3::new(0.1, -0.99, 1.0 / 3.0));
    ply::write(&path, &splats).unwrap();
    assert_eq!(ply::read(&path).unwrap().splats, splats);
    let line = "comment SplatUp: 0.1 -0.99 0.3333333333333333\n";
    assert_eq!(ply::byte_count(&splats) - plain, line.len() as u64);
    let bytes = std::fs::read(&path).unwrap();
    let at = bytes.windows(line.len()).position(|w| w == line.as_bytes()).unwrap();
    for (comment, fault) in [
        ("0 nan 1", "not three numbers"),
        ("0 1", "not three numbers"),
        ("0 0 0", "no length"),
    ] {
        let changed = format!("comment SplatUp: {comment}\n");
        std::fs::write(
            &path,
            [&bytes[..at], changed.as_bytes(), &bytes[at + line.len()..]].concat(),
        )
        .unwrap();
        let text = error_at(ply::read(&path), &path);
        assert!(text.contains("upward direction") && text.contains(fault), "{text}");
    }
}
