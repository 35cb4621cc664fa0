//! SH degree reduction of each splat within a proven colour error.
//!
//! A colour is a sum over degrees l of c_l · Y_l(direction), with c_l the 2l + 1 coefficients of a channel. By
//! Cauchy–Schwarz and the addition theorem, Σ_m Y_lm² = (2l + 1) / 4π in every direction, and
//! |c_l · Y_l| ≤ ‖c_l‖ √((2l + 1) / 4π). So dropping the degrees above d moves a colour by at most the sum of that over
//! those degrees, in any direction, and pixels, being mixtures of colours, by at most the largest error of their
//! splats. The later clamp of colours at 0 does not increase differences.

use crate::scene::{Splats, sh_coefficient_count};

/// Relative rounding error of colours in `f32` beyond the bound: sixteen terms at 2⁻²⁴ each, of sums a hundred times as
/// large as the dropped part.
const ROUNDING: f64 = 1e-3;

/// Scene with reduced SH degrees.
#[derive(Clone, Debug, PartialEq)]
pub struct ShReduction {
    /// The scene with dropped coefficients set to zero, stored at the highest remaining degree.
    pub splats: Splats,
    /// SH degree of each splat.
    pub degrees: Vec<u8>,
    /// Number of splats of each degree.
    pub count_from_degree: [usize; 4],
    /// Floats of all splats' coefficients at their own degrees.
    pub floats: usize,
}

/// Drops the highest SH degrees of every splat while no channel moves by more than `error` in any direction. At an
/// error of 0 only zero coefficients are dropped.
pub fn reduce_harmonics(splats: &Splats, error: f64) -> ShReduction {
    let error = error * (1.0 - ROUNDING);
    let stride = splats.sh_stride();
    let mut sh = splats.sh.clone();
    let mut count_from_degree = [0; 4];
    let mut degrees = Vec::with_capacity(splats.len());
    let mut floats = 0;
    for row in sh.chunks_exact_mut(stride) {
        let degree = degree_needed(row, splats.sh_degree, error);
        let needed = 3 * sh_coefficient_count(degree);
        row[needed..].fill(0.0);
        count_from_degree[degree as usize] += 1;
        degrees.push(degree as u8);
        floats += needed;
    }
    let highest = count_from_degree.iter().rposition(|&count| count > 0);
    let sh_degree = highest.unwrap_or(0) as u32;
    let kept = 3 * sh_coefficient_count(sh_degree);
    let rows = sh.chunks_exact(stride).flat_map(|row| &row[..kept]);
    ShReduction {
        splats: Splats {
            sh: rows.copied().collect(),
            sh_degree,
            ..splats.clone()
        },
        degrees,
        count_from_degree,
        floats,
    }
}

/// Lowest degree that `row`, `[coefficient][rgb]`, can be cut to.
fn degree_needed(row: &[f32], sh_degree: u32, error: f64) -> u32 {
    let mut off = [0.0; 3];
    for degree in (1..=sh_degree).rev() {
        for (channel, off) in off.iter_mut().enumerate() {
            *off += band_bound(row, degree, channel);
        }
        // NaN stays, unrepaired.
        if !off.iter().all(|&off| off <= error) {
            return degree;
        }
    }
    0
}

/// Upper bound of one degree's part of a channel: ‖c_l‖ √((2l + 1) / 4π).
fn band_bound(row: &[f32], degree: u32, channel: usize) -> f64 {
    let band = degree.pow(2) as usize..(degree + 1).pow(2) as usize;
    let squares = band.map(|k| f64::from(row[3 * k + channel]).powi(2));
    let constant = f64::from(2 * degree + 1) / (4.0 * std::f64::consts::PI);
    (squares.sum::<f64>() * constant).sqrt()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Splats of degree 3 with these coefficients.
    pub(in crate::simplify) fn scene(rows: &[[f32; 48]]) -> Splats {
        let count = rows.len();
        Splats {
            mean: vec![[0.0; 3]; count],
            quaternion: vec![[1.0; 4]; count],
            log_scale: vec![[0.0; 3]; count],
            opacity_logit: vec![0.0; count],
            sh: rows.concat(),
            sh_degree: 3,
            ..Splats::default()
        }
    }

    /// A row with `value` in the last coefficient of each degree up to `degree`.
    fn row(degree: usize, value: f32) -> [f32; 48] {
        let mut row = [0.0; 48];
        (0..=degree).for_each(|l| row[3 * ((l + 1).pow(2) - 1)] = value);
        row
    }

    #[test]
    fn every_splat_gets_the_degree_it_needs() {
        let degrees = [0, 3, 1, 2, 3];
        let scene = scene(&degrees.map(|degree| row(degree, 0.5)));
        let reduced = reduce_harmonics(&scene, 0.01);
        assert_eq!(reduced.degrees, degrees.map(|degree| degree as u8));
        assert_eq!(reduced.count_from_degree, [1, 1, 1, 2]);
        assert_eq!(reduced.floats, 3 * (1 + 4 + 9 + 16 + 16));
        assert_eq!(reduced.splats, scene);
    }

    #[test]
    fn a_scene_without_view_dependence_ends_at_degree_0() {
        let rows = [row(3, 1e-4), row(0, 0.5), row(2, 1e-3)];
        let reduced = reduce_harmonics(&scene(&rows), 0.01);
        assert_eq!(reduced.count_from_degree, [3, 0, 0, 0]);
        assert_eq!((reduced.splats.sh_degree, reduced.splats.sh.len()), (0, 9));
        assert_eq!(reduced.splats.sh[3], 0.5);
    }

    #[test]
    fn bounds_add_up_over_degrees_and_end_where_the_error_is() {
        // 0.5 in degree 3 contributes at most 0.5 √(7 / 4π) = 0.3732, in degree 2 0.3154, in degree 1 0.2443.
        let scene = scene(&[row(3, 0.5)]);
        let needed = |error| {
            let counts = reduce_harmonics(&scene, error).count_from_degree;
            counts.iter().position(|&count| count > 0)
        };
        assert_eq!([0.373, 0.374, 0.689, 0.69].map(needed), [3, 2, 2, 1].map(Some));
        assert_eq!([0.932, 0.934].map(needed), [1, 0].map(Some));
    }

    #[test]
    fn what_is_no_number_is_left_alone() {
        let mut rows = [row(1, 0.0)];
        rows[0][40] = f32::NAN;
        let reduced = reduce_harmonics(&scene(&rows), 1.0);
        assert_eq!(reduced.count_from_degree, [0, 0, 0, 1]);
        assert!(reduced.splats.sh[40].is_nan());
        let nothing = reduce_harmonics(&scene(&[]), 1.0);
        assert_eq!((nothing.splats.sh_degree, nothing.floats), (0, 0));
    }
}
