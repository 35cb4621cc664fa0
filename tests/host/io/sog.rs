//! SOG bundles and folders: files of independent writers, and quantisation. `sog_faults` has the damaged files.

use crate::io::fixtures::{Bounds, angle_degrees, assert_close, fixture, unpacked};
use crate::io::{error_at, files_in, shared};
use crate::noise::noise;
use ashfall::io::sog::{SogCodes, SogOptions};
use ashfall::io::{Source, ply, sog, splats};
use ashfall::scene::{ScreenFilter, Splats, sh_coefficient_count};
use glam::DVec3;
use std::path::Path;

/// The expected opacities of bytes 0 and 255 are 1e-6 from the ends, ours a quarter of a step.
const BOUNDS: Bounds = Bounds {
    opacity: 0.26 / 255.0,
    ..Bounds::EXACT
};

#[test]
fn files_of_splat_transform_decode() {
    for name in [
        "playbot600_sh0",
        "playbot600_sh0_mip",
        "playbot600_sh1",
        "playbot600_sh2",
    ] {
        let Some((path, wanted)) = fixture("splat-transform-3.7.0", &format!("{name}.sog")) else {
            return;
        };
        let loaded = splats::read(&path).unwrap();
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
        assert_eq!(loaded.stored.format, "SOG 2");
        assert_eq!(loaded.splats.filter == ScreenFilter::Mip, name.ends_with("mip"));
        assert_close(&loaded.splats, &wanted, BOUNDS, name);
    }
}

#[test]
fn folders_decode_from_their_list() {
    for (folder, expected, format) in [
        (
            "splat-transform-3.7.0/playbot600_sh1_folder",
            "splat-transform-3.7.0__playbot600_sh1_folder",
            "SOG 2",
        ),
        (
            "handmade/playbot576_sh2_sogv1",
            "handmade__playbot576_sh2_sogv1",
            "SOG 1",
        ),
    ] {
        let Some(path) = shared(&format!("formats/{folder}/meta.json")) else {
            return;
        };
        let wanted = unpacked(&shared(&format!("formats/expected/{expected}.ply.gz")).unwrap());
        let loaded = splats::read(&path).unwrap();
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
        assert_eq!(loaded.stored.format, format);
        assert_close(&loaded.splats, &wanted, BOUNDS, folder);
    }
}

/// The bundle, its folder and a float file hold one scene.
#[test]
fn a_whole_scene_decodes_from_bundle_and_folder() {
    let Some(folder) = shared("splats/playbot") else {
        return;
    };
    let bundle = splats::read(&folder.join("playbot.sog")).unwrap().splats;
    let unbundled = splats::read(&folder.join("sog_unbundled/meta.json")).unwrap().splats;
    assert_eq!(bundle, unbundled);
    assert_eq!((bundle.len(), bundle.sh_degree), (8406, 2));
}

/// Scene of `count` splats with positions on both sides of zero and beyond one, as the logarithm needs.
fn scene(count: usize, sh_degree: u32) -> Splats {
    let mut noise = noise();
    let stride = 3 * sh_coefficient_count(sh_degree);
    Splats {
        mean: (0..count).map(|_| [(); 3].map(|()| 4.0 * noise().powi(3))).collect(),
        quaternion: (0..count).map(|_| [(); 4].map(|()| noise())).collect(),
        log_scale: (0..count).map(|_| [(); 3].map(|()| -4.0 + 3.0 * noise())).collect(),
        opacity_logit: (0..count).map(|_| 6.0 * noise()).collect(),
        sh: (0..count * stride).map(|_| noise()).collect(),
        sh_degree,
        ..Splats::default()
    }
}

fn reread(codes: &SogCodes) -> Splats {
    let bytes = codes.bytes().unwrap();
    let loaded = sog::read(Source::bytes(Path::new("scene.sog"), &bytes)).unwrap();
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    loaded.splats
}

fn sigmoid(logit: f32) -> f64 {
    1.0 / (1.0 + (-f64::from(logit)).exp())
}

