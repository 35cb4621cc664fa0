//! Metamorphic relations between two pictures, independent of their content.

use crate::common::scenes::{self, POISON, Random, Scene};
use crate::reference::assert_close;
use ashfall::reference::frame::{center, project_all, render_screen, sorted};
use ashfall::reference::rasterize::{blended, layer};
use ashfall::reference::{Frame, ScreenSplat, Splat, Thresholds, Viewpoint, frame, render};
use ashfall::scene::{Projection, SH_C0, Splats};
use glam::{DMat3, DQuat};

pub(crate) fn draw(scene: &Scene) -> Frame<f64> {
    render(&scene.splats, &scene.camera, &scene.options)
}

pub(crate) fn on_screen(scene: &Scene) -> Vec<Option<ScreenSplat<f64>>> {
    let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
    project_all(&Splat::all(&scene.splats), &view)
}

fn draw_screen(scene: &Scene, screen: &[Option<ScreenSplat<f64>>]) -> Frame<f64> {
    render_screen(screen, scene.camera.width, scene.camera.height, &scene.options)
}

/// The splats in another order.
fn permuted(splats: &Splats, order: &[usize]) -> Splats {
    let stride = splats.sh_stride();
    Splats {
        mean: order.iter().map(|&i| splats.mean[i]).collect(),
        quaternion: order.iter().map(|&i| splats.quaternion[i]).collect(),
        log_scale: order.iter().map(|&i| splats.log_scale[i]).collect(),
        opacity_logit: order.iter().map(|&i| splats.opacity_logit[i]).collect(),
        sh: order
            .iter()
            .flat_map(|&i| splats.sh[i * stride..][..stride].to_vec())
            .collect(),
        ..splats.clone()
    }
}

/// M2: twice the scene at twice the distance gives the same picture.
#[test]
fn scale_does_not_show() {
    let scene = scenes::hard(31, 27, 37, 29, 2);
    let picture = draw(&scene);
    for power in [-20i32, 3, 16] {
        let factor = 2f64.powi(power);
        let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
        let mut far = view;
        far.camera.position *= factor;
        far.near *= factor;
        let splats: Vec<Splat<f64>> = Splat::<f64>::all(&scene.splats)
            .into_iter()
            .map(|splat| Splat {
                mean: splat.mean.map(|x| x * factor),
                log_scale: splat.log_scale.map(|s| s + factor.ln()),
                ..splat
            })
            .collect();
        let scaled = frame::render_splats(&splats, &far, &scene.options);
        for (a, b) in picture.pixels.iter().zip(&scaled.pixels) {
            assert_close(a.transmittance, b.transmittance, 1e-11, 1.0);
            assert_close(a.depth * factor, b.depth, 1e-11, factor);
            for channel in 0..3 {
                assert_close(a.color[channel], b.color[channel], 1e-11, 1.0);
            }
        }
    }
}

/// Rays of a camera that goes away along its axis, with focal lengths in proportion, become parallel: its picture is
/// the orthographic one.
#[test]
fn an_orthographic_picture_is_that_of_a_far_camera() {
    let mut scene = scenes::gentle(36, 40, 37, 29, 3);
    scene.camera.focal /= 4.0;
    scene.options.thresholds = Thresholds::NONE;
    // Orthonormal in double precision: the way is long.
    scene.camera.rotation = DMat3::from_quat(DQuat::from_mat3(&scene.camera.rotation).normalize());
    let mut view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
    let splats = Splat::<f64>::all(&scene.splats);
    let draw = |view: &Viewpoint| frame::render_splats(&splats, view, &scene.options).pixels;
    let near = draw(&view);
    let mut far = view;
    let away = 1e8;
    far.camera.position -= away * scene.camera.rotation.row(2);
    far.camera.focal *= away;
    // Slopes beside the image are not clamped.
    far.limit = [-1.0, 1.0, -1.0, 1.0];
    view.projection = Projection::Orthographic;
    let mut moved = 0.0_f64;
    for ((near, far), pixel) in near.iter().zip(draw(&far)).zip(draw(&view)) {
        // Means are 6 of 1e8 units of 40 px and less off: 3e-6 px, of splats of half a pixel and more.
        assert_close(far.transmittance, pixel.transmittance, 1e-5, 1.0);
        assert_close(far.depth - away * (1.0 - far.transmittance), pixel.depth, 1e-4, 1.0);
        for channel in 0..3 {
            assert_close(far.color[channel], pixel.color[channel], 1e-5, 1.0);
            moved = moved.max((near.color[channel] - pixel.color[channel]).abs());
        }
    }
    assert!(moved > 0.1, "{moved}: the picture from nearby");
}

