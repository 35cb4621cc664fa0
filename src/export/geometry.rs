//! Scales and opacity of a splat, rounded together.
//!
//! Relative errors e of two standard deviations on the screen and o of the opacity change a splat's picture in
//! proportion to o² + o (e₁ + e₂) + ¾ (e₁² + e₂²) + ½ e₁ e₂, the integral over a Gaussian. Of the three pairs of axes,
//! each counts by its area. Scales are rounded from the smallest to the largest, each to the grid point nearest to the
//! value that makes up for the errors so far, and the opacity follows.

use crate::scene::{Splats, logit, sigmoid};
use crate::simplify::factorize;
use rayon::prelude::*;

/// Largest opacity that is changed: light behind more opaque splats depends on what they let through.
const OPACITY_MAX: f64 = 0.9;

/// Splats with log-scales at multiples of a step, and opacities that make up for the errors of their light.
pub fn round_light(splats: &Splats, step: f64) -> Splats {
    let mut rounded = splats.clone();
    let rows = rounded.log_scale.par_iter_mut().zip(&mut rounded.opacity_logit);
    rows.for_each(|(log_scale, opacity_logit)| round(log_scale, opacity_logit, step));
    rounded
}

fn round(log_scale: &mut [f32; 3], opacity_logit: &mut f32, step: f64) {
    // Rounding runs backwards: in the metric opacity is first, and then the axes from the largest to the smallest.
    let mut axes = [0, 1, 2];
    axes.sort_by(|&a, &b| log_scale[b].total_cmp(&log_scale[a]));
    let sorted = axes.map(|axis| f64::from(log_scale[axis]));
    let lower = factor(sorted);
    let mut errors = [0.0; 4];
    for k in (0..4).rev() {
        let later: f64 = (k + 1..4).map(|j| lower[j * 4 + k] * errors[j]).sum();
        let pull = -later / lower[k * 4 + k];
        if k == 0 {
            let opacity = sigmoid(f64::from(*opacity_logit));
            if opacity < OPACITY_MAX {
                let changed = (opacity * pull.exp()).min(OPACITY_MAX);
                *opacity_logit = logit(changed) as f32;
            }
            return;
        }
        let value = sorted[k - 1];
        let nearest = ((value + pull.clamp(-step, step)) / step).round() * step;
        errors[k] = nearest - value;
        log_scale[axes[k - 1]] = nearest as f32;
    }
}

/// Lower triangle of the error's matrix over opacity and the axes of these log-scales.
fn factor(log_scale: [f64; 3]) -> [f64; 16] {
    let mut matrix = [0.0; 16];
    let area = |a: usize, b: usize| (log_scale[a] + log_scale[b] - log_scale[0] - log_scale[1]).exp();
    let total = area(0, 1) + area(0, 2) + area(1, 2);
    for (a, b) in [(0, 1), (0, 2), (1, 2)] {
        let share = area(a, b) / total;
        let mut add = |i: usize, j: usize, value: f64| {
            matrix[i * 4 + j] += share * value;
            if i != j {
                matrix[j * 4 + i] += share * value;
            }
        };
        add(0, 0, 1.0);
        for axis in [a, b] {
            add(axis + 1, 0, 0.5);
            add(axis + 1, axis + 1, 0.75);
        }
        add(b + 1, a + 1, 0.25);
    }
    // An axis without area has no error; any metric serves.
    (0..4).for_each(|i| matrix[i * 5] += 1e-9);
    factorize(&mut matrix, 4);
    matrix
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Light of a splat along its third axis.
    fn light(splats: &Splats, i: usize) -> f64 {
        let [a, b, _] = splats.log_scale[i].map(f64::from);
        (a + b).exp() * sigmoid(splats.opacity_logit[i].into())
    }

    #[test]
    fn light_is_kept_better_than_by_numbers_alone() {
        let wave = |i: usize| (i as f32 * 1.7).sin();
        let splats = Splats {
            log_scale: (0..200).map(|i| [wave(i), wave(i + 7), -6.0 + wave(i + 13)]).collect(),
            opacity_logit: (0..200).map(|i| wave(i + 3)).collect(),
            ..Splats::default()
        };
        let step = 1.0 / 16.0;
        let together = round_light(&splats, step);
        let mut alone = splats.clone();
        for value in alone.log_scale.as_flattened_mut() {
            *value = (*value * 16.0).round() / 16.0;
        }
        let on_grid = |v: &f32| (v * 16.0).fract() == 0.0;
        assert!(together.log_scale.as_flattened().iter().all(on_grid));
        let error = |of: &Splats| -> f64 { (0..200).map(|i| (light(of, i) / light(&splats, i)).ln().powi(2)).sum() };
        assert!(
            error(&together) < 0.4 * error(&alone),
            "{}, {}",
            error(&together),
            error(&alone)
        );
    }
}
