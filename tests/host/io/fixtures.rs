//! Files by independent writers, and comparison of splats within the bounds of a format.

use crate::io::shared;
use ashfall::io::{Source, ply};
use ashfall::scene::{ScreenFilter, Splats, sh_coefficient_count};
use flate2::read::GzDecoder;
use std::io::Read;
use std::path::{Path, PathBuf};

/// A file of `formats` in the shared data and the splats that an independent reader decodes from it, both in the file's
/// axes and order; `None` without shared data.
pub(super) fn fixture(writer: &str, file: &str) -> Option<(PathBuf, Splats)> {
    let path = shared(&format!("formats/{writer}/{file}"))?;
    let expected = shared(&format!("formats/expected/{writer}__{file}.ply.gz"))?;
    Some((path, unpacked(&expected)))
}

/// Splats of a gzipped `.ply`.
pub(super) fn unpacked(path: &Path) -> Splats {
    let mut bytes = Vec::new();
    let file = std::fs::File::open(path).unwrap();
    GzDecoder::new(file).read_to_end(&mut bytes).unwrap();
    ply::read(Source::bytes(path, &bytes)).unwrap().splats
}

/// Largest differences allowed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    /// World units.
    pub(super) mean: f32,
    pub(super) log_scale: f32,
    /// Angle, modulo half turns about the ellipsoid's axes.
    pub(super) rotation_degrees: f64,
    /// Of the opacity itself.
    pub(super) opacity: f32,
    /// Coefficient of degree 0.
    pub(super) color: f32,
    pub(super) sh: f32,
}

impl Bounds {
    /// Rounding of floats.
    pub(super) const EXACT: Bounds = Bounds {
        mean: 1e-6,
        log_scale: 2e-6,
        rotation_degrees: 1e-3,
        opacity: 1e-6,
        color: 1e-5,
        sh: 1e-6,
    };
}

/// Asserts that splats agree, in order, within bounds.
#[track_caller]
pub(super) fn assert_close(found: &Splats, wanted: &Splats, bounds: Bounds, what: &str) {
    assert_eq!(found.len(), wanted.len(), "{what}: splats");
    assert_eq!(found.sh_degree, wanted.sh_degree, "{what}: SH degree");
    let worst = |name: &str, pairs: &mut dyn Iterator<Item = f64>, bound: f64| {
        let (at, value) = pairs.enumerate().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0));
        assert!(
            value <= bound,
            "{what}: {name} differs by {value} at {at}, {bound} allowed"
        );
    };
    let differences =
        |a: &[f32], b: &[f32]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs())).collect() };
    let flat = |v: &Vec<[f32; 3]>| v.concat();
    let means = differences(&flat(&found.mean), &flat(&wanted.mean));
    worst("3 x mean", &mut means.into_iter(), bounds.mean.into());
    let scales = differences(&flat(&found.log_scale), &flat(&wanted.log_scale));
    worst("3 x log-scale", &mut scales.into_iter(), bounds.log_scale.into());
    let sigmoid = |s: &Splats| -> Vec<f32> { s.opacity_logit.iter().map(|l| 1.0 / (1.0 + (-l).exp())).collect() };
    let opacities = differences(&sigmoid(found), &sigmoid(wanted));
    worst("opacity", &mut opacities.into_iter(), bounds.opacity.into());
    let angles = found.quaternion.iter().zip(&wanted.quaternion);
    let mut angles = angles.map(|(a, b)| angle_degrees(a.map(f64::from), b.map(f64::from)));
    worst("rotation", &mut angles, bounds.rotation_degrees);
    let stride = wanted.sh_stride();
    let sh = differences(&found.sh, &wanted.sh);
    let of = |constant: bool| {
        sh.iter()
            .enumerate()
            .filter(move |(i, _)| (i % stride < 3) == constant)
            .map(|(_, d)| *d)
    };
    worst("3 x colour", &mut of(true), bounds.color.into());
    worst("harmonics", &mut of(false), bounds.sh.into());
}

/// Smallest angle between two ellipsoids' rotations.
pub(super) fn angle_degrees(a: [f64; 4], b: [f64; 4]) -> f64 {
    let norm = |q: [f64; 4]| q.map(|v| v / q.iter().map(|v| v * v).sum::<f64>().sqrt());
    let ([w, x, y, z], b) = (norm(a), norm(b));
    let turned = [[w, x, y, z], [-x, w, z, -y], [-y, -z, w, x], [-z, y, -x, w]];
    let cosine = turned.map(|q| q.iter().zip(b).map(|(a, b)| a * b).sum::<f64>().abs());
    2.0 * cosine.into_iter().fold(0.0, f64::max).min(1.0).acos().to_degrees()
}

/// Splats at the edges of formats: each quaternion component largest with both signs, ties, logits of ±12, ±30 and 0,
/// harmonics beyond every range, positions of ±2048; in mip mode.
pub(super) fn edges(degree: u32) -> Splats {
    let mut splats = Splats {
        sh_degree: degree,
        filter: ScreenFilter::Mip,
        ..Splats::default()
    };
    let coefficients = sh_coefficient_count(degree);
    for i in 0..40_usize {
        let wave = |k: usize| ((i * 7 + k * 3) as f32 * 0.37).sin();
        let quaternion = match i {
            0..8 => {
                let mut q = [0.1, -0.2, 0.15, 0.05];
                q[i / 2] = if i % 2 == 0 { 0.9 } else { -0.9 };
                q
            }
            8 => [0.5; 4],
            9 => [-0.5, 0.5, -0.5, 0.5],
            10 => [3.0, -4.0, 12.0, 84.0],
            11 => [0.0, 0.707, 0.707, 0.0],
            12 => [1e-4, 0.6, -0.8, 0.0],
            _ => [wave(1), wave(2), wave(3), wave(4) + 1e-3],
        };
        let edge = |edges: &[f32], usual: f32| edges.get(i).copied().unwrap_or(usual);
        splats.mean.push([
            edge(&[0.0, 1000.0, -1000.0, 2047.9, -2048.0, 1.0 / 4096.0], wave(5)),
            wave(6),
            wave(7) * 3.0,
        ]);
        splats.quaternion.push(quaternion);
        splats.log_scale.push([
            edge(&[-12.0, -9.9, 0.0, 5.9], wave(8) - 3.0),
            wave(9) - 4.0,
            wave(10) - 2.0,
        ]);
        splats
            .opacity_logit
            .push(edge(&[12.0, -12.0, 0.0, 30.0, -30.0], 4.0 * wave(11)));
        let row = i;
        for coefficient in 0..coefficients {
            for channel in 0..3 {
                let value = match (coefficient, row) {
                    (0, 0..4) => [6.0, -6.0, 3.3, -3.3][row],
                    (0, _) => 1.5 * wave(12 + channel),
                    (_, 0..5) => [0.0, 1.0, -1.0, 1.7, -5.0][row],
                    (_, 20..35) if row - 20 == coefficient - 1 => [0.5, -0.25, 0.125][channel],
                    (_, 20..35) => 0.0,
                    _ => 0.3 * wave(coefficient * 3 + channel),
                };
                splats.sh.push(value);
            }
        }
    }
    splats
}