/// Index in the source of each splat of the codes: source means have distinct codes.
fn order(source: &Splats, codes: &SogCodes) -> Vec<usize> {
    let decoded = codes.decode();
    let distance = |i: usize, mean: [f32; 3]| -> f32 { (0..3).map(|k| (source.mean[i][k] - mean[k]).powi(2)).sum() };
    let nearest = |mean: &[f32; 3]| {
        let nearer = |a: &usize, b: &usize| distance(*a, *mean).total_cmp(&distance(*b, *mean));
        (0..source.len()).min_by(nearer).unwrap()
    };
    let order: Vec<usize> = decoded.mean.iter().map(nearest).collect();
    let mut sorted = order.clone();
    sorted.sort_unstable();
    assert_eq!(sorted, (0..source.len()).collect::<Vec<_>>(), "every splat once");
    order
}

/// Half the widest gap between neighbouring values: the error of rounding to the nearest, inside the range.
fn half_gap(codebook: &[f32]) -> f32 {
    let gaps = codebook.windows(2).map(|pair| pair[1] - pair[0]);
    gaps.fold(0.0, f32::max) / 2.0
}

#[test]
fn attributes_are_within_half_a_step() {
    for (count, degree) in [(7, 0), (250, 1), (601, 2), (1027, 3)] {
        let source = scene(count, degree);
        let codes = SogCodes::quantise(&source, &SogOptions::default());
        let decoded = codes.decode();
        assert_eq!(reread(&codes), decoded, "{count} splats of degree {degree}");
        let source = source.picked(&order(&source, &codes));
        let each = |i: usize| {
            let what = format!("splat {i} of {count}");
            for axis in 0..3 {
                // |dv/dt| = e^|t| = 1 + |v|; codes are half a step of t from their value, and f32 rounds.
                let step = (codes.mean_max[axis] - codes.mean_min[axis]) / 65_535.0;
                let [wanted, found] = [source.mean[i][axis], decoded.mean[i][axis]].map(f64::from);
                let bound = 0.501 * step * (1.0 + wanted.abs()) * (1.0 + step) + 1e-6;
                assert!((wanted - found).abs() <= bound, "{what}: mean {found}, not {wanted}");
                let off = (source.log_scale[i][axis] - decoded.log_scale[i][axis]).abs();
                assert!(
                    off <= half_gap(&codes.scale_codebook).max(0.05),
                    "{what}: scale is off by {off}"
                );
            }
            let opacity = (sigmoid(source.opacity_logit[i]) - sigmoid(decoded.opacity_logit[i])).abs();
            assert!(opacity <= 0.5001 / 255.0, "{what}: opacity is off by {opacity}");
            let stride = source.sh_stride();
            for channel in 0..3 {
                let off = (source.sh[i * stride + channel] - decoded.sh[i * stride + channel]).abs();
                assert!(
                    off <= half_gap(&codes.color_codebook).max(0.02),
                    "{what}: colour is off by {off}"
                );
            }
            let [a, b] = [source.quaternion[i], decoded.quaternion[i]].map(|q| q.map(f64::from));
            angle_degrees(a, b)
        };
        let mut angles: Vec<f64> = (0..count).map(each).collect();
        angles.sort_by(f64::total_cmp);
        // Three components are off by half of √2 / 255 at most, the largest by at most three times that: 0.0096 in all,
        // and an angle is twice the distance.
        let (median, most) = (angles[count / 2], angles[count - 1]);
        assert!(most < (2.0f64 * 0.0097).to_degrees(), "largest angle {most}°");
        assert!(count < 200 || median < 0.36, "median angle {median}°");
    }
}

/// Palettes with an entry for every splat lose only the rounding of their numbers.
#[test]
fn harmonics_are_close_if_the_palette_is_large() {
    for degree in 1..=3 {
        let source = scene(300, degree);
        let codes = SogCodes::quantise(&source, &SogOptions::default());
        let decoded = codes.decode();
        let source = source.picked(&order(&source, &codes));
        let palette = codes.palette.as_ref().unwrap();
        assert_eq!(palette.entries(), 300);
        let bound = half_gap(&palette.codebook).max(0.02);
        for (wanted, found) in source.sh.iter().zip(&decoded.sh) {
            assert!((wanted - found).abs() <= bound, "{found}, not {wanted}");
        }
    }
}

