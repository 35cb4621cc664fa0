//! The 3D smoothing filter of Mip-Splatting (Yu et al. 2024, section 5.1): no splat is thinner than the resolution of
//! the training views, so that closer cameras see no needles.
//!
//! A view with focal length f (pixels) samples a splat at depth z with f / z pixels per world unit; the highest of
//! these rates decides. The filter is a convolution with a round Gaussian of `variance` squared sampling intervals, and
//! the opacity is lowered so that no light is added. Kernels apply it from the fourth number of the log-scales' plane;
//! [`baked`](super::filter::baked) makes it part of the splat.

use super::config::MipConfig;
use super::state::HostState;
use crate::scene::Camera;
use glam::DVec3;
use rayon::prelude::*;

/// Sampling rate at each mean, pixels per world unit: the largest f / z of the cameras that see it, with `margin` (a
/// share of the image's size) around their images and the near plane at `near` world units. `None` for means that no
/// camera sees.
pub fn sampling_rates(means: &[[f32; 3]], cameras: &[Camera], near: f64, margin: f64) -> Vec<Option<f64>> {
    let rate = |mean: &[f32; 3]| {
        let mean = DVec3::from(mean.map(f64::from));
        let rates = cameras.iter().filter_map(|c| rate(c, mean, near, margin));
        rates.reduce(f64::max)
    };
    means.par_iter().map(rate).collect()
}

fn rate(camera: &Camera, mean: DVec3, near: f64, margin: f64) -> Option<f64> {
    let v = camera.view_from_world(mean);
    let pixel = camera.pixel_from_view(v);
    let within = |x: f64, size: u32| {
        let size = f64::from(size);
        (-margin * size..=(1.0 + margin) * size).contains(&x)
    };
    let seen = v.z >= near && within(pixel.x, camera.width) && within(pixel.y, camera.height);
    // For non-square pixels the finer axis, so as not to blur visible detail.
    seen.then(|| camera.focal.max_element() / v.z)
}

