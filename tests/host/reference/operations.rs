//! Elementary operations, each against a definition or an identity.

use crate::common::scenes::{self, Random};
use crate::reference::assert_close;
use ashfall::reference::adam::{Adam, AdamState};
use ashfall::reference::expand::expand;
use ashfall::reference::frame::project_all;
use ashfall::reference::linear::rotation;
use ashfall::reference::perturb::{normals, perturb};
use ashfall::reference::primitive::extent;
use ashfall::reference::ranges::ranges;
use ashfall::reference::rasterize::{layer, raw_alpha};
use ashfall::reference::relocate;
use ashfall::reference::scan::scan;
use ashfall::reference::sort::sort;
use ashfall::reference::tiles::{Grid, alpha_at_pixels, alpha_max};
use ashfall::reference::{Splat, Thresholds, Viewpoint};

#[test]
fn adams_first_step_is_the_learning_rate() {
    for gradient in [1e-12, -3.0, 1e6] {
        let state = AdamState {
            value: 5.0,
            ..AdamState::default()
        };
        let moved = Adam::default().step(state, gradient, 0.01, 1).value - 5.0;
        assert_close(moved, -0.01 * gradient.signum(), 2e-3, 0.0);
    }
}

#[test]
fn adam_does_not_mind_the_gradients_unit() {
    let adam = Adam {
        epsilon: 0.0,
        ..Adam::default()
    };
    let (mut a, mut b) = (AdamState::default(), AdamState::default());
    let random = &mut Random::new(3);
    for step in 1..200 {
        let gradient = random.normal();
        a = adam.step(a, gradient, 0.1, step);
        b = adam.step(b, gradient * 1024.0, 0.1, step);
        assert_eq!(a.value, b.value, "step {step}");
    }
}

#[test]
fn sorting_is_stable_and_sees_the_mask_only() {
    let keys = [0x103, 0x001, 0x203, 0x000, 0x101];
    let (keys, values) = sort(&keys, &[0, 1, 2, 3, 4], 0xff);
    assert_eq!(keys, [0x000, 0x001, 0x101, 0x103, 0x203]);
    assert_eq!(values, [3, 1, 4, 0, 2]);
}

#[test]
fn a_scan_excludes_its_own_element() {
    assert_eq!(scan(&[3, 0, 5, 1]), (vec![0, 3, 3, 8], 9));
    assert_eq!(scan(&[]), (vec![], 0));
    assert_eq!(scan(&[u32::MAX, 2, 1]), (vec![0, u32::MAX, 1], (1 << 32) + 2));
}

#[test]
fn ranges_cover_the_list_once() {
    assert_eq!(
        ranges(&[0, 0, 2, 5, 5, 5], 7),
        [[0, 2], [2, 2], [2, 3], [3, 3], [3, 3], [3, 6], [6, 6]]
    );
    assert_eq!(ranges(&[], 2), [[0, 0], [0, 0]]);
}

#[test]
fn a_tiles_pixels_never_exceed_its_rectangle() {
    let scene = scenes::hard(5, 90, 61, 45, 0);
    let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
    let grid = Grid::new(61, 45);
    let mut random = Random::new(1);
    for splat in project_all(&Splat::<f64>::all(&scene.splats), &view).iter().flatten() {
        for tile in 0..grid.len() {
            let (pixels, rectangle) = (alpha_at_pixels(splat, &grid, tile), alpha_max(splat, &grid, tile));
            assert!(pixels <= rectangle * (1.0 + 1e-12), "{pixels} > {rectangle} in {tile}");
            // The rectangle's maximum is attained: no sample exceeds it, and a pixel comes near it for splats that are
            // smooth against the pixel grid.
            let x = f64::from(tile % grid.columns() * 8);
            let y = f64::from(tile / grid.columns() * 16);
            let [x_end, y_end] = [(x + 8.0).min(61.0), (y + 16.0).min(45.0)];
            for _ in 0..8 {
                let at = [
                    random.between(x + 0.5, x_end - 0.5),
                    random.between(y + 0.5, y_end - 0.5),
                ];
                assert!(raw_alpha(splat, at) <= rectangle * (1.0 + 1e-9));
            }
            let [xx, xy, yy] = splat.covariance;
            if (xx * yy - xy * xy) / xx.max(yy) > 16.0 && rectangle > 1e-3 {
                // At least 4 px thick: the next centre is at most 0.71 px away.
                assert!(pixels > 0.6 * rectangle, "{pixels} far from {rectangle}");
            }
        }
    }
}