/// M3: at distinct depths the order of the list has no effect.
#[test]
fn the_lists_order_does_not_show() {
    let scene = scenes::gentle(32, 25, 30, 30, 1);
    let order = Random::new(32).permutation(25);
    let other = Scene {
        splats: permuted(&scene.splats, &order),
        ..scene.clone()
    };
    assert!(draw(&scene) == draw(&other), "another picture");
}

/// At equal depths the splat of the lower index is in front.
#[test]
fn ties_go_by_index() {
    let mut scene = scenes::gentle(45, 40, 20, 20, 0);
    let twins: Vec<usize> = (0..40).map(|i| i / 2).collect();
    scene.splats = permuted(&scene.splats, &twins);
    let (_, splat_from_rank) = sorted(&on_screen(&scene));
    for pair in splat_from_rank.chunks(2) {
        assert_eq!((pair[0] % 2, pair[1]), (0, pair[0] + 1));
    }
}

/// M4: a picture consists of its two halves, with the Jacobian's limits of the whole.
#[test]
fn two_halves_make_a_picture() {
    let scene = scenes::hard(33, 27, 40, 21, 1);
    let whole = draw(&scene);
    let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
    let splats = Splat::<f64>::all(&scene.splats);
    for half in 0..2 {
        let mut shifted = view;
        shifted.camera.width = 20;
        shifted.camera.center.x -= f64::from(20 * half);
        let part = frame::render_splats(&splats, &shifted, &scene.options);
        for (index, pixel) in part.pixels.iter().enumerate() {
            let expected = whole.pixels[index / 20 * 40 + index % 20 + 20 * half as usize];
            assert_close(pixel.color[0], expected.color[0], 1e-11, 1.0);
        }
    }
}

/// M5: invisible splats change nothing.
#[test]
fn the_unseen_does_not_show() {
    let scene = scenes::gentle(34, 12, 25, 31, 1);
    let picture = draw(&scene);
    let append = |change: &dyn Fn(&mut Splats)| {
        let mut order: Vec<usize> = (0..12).collect();
        order.push(0);
        let mut other = Scene {
            splats: permuted(&scene.splats, &order),
            ..scene.clone()
        };
        change(&mut other.splats);
        draw(&other)
    };
    let behind = scene.camera.position - 2.0 * scene.camera.rotation.row(2);
    assert!(picture == append(&|s| s.opacity_logit[12] = -5.6));
    assert!(picture == append(&|s| s.mean[12] = behind.to_array().map(|x| x as f32)));
    assert!(picture == append(&|s| s.quaternion[12] = [0.0; 4]));
    for poison in POISON.iter().filter(|p| !p.is_finite()) {
        for axis in 0..3 {
            assert!(picture == append(&|s| s.mean[12][axis] = *poison));
            assert!(picture == append(&|s| s.log_scale[12][axis] = *poison));
        }
        assert!(picture == append(&|s| s.opacity_logit[12] = *poison));
        assert!(picture == append(&|s| s.quaternion[12][2] = *poison));
    }
    assert!(
        picture != append(&|_| {}),
        "the appended splat shows when it is healthy"
    );
}

/// The picture is finite for any value of one parameter.
#[test]
fn poison_leaves_a_finite_picture() {
    let scene = scenes::gentle(35, 5, 12, 9, 1);
    for poison in POISON {
        for field in 0..5 {
            let mut other = scene.clone();
            match field {
                0 => other.splats.mean[1][2] = poison,
                1 => other.splats.quaternion[1][0] = poison,
                2 => other.splats.log_scale[1][1] = poison,
                3 => other.splats.opacity_logit[1] = poison,
                _ => scenes::coefficient(&mut other.splats, 1, 2)[0] = poison,
            }
            let finite = |x: f64| x.is_finite();
            let picture = draw(&other);
            for pixel in &picture.pixels {
                assert!(
                    pixel.color.into_iter().all(finite) && finite(pixel.transmittance),
                    "{poison} in field {field}: {pixel:?}"
                );
            }
        }
    }
}