/// 4,096 vectors in 64 clouds, by 64 entries: each cloud has its own, and the error is that of the clouds alone.
#[test]
fn palettes_find_clouds() {
    let mut source = scene(4096, 1);
    let mut noise = noise();
    let centers: Vec<Vec<f32>> = (0..64).map(|_| (0..9).map(|_| noise()).collect()).collect();
    let mut wanted = 0.0;
    for (i, sh) in source.sh.chunks_exact_mut(12).enumerate() {
        for (value, center) in sh[3..].iter_mut().zip(&centers[i % 64]) {
            let off = 0.02 * noise();
            wanted += f64::from(off).powi(2);
            *value = center + off;
        }
    }
    let options = SogOptions {
        palette_entries: Some(64),
        weights: None,
    };
    let codes = SogCodes::quantise(&source, &options);
    assert_eq!(codes.palette.as_ref().unwrap().entries(), 64);
    let decoded = codes.decode();
    let source = source.picked(&order(&source, &codes));
    let rows = source.sh.chunks_exact(12).zip(decoded.sh.chunks_exact(12));
    let errors = rows.flat_map(|(a, b)| (3..12).map(|k| f64::from(a[k] - b[k]).powi(2)));
    let found: f64 = errors.sum();
    assert!(found < 1.1 * wanted, "{found} of {wanted}");
}

#[test]
fn weights_favour_important_splats() {
    let source = scene(2000, 1);
    let weights: Vec<f32> = (0..2000).map(|i| if i % 8 == 0 { 1.0 } else { 0.0 }).collect();
    let error = |weights: Option<&[f32]>| -> f64 {
        let options = SogOptions {
            palette_entries: Some(256),
            weights,
        };
        let codes = SogCodes::quantise(&source, &options);
        let (decoded, order) = (codes.decode(), order(&source, &codes));
        let important = order.iter().enumerate().filter(|(_, i)| *i % 8 == 0);
        let squares = important.flat_map(|(at, &i)| {
            let [a, b] = [&source.sh[12 * i..12 * (i + 1)], &decoded.sh[12 * at..12 * (at + 1)]];
            a.iter()
                .zip(b)
                .map(|(a, b)| f64::from(a - b).powi(2))
                .collect::<Vec<_>>()
        });
        squares.sum()
    };
    let (equal, weighted) = (error(None), error(Some(&weights)));
    assert!(weighted < 0.1 * equal, "{weighted} with weights, {equal} without");
}

#[test]
fn unusual_scenes_survive() {
    let mut equal = scene(1, 3);
    equal = equal.picked(&[0; 13]);
    let mut faint = scene(9, 0);
    faint.opacity_logit = vec![(1.0f32 / 254.0).ln(); 9];
    let mut far = scene(200, 1);
    far.mean[7] = [3e9, -1e12, 0.0];
    far.log_scale[7] = [-23.0, 30.0, 0.0];
    let mut mip = scene(5, 0);
    mip.filter = ScreenFilter::Mip;
    let unturned = Splats {
        quaternion: vec![[0.0; 4]],
        ..scene(1, 0)
    };
    let mut extreme = scene(300, 2);
    for (i, sign) in [(4, 1.0), (5, -1.0)] {
        extreme.mean[i] = [f32::MAX * sign, f32::MIN_POSITIVE, 1e-45];
        extreme.log_scale[i] = [f32::MAX * sign, 0.0, 1e-45];
        extreme.quaternion[i] = [f32::MAX, -f32::MAX, 1e-45, 0.0];
        extreme.opacity_logit[i] = f32::MAX * sign;
        extreme.sh[27 * i..27 * (i + 1)].fill(f32::MAX * sign);
    }
    for (what, source) in [
        ("one", scene(1, 3)),
        ("extreme", extreme),
        ("equal", equal),
        ("faint", faint.clone()),
        ("far", far.clone()),
        ("mip", mip),
        ("seventeen", scene(17, 2)),
        ("unturned", unturned),
    ] {
        let codes = SogCodes::quantise(&source, &SogOptions::default());
        let decoded = codes.decode();
        assert_eq!(decoded, reread(&codes), "{what}");
        assert_eq!(
            (decoded.len(), decoded.filter, decoded.sh_degree),
            (source.len(), source.filter, source.sh_degree),
            "{what}"
        );
        assert!(decoded.not_finite().is_none(), "{what}");
        for (a, b) in source
            .log_scale
            .as_flattened()
            .iter()
            .zip(decoded.log_scale.as_flattened())
        {
            assert!(source.len() > 1 || (a - b).abs() < 1e-3, "{what}: {a}, {b}");
        }
    }
    let decoded = SogCodes::quantise(&faint, &SogOptions::default()).decode();
    assert!(
        decoded
            .opacity_logit
            .iter()
            .all(|l| (sigmoid(*l) - 1.0 / 255.0).abs() < 1e-6)
    );
    let codes = SogCodes::quantise(&far, &SogOptions::default());
    let farthest = codes.decode().mean.iter().map(|mean| mean[1]).fold(0.0, f32::min);
    assert!((farthest / -1e12 - 1.0).abs() < 1e-4, "{farthest}");
}