/// Sets every row's filter for its current position. Unseen splats get the lowest rate of all; if none is seen, there
/// is no filter.
pub fn refresh(state: &mut HostState, cameras: &[Camera], near: f64, config: &MipConfig) {
    let means: Vec<[f32; 3]> = (0..state.len()).map(|row| state.mean(row)).collect();
    let rates = sampling_rates(&means, cameras, near, f64::from(config.margin));
    let lowest = rates.iter().copied().flatten().reduce(f64::min);
    let width = f64::from(config.smoothing).sqrt();
    for (row, rate) in state.params[2].iter_mut().zip(rates) {
        row[3] = rate.or(lowest).map_or(0.0, |rate| (width / rate) as f32);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Primitive;
    use crate::scene::{logit, sigmoid};
    use crate::train::filter::{LOGIT_MIN, baked, opacity_factor};
    use crate::train::test_camera;
    use glam::DVec2;

    const SOLID: Primitive = Primitive::Gaussian3d;

    /// Camera at the origin along z; 100 × 50 pixels, the principal point off the centre.
    fn camera(focal: f64) -> Camera {
        Camera {
            focal: DVec2::new(focal, 0.5 * focal),
            center: DVec2::new(70.0, 20.0),
            ..test_camera(100, 50, focal)
        }
    }

    fn rates(means: &[[f32; 3]], cameras: &[Camera]) -> Vec<Option<f64>> {
        sampling_rates(means, cameras, 0.5, 0.15)
    }

    #[test]
    fn the_closest_camera_that_sees_a_mean_decides() {
        let near = camera(100.0);
        let back = Camera {
            position: DVec3::new(0.0, 0.0, -2.0),
            ..camera(400.0)
        };
        let means = [[0.0, 0.0, 2.0], [0.0, 0.0, 20.0], [0.0, 0.0, 0.4], [0.0, 0.0, -9.0]];
        let wanted = [Some(100.0), Some(400.0 / 22.0), Some(400.0 / f64::from(2.4_f32)), None];
        let found = rates(&means, &[near, back]);
        for (found, wanted) in found.iter().zip(wanted) {
            let apart = found.unwrap_or(-1.0) / wanted.unwrap_or(-1.0) - 1.0;
            assert!(apart.abs() < 1e-6, "{found:?}, not {wanted:?}");
        }
    }

    #[test]
    fn a_margin_around_the_true_image_counts_as_seen() {
        // x runs from −15 to 115 pixels: at depth 1 with the centre at 70, from −0.85 to 0.45; y likewise.
        let seen = |x: f32, y: f32| rates(&[[x, y, 1.0]], &[camera(100.0)])[0].is_some();
        assert!(seen(-0.849, 0.0) && !seen(-0.851, 0.0));
        assert!(seen(0.449, 0.0) && !seen(0.451, 0.0));
        assert!(seen(0.0, -0.549) && !seen(0.0, -0.551));
        assert!(seen(0.0, 0.749) && !seen(0.0, 0.751));
        assert!(!seen(f32::NAN, 0.0));
    }

    fn state(means: &[[f32; 3]]) -> HostState {
        let mut state = HostState::zeros(means.len(), 0);
        for (row, &[x, y, z]) in state.params[0].iter_mut().zip(means) {
            *row = [x, y, z, 0.0];
        }
        state
    }

    #[test]
    fn filters_follow_the_rates_and_the_unseen_the_lowest() {
        let config = MipConfig::default();
        let mut some = state(&[[0.0, 0.0, 2.0], [0.0, 0.0, 4.0], [9.0, 0.0, 1.0]]);
        refresh(&mut some, &[camera(100.0)], 0.5, &config);
        let interval = 0.2_f32.sqrt() / 100.0;
        for (row, depth) in some.params[2].iter().zip([2.0, 4.0, 4.0]) {
            assert!((row[3] / (interval * depth) - 1.0).abs() < 1e-6, "{row:?}");
        }
        let mut unseen = state(&[[0.0, 0.0, -1.0]]);
        refresh(&mut unseen, &[camera(100.0)], 0.5, &config);
        assert_eq!(unseen.params[2][0][3], 0.0);
    }

    #[test]
    fn baking_adds_variances_and_takes_no_light() {
        let (scale, sigma) = ([0.5_f64, 0.02, 3e-5], 0.01_f64);
        let log_scale = scale.map(|s| s.ln() as f32);
        for u in [-20.0, -3.0, 0.0, 5.0, 12.0] {
            let (wide, opacity) = baked(log_scale, u, sigma as f32, SOLID);
            let mut factor = 1.0;
            for (wide, s) in wide.iter().zip(scale) {
                let wanted = s.hypot(sigma);
                assert!((f64::from(*wide).exp() / wanted - 1.0).abs() < 3e-6);
                factor *= s / wanted;
            }
            let wanted = logit(sigmoid(f64::from(u)) * factor);
            assert!((f64::from(opacity) - wanted).abs() < 1e-5, "{opacity}, not {wanted}");
            assert!((opacity_factor(log_scale, sigma as f32, SOLID) / factor - 1.0).abs() < 1e-5);
            // Surfels are smoothed in their planes.
            let (flat, _) = baked(log_scale, u, sigma as f32, Primitive::Surfel);
            assert_eq!(flat, [wide[0], wide[1], log_scale[2]]);
            let factor = opacity_factor(log_scale, sigma as f32, Primitive::Surfel);
            let wanted = scale[0] / scale[0].hypot(sigma) * scale[1] / scale[1].hypot(sigma);
            assert!((factor / wanted - 1.0).abs() < 1e-5);
        }
    }

    #[test]
    fn no_unit_is_too_small_or_too_large() {
        let log_scale = [-2.0_f32, 0.5, -9.0];
        let (_, opacity) = baked(log_scale, 1.0, 0.1, SOLID);
        for exponent in [-60, -20, 20, 60] {
            let unit = 2_f32.powi(exponent);
            let moved = log_scale.map(|s| s + unit.ln());
            let (_, scaled) = baked(moved, 1.0, 0.1 * unit, SOLID);
            // The logarithms round at magnitudes up to 50: 2e-6 of each factor.
            assert!((scaled - opacity).abs() < 1e-5, "2^{exponent}");
        }
    }

    #[test]
    fn extremes_stay_finite_and_poison_stays_visible() {
        let (wide, opacity) = baked([-500.0, 0.0, 80.0], 3.0, 1e-3, SOLID);
        assert!(wide.iter().all(|s| s.is_finite()));
        assert_eq!(opacity, LOGIT_MIN as f32);
        assert_eq!(baked([1.0, 2.0, 3.0], 0.5, 0.0, SOLID), ([1.0, 2.0, 3.0], 0.5));
        assert_eq!(baked([1.0, 2.0, 3.0], 0.5, f32::NAN, SOLID), ([1.0, 2.0, 3.0], 0.5));
        assert!(baked([0.0; 3], f32::NAN, 0.1, SOLID).1.is_nan());
    }
}