/// M11: a quaternion's sign and length have no effect.
#[test]
fn a_quaternions_length_does_not_show() {
    let scene = scenes::gentle(36, 10, 20, 20, 0);
    for factor in [-1.0, 2f32.powi(60), 2f32.powi(-55)] {
        let mut other = scene.clone();
        for quaternion in &mut other.splats.quaternion {
            *quaternion = quaternion.map(|q| q * factor);
        }
        assert!(draw(&scene) == draw(&other), "quaternions times {factor}");
    }
}

/// M16: removing a splat changes a pixel by α T (colour behind − its colour), and removing several by at most the sum
/// of their weights.
#[test]
fn removal_is_worth_the_weight() {
    let mut scene = scenes::gentle(37, 20, 24, 24, 0);
    scene.options.thresholds = Thresholds::NONE;
    let screen = on_screen(&scene);
    let whole = draw_screen(&scene, &screen);
    let (list, _) = sorted(&screen);
    let order: Vec<usize> = (0..list.len()).collect();
    let without = |gone: &dyn Fn(usize) -> bool| {
        let kept: Vec<_> = (0..list.len()).map(|i| (!gone(i)).then_some(list[i])).collect();
        draw_screen(&scene, &kept)
    };
    let (one, some) = (7, |i: usize| i % 3 == 1);
    let (without_one, without_some) = (without(&|i| i == one), without(&some));
    // Only the splats behind the removed one.
    let behind = without(&|i| i <= one);
    for pixel in 0..whole.pixels.len() {
        let position = center(pixel, 24);
        let (mut transmittance, mut weight_one, mut weight_some) = (1.0, 0.0, 0.0);
        for index in blended(&list, &order, position, &scene.options.thresholds) {
            let alpha = layer(&list[index], position, &scene.options.thresholds).map_or(0.0, |l| l.alpha);
            if index == one {
                weight_one = alpha * transmittance;
            }
            if some(index) {
                weight_some += alpha * transmittance;
            }
            transmittance *= 1.0 - alpha;
        }
        for channel in 0..3 {
            let color = |frame: &Frame<f64>| frame.pixels[pixel].color[channel];
            let change = color(&without_one) - color(&whole);
            let expected = weight_one * (color(&behind) - list[one].color[channel]);
            assert_close(change, expected, 1e-12, 1.0);
            let change = (color(&without_some) - color(&whole)).abs();
            assert!(change <= weight_some * 1.0001, "{change} for a weight of {weight_some}");
        }
    }
}

/// M17: the background contributes with weight T.
#[test]
fn backgrounds_show_through_the_transmittance() {
    let scene = scenes::hard(38, 27, 24, 20, 1);
    let mut other = scene.clone();
    other.options.background = [0.9, 0.0, 0.4];
    let (a, b) = (draw(&scene), draw(&other));
    for (a, b) in a.pixels.iter().zip(&b.pixels) {
        assert_eq!(a.transmittance, b.transmittance);
        for channel in 0..3 {
            let apart = scene.options.background[channel] - other.options.background[channel];
            assert_close(a.color[channel] - b.color[channel], a.transmittance * apart, 1e-14, 1.0);
        }
    }
}

/// M18: with one colour everywhere the picture is the coverage.
#[test]
fn one_colour_shows_the_coverage() {
    let mut scene = scenes::gentle(39, 20, 24, 20, 0);
    scene.splats.sh.fill(0.25 / SH_C0);
    for pixel in draw(&scene).pixels {
        let expected = 0.75 * (1.0 - pixel.transmittance) + pixel.transmittance * scene.options.background[1];
        assert_close(pixel.color[1], expected, 1e-7, 1.0);
    }
}

/// M19: two coincident equal splats are one of alpha 1 − (1 − α)².
#[test]
fn a_splat_twice_is_a_denser_splat() {
    let mut scene = scenes::gentle(40, 1, 24, 24, 0);
    scene.options.thresholds = Thresholds::NONE;
    let once = draw(&scene);
    scene.splats = permuted(&scene.splats, &[0, 0]);
    for (twice, once) in draw(&scene).pixels.iter().zip(&once.pixels) {
        assert_close(twice.transmittance, once.transmittance.powi(2), 1e-14, 1.0);
    }
}