#[test]
fn the_extent_is_as_far_as_a_splat_reaches() {
    let scene = scenes::gentle(7, 20, 40, 40, 0);
    let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
    for splat in project_all(&Splat::<f64>::all(&scene.splats), &view).iter().flatten() {
        let [half_width, half_height] = extent(splat, &Thresholds::ENGINE);
        let seen = |x: f64, y: f64| layer(splat, [x, y], &Thresholds::ENGINE).is_some();
        let [x, y] = splat.mean;
        let steps = || (-2000..=2000).map(|i| f64::from(i) / 2000.0);
        // The splat touches each edge of the box at one point, and is invisible beyond.
        for (factor, expected) in [(0.999, true), (1.001, false)] {
            let right = steps().any(|t| seen(x + factor * half_width, y + t * half_height));
            let below = steps().any(|t| seen(x + t * half_width, y + factor * half_height));
            assert_eq!((right, below), (expected, expected), "{splat:?} at {factor}");
        }
    }
}

#[test]
fn expansion_goes_by_depth_then_tile() {
    let scene = scenes::gentle(6, 30, 40, 40, 0);
    let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
    let screen = project_all(&Splat::<f64>::all(&scene.splats), &view);
    let list = expand(&screen, &Grid::new(40, 40), &Thresholds::ENGINE);
    assert!(!list.is_empty());
    let key = |i: &ashfall::reference::expand::Isect| (screen[i.splat as usize].map_or(0.0, |s| s.depth), i.tile);
    assert!(list.is_sorted_by(|a, b| key(a) < key(b)));
}

#[test]
fn noise_spares_what_is_opaque() {
    let mean = [1.0, 2.0, 3.0];
    let quaternion = [0.5, 0.1, -0.3, 0.9];
    let log_scale = [0.1f64, 0.5, 2.0].map(f64::ln);
    let logit = |o: f64| (o / (1.0 - o)).ln();
    // Along the second local axis, Σ ξ is s² times the axis.
    let turn = rotation(quaternion);
    let axis = [turn[0][1], turn[1][1], turn[2][1]];
    let moved = |opacity: f64| {
        let after = perturb(mean, quaternion, log_scale, logit(opacity), axis, 8.0);
        [0, 1, 2].map(|i| (after[i] - mean[i]) / axis[i])
    };
    for ratio in moved(0.005) {
        assert_close(ratio, 0.5 * 8.0 * 0.25, 1e-9, 0.0);
    }
    for ratio in moved(0.5) {
        assert!(ratio.abs() < 1e-15, "an opaque splat moved by {ratio}");
    }
}

#[test]
fn noise_is_normal_and_a_function_of_its_name() {
    let draws: Vec<[f64; 3]> = (0..40_000).map(|splat| normals(7, 11, splat)).collect();
    let count = draws.len() as f64;
    let mean_of = |f: &dyn Fn(&[f64; 3]) -> f64| draws.iter().map(f).sum::<f64>() / count;
    for axis in 0..3 {
        // Four standard deviations of each mean.
        assert!(mean_of(&|d| d[axis]).abs() < 4.0 / count.sqrt());
        assert!((mean_of(&|d| d[axis].powi(2)) - 1.0).abs() < 4.0 * (2.0 / count).sqrt());
        assert!((mean_of(&|d| d[axis].powi(4)) - 3.0).abs() < 4.0 * (96.0 / count).sqrt());
        assert!(mean_of(&|d| d[axis] * d[(axis + 1) % 3]).abs() < 4.0 / count.sqrt());
    }
    assert_eq!(normals(7, 11, 3), draws[3]);
    assert!(normals(8, 11, 3) != draws[3] && normals(7, 12, 3) != draws[3]);
}

/// The paper's double sum; in f64 accurate to 1e-9 for a few copies.
fn alternating_sum(opacity: f64, n: u32) -> f64 {
    let copy = 1.0 - (1.0 - opacity).powf(1.0 / f64::from(n));
    let mut sum = 0.0;
    for i in 1..=n {
        let mut binomial = 1.0;
        for k in 0..i {
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            sum += sign * binomial * copy.powi(k as i32 + 1) / f64::from(k + 1).sqrt();
            binomial *= f64::from(i - 1 - k) / f64::from(k + 1);
        }
    }
    opacity / sum
}

#[test]
fn relocation_is_the_papers_sum() {
    for opacity in [0.006, 0.1, 0.5, 0.9, 0.999] {
        for n in [1, 2, 3, 7, 15] {
            let factor = relocate::scale_factor(opacity, n);
            assert_close(factor, alternating_sum(opacity, n), 1e-9, 0.0);
        }
        assert_close(relocate::scale_factor(opacity, 1), 1.0, 1e-13, 0.0);
        for n in [2, 51, 5000] {
            let copy = relocate::opacity(opacity, n);
            let together = -f64::exp_m1(f64::from(n) * f64::ln_1p(-copy));
            assert_close(together, opacity, 1e-13, 0.0);
            let factor = relocate::scale_factor(opacity, n);
            assert!(factor.is_finite() && factor > 0.0 && factor <= 1.0, "{factor}");
        }
    }
}