#[test]
fn splats_that_are_not_finite_are_left_out() {
    let mut source = scene(20, 1);
    source.mean[3][1] = f32::INFINITY;
    source.sh[12 * 8 + 5] = f32::NAN;
    let codes = SogCodes::quantise(&source, &SogOptions::default());
    assert_eq!(codes.len(), 18);
    assert_eq!(reread(&codes), codes.decode());
}

#[test]
fn a_scene_without_splats_is_written_and_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.sog");
    splats::write(&path, &Splats::default()).unwrap();
    let loaded = splats::read(&path).unwrap();
    assert!(loaded.splats.is_empty());
    assert!(loaded.warnings.concat().contains("holds no splats"));
}

#[test]
fn files_are_written_by_name_and_are_the_same_every_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.sog");
    let mut source = scene(100, 2);
    source.origin = DVec3::X;
    let losses = splats::losses(&path, &source);
    assert!(losses.len() == 1 && losses[0].contains("origin"), "{losses:?}");
    splats::write(&path, &source).unwrap();
    let first = std::fs::read(&path).unwrap();
    splats::write(&path, &source).unwrap();
    assert_eq!(first, std::fs::read(&path).unwrap());
    assert_eq!(files_in(folder.path()), ["scene.sog"]);
    // Readers of streams find the list first, and every length in front of its file.
    assert!(first[30..].starts_with(b"meta.json{"));
    assert_eq!(first[6..8], [0, 0], "no flags: lengths stand in the local headers");
    let meta = folder.path().join("meta.json");
    assert!(error_at(splats::write(&meta, &source), &meta).contains("choose such a name"));
}

/// Bytes and errors against those of splat-transform 3.7.0 for the same file: 291,059 bytes, harmonics of 0.0087 (rms).
#[test]
fn the_shared_scene_is_smaller_than_by_its_own_writer() {
    let Some(folder) = shared("splats/playbot") else {
        return;
    };
    let source = splats::read(&folder.join("playbot.sog")).unwrap().splats;
    let codes = SogCodes::quantise(&source, &SogOptions::default());
    let bytes = codes.bytes().unwrap().len();
    assert!(bytes < 270_000, "{bytes} bytes");
    let decoded = codes.decode();
    // The source was itself in such codes, in another order: sums of squares are compared without one.
    let energy = |s: &Splats| -> f64 { s.sh.iter().map(|v| f64::from(*v).powi(2)).sum() };
    let (wanted, found) = (energy(&source), energy(&decoded));
    assert!((found / wanted - 1.0).abs() < 1e-5, "{found}, not {wanted}");
    let exact = folder.join("playbot_inria_sh3.ply");
    assert_eq!(ply::read(&exact).unwrap().splats.len(), decoded.len());
}
