//! The gradient of a whole frame: composed, by end-to-end duals, and by differences.

use crate::common::pack;
use crate::common::scenes::{self, Random, Scene};
use crate::reference::{assert_close, central_difference};
use ashfall::reference::expand::expand;
use ashfall::reference::gradient::{backward, loss_derivatives};
use ashfall::reference::loss::{self, Target};
use ashfall::reference::project_backward::{PenaltyWeights, penalty_backward};
use ashfall::reference::rasterize::Layer;
use ashfall::reference::rasterize_backward::{PixelGradient, isect_backward};
use ashfall::reference::tiles::Grid;
use ashfall::reference::{
    Dual, Options, Real, ScreenSplat, Splat, Thresholds, Viewpoint, frame, loss_gradient, rasterize,
};
use ashfall::scene::ScreenFilter;

/// All pairs of splat and parameter index.
fn every_parameter(scene: &Scene) -> Vec<(usize, usize)> {
    let count = 11 + scene.splats.sh_stride();
    (0..scene.splats.len())
        .flat_map(|s| (0..count).map(move |p| (s, p)))
        .collect()
}

/// The composed gradient as one row per splat.
fn rows(scene: &Scene, target: &Target<'_>) -> Vec<Vec<f64>> {
    let gradient = loss_gradient(&scene.splats, &scene.camera, &scene.options, target);
    pack::gradient_rows(&gradient.d_splats)
}

#[test]
fn the_composed_gradient_is_that_of_the_whole() {
    let mut mip = scenes::gentle(21, 6, 19, 14, 2);
    mip.splats.filter = ScreenFilter::Mip;
    for scene in [scenes::gentle(22, 8, 23, 17, 1), scenes::hard(23, 9, 21, 26, 1), mip] {
        let photo = scenes::photo_values(&scenes::photo(3, scene.camera.width, scene.camera.height));
        let target = Target::new(scene.camera.width as usize, &photo);
        let composed = rows(&scene, &target);
        let parameters = every_parameter(&scene);
        let whole = loss_derivatives(&scene.splats, &scene.camera, &scene.options, &target, &parameters);
        let largest = whole.iter().fold(0.0, |m: f64, d| m.max(d.abs()));
        assert!(largest > 1e-3, "a gradient worth comparing");
        for (&(splat, parameter), whole) in parameters.iter().zip(&whole) {
            assert_close(composed[splat][parameter], *whole, 1e-10, 1e-6 * largest);
        }
    }
}

#[test]
fn without_cuts_the_gradient_is_the_limit_of_differences() {
    let mut scene = scenes::gentle(24, 8, 24, 19, 2);
    scene.options.thresholds = Thresholds::NONE;
    let photo = scenes::photo_values(&scenes::photo(4, 24, 19));
    let target = Target::new(24, &photo);
    let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
    let splats = Splat::<f64>::all(&scene.splats);
    let loss_at = |splat: usize, parameter: usize, x: f64| {
        let mut splats = splats.clone();
        let mut row = splats[splat].parameters();
        row[parameter] = x;
        splats[splat] = Splat::from_parameters(&row);
        let frame = frame::render_splats(&splats, &view, &scene.options);
        loss::loss(&frame.colors(), &target)
    };
    let composed = rows(&scene, &target);
    for (splat, row) in composed.iter().enumerate() {
        let values = splats[splat].parameters();
        let largest = row.iter().fold(0.0, |m: f64, d| m.max(d.abs()));
        for parameter in 0..row.len() {
            let difference = central_difference(|x| loss_at(splat, parameter, x), values[parameter], 2e-5);
            assert_close(row[parameter], difference, 1e-7, largest);
        }
    }
}

#[test]
fn transmittance_and_depth_have_gradients_too() {
    let scene = scenes::gentle(25, 10, 17, 21, 0);
    let random = &mut Random::new(25);
    let upstream: Vec<PixelGradient> = (0..17 * 21)
        .map(|_| PixelGradient {
            color: [0; 3].map(|_| random.normal()),
            transmittance: random.normal(),
            depth: random.normal(),
        })
        .collect();
    let (d_screen, _) = backward(&scene.splats, &scene.camera, &scene.options, &upstream);
    // The same objective with duals through the frame, by each number of each screen-space splat.
    let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
    let screen = frame::project_all(&Splat::<f64>::all(&scene.splats), &view);
    for (chosen, gradient) in d_screen.iter().enumerate() {
        let lifted: Vec<Option<ScreenSplat<Dual<10>>>> = (0..screen.len())
            .map(|i| {
                let mut slot = 0;
                screen[i].map(|splat| {
                    ScreenSplat::from_row(splat.row().map(|value| {
                        slot += 1;
                        Dual::variable(value, (i == chosen).then_some(slot - 1))
                    }))
                })
            })
            .collect();
        let frame = frame::render_screen(&lifted, 17, 21, &scene.options);
        let objective: Dual<10> = frame
            .pixels
            .iter()
            .zip(&upstream)
            .map(|(pixel, up)| {
                let color: Dual<10> = (0..3).map(|c| pixel.color[c] * Dual::of(up.color[c])).sum();
                color + pixel.transmittance * Dual::of(up.transmittance) + pixel.depth * Dual::of(up.depth)
            })
            .sum();
        for (found, expected) in gradient.row.iter().zip(objective.d) {
            assert_close(*found, expected, 1e-10, 1e-3);
        }
        assert!(gradient.mean_abs[0] >= gradient.mean()[0].abs());
        assert!(gradient.weight_max <= gradient.weight_sum);
    }
    let Options {
        background, thresholds, ..
    } = scene.options;
    let grid = Grid::new(17, 21);
    let by_tile = isect_backward(&screen, &grid, background, &thresholds, &upstream);
    let touched = expand(&screen, &grid, &thresholds);
    let mut sums = vec![0.0; screen.len()];
    for (isect, gradient) in &by_tile {
        assert!(touched.contains(isect), "{isect:?} is blended and not listed");
        sums[isect.splat as usize] += gradient.row[3];
    }
    for (sum, whole) in sums.iter().zip(&d_screen) {
        assert_close(*sum, whole.row[3], 1e-12, 1e-3);
    }
}

#[test]
fn a_capped_alpha_has_no_gradient() {
    let splat = ScreenSplat {
        mean: [5.5, 5.5],
        covariance: [9.0, 1.0, 7.0],
        opacity: 1.0 - 1e-6,
        color: [1.0, 0.5, 0.2],
        depth: 2.0,
        disc: None,
    };
    let mut slot = 0;
    let lifted = ScreenSplat::from_row(splat.row().map(|value| {
        slot += 1;
        Dual::<10>::variable(value, Some(slot - 1))
    }));
    let at = |position| rasterize::layer(&lifted, position, &Thresholds::ENGINE);
    let peak: Option<Layer<Dual<10>>> = at([5.5, 5.5]);
    assert_eq!(peak.map(|l| l.alpha), Some(Dual::of(Thresholds::ENGINE.alpha_max)));
    assert!(at([7.5, 5.5]).is_some_and(|l| l.alpha.d[0] > 0.0));
}

#[test]
fn a_quaternions_length_has_no_gradient() {
    let scene = scenes::gentle(26, 12, 31, 22, 1);
    let photo = scenes::photo_values(&scenes::photo(5, 31, 22));
    let gradient = loss_gradient(&scene.splats, &scene.camera, &scene.options, &Target::new(31, &photo));
    for (d, q) in gradient.d_splats.quaternion.iter().zip(&scene.splats.quaternion) {
        let radial: f64 = d.iter().zip(q).map(|(d, q)| d * f64::from(*q)).sum();
        let length = |v: &mut dyn Iterator<Item = f64>| v.map(|x| x * x).sum::<f64>().sqrt();
        let product = length(&mut d.iter().copied()) * length(&mut q.map(f64::from).into_iter());
        assert!(
            product > 0.0 && radial.abs() <= 1e-12 * product,
            "{radial} of {product}"
        );
    }
}

#[test]
fn moving_all_splats_is_moving_the_camera_back() {
    let mut scene = scenes::gentle(27, 10, 27, 22, 2);
    scene.options.thresholds = Thresholds::NONE;
    let photo = scenes::photo_values(&scenes::photo(6, 27, 22));
    let target = Target::new(27, &photo);
    let d_mean = loss_gradient(&scene.splats, &scene.camera, &scene.options, &target)
        .d_splats
        .mean;
    for axis in 0..3 {
        let loss_at = |x: f64| {
            let mut camera = scene.camera;
            camera.position[axis] = x;
            let image = ashfall::reference::render(&scene.splats, &camera, &scene.options).colors();
            loss::loss(&image, &target)
        };
        let of_camera = central_difference(loss_at, scene.camera.position[axis], 2e-5);
        let of_splats: f64 = d_mean.iter().map(|d| d[axis]).sum();
        let size: f64 = d_mean.iter().map(|d| d[axis].abs()).sum();
        assert_close(of_splats, -of_camera, 1e-7, size);
    }
}

#[test]
fn only_the_visible_have_gradients() {
    let scene = scenes::hard(28, 18, 33, 25, 1);
    let photo = scenes::photo_values(&scenes::photo(7, 33, 25));
    let gradient = loss_gradient(&scene.splats, &scene.camera, &scene.options, &Target::new(33, &photo));
    for index in 0..scene.splats.len() {
        let d = &gradient.d_splats;
        let zero = d.mean[index] == [0.0; 3] && d.opacity_logit[index] == 0.0;
        match scenes::Trouble::of(index) {
            scenes::Trouble::Behind | scenes::Trouble::Invisible => assert!(zero, "splat {index}"),
            scenes::Trouble::None | scenes::Trouble::Clamped | scenes::Trouble::Huge => {
                assert!(!zero, "splat {index}")
            }
            _ => {}
        }
    }
    let numbers = gradient
        .d_splats
        .sh
        .iter()
        .chain(gradient.d_splats.quaternion.iter().flatten());
    assert!(numbers.into_iter().all(|d| d.is_finite()));
}

#[test]
fn penalties_pull_on_opacity_and_size() {
    let splat = Splat::<f64>::of(&scenes::gentle(29, 1, 20, 20, 1).splats, 0);
    let weights = PenaltyWeights {
        opacity: 0.3,
        scale: 0.2,
        size: 0.1,
    };
    let gradient = penalty_backward(&splat, weights);
    let opacity = splat.opacity_logit.sigmoid();
    assert_close(gradient[10], 0.3 * opacity * (1.0 - opacity), 1e-14, 0.0);
    for (found, log_scale) in gradient[7..10].iter().zip(splat.log_scale) {
        let scale = log_scale.exp();
        assert_close(*found, 0.2 * scale + 0.1 * scale * scale, 1e-14, 0.0);
    }
    assert!(gradient[..7].iter().chain(&gradient[11..]).all(|&d| d == 0.0));
}
