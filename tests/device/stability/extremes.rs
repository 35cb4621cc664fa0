//! Section 1 of the catalogue, second part: NaN, infinities and extreme magnitudes.

use crate::common::scenes::{self, Scene};
use crate::stability::lab::{Lesson, apart, image_bound, lab, same, view_options, within};
use crate::stability::props::{set, with_copy};
use ashfall::render::ViewOptions;

/// A splat at the camera's centre has neither a direction nor a screen position.
#[test]
fn f006_splat_at_the_camera() {
    let lab = lab();
    let scene = scenes::gentle(106, 15, 33, 25, 3);
    let clean = lab.draw(&scene);
    let centre = scene.camera.position.as_vec3().to_array();
    let ulp = |x: f32, step: i32| f32::from_bits(x.to_bits().wrapping_add_signed(step));
    for near in [scene.options.near as f32, 1e-30, 0.0] {
        for step in [-1, 0, 1] {
            let at = with_copy(&scene, |splats, i| splats.mean[i] = centre.map(|x| ulp(x, step)));
            let view = ViewOptions {
                near,
                ..view_options(&scene)
            };
            let image = lab.draw_with(&at, &view);
            let finite = image.rgb.as_flattened().iter().all(|x| x.is_finite());
            assert!(finite, "near plane at {near:e}, {step} steps off the centre");
            if step == 0 || near > 1e-3 {
                assert!(same(&image, &clean), "near plane at {near:e}, {step} steps off");
            }
        }
    }
}

#[test]
fn f007_log_scale_extremes() {
    let lab = lab();
    let scene = scenes::gentle(107, 15, 33, 25, 0);
    for log in [-120.0f32, -60.0, 0.0, 40.0, 60.0, 88.0, 89.0, 120.0] {
        for axes in [1, 3] {
            let odd = with_copy(&scene, |splats, i| splats.log_scale[i][..axes].fill(log));
            let image = lab.draw(&odd);
            let all = image.rgb.as_flattened().iter().chain(&image.transmittance);
            assert!(all.clone().all(|x| x.is_finite()), "log-scale {log} on {axes} axes");
            // A vanishing scale leaves the dilation, and the picture agrees with the oracle; beyond 2^63 px the
            // variance overflows and the splat is dropped.
            if log < 1.0 {
                let error = apart(&odd, &image, 1e-4);
                // The widest of these has σ = 33 px along two axes, or none at all.
                within(
                    "project",
                    "7",
                    &format!("log-scale {log} on {axes} axes"),
                    error,
                    image_bound(33, 0.55, 16, 1.0),
                );
            }
            if log > 88.8 {
                assert!(same(&image, &lab.draw(&scene)), "an infinite scale shows");
            }
        }
    }
}

/// NaN and infinities in every parameter: the splat is not drawn, and no other splat changes.
#[test]
fn f008_nan_through_guards() {
    let lab = lab();
    let scene = scenes::gentle(108, 12, 33, 25, 2);
    let parameters = 11 + scene.splats.sh_stride();
    let lesson = Lesson::photo(&scene, 0.2);
    let (clean, drawn) = (lab.step(&scene, &lesson), lab.draw(&scene));
    let signalling = f32::from_bits(0x7f80_0001);
    let nones = [f32::NAN, -f32::NAN, signalling, f32::INFINITY, f32::NEG_INFINITY];
    let mut poisoned = scene.clone();
    for (i, &none) in nones.iter().enumerate() {
        let mut one = scene.clone();
        for parameter in 0..parameters {
            let add = |to: &Scene| with_copy(to, |splats, i| set(splats, i, parameter, none));
            poisoned = add(&poisoned);
            one = add(&one);
        }
        assert!(same(&lab.draw(&one), &drawn), "the {i}th number shows");
    }
    let found = lab.step(&poisoned, &lesson);
    assert!(found.image == clean.image, "the image changed");
    for splat in 0..poisoned.splats.len() {
        let expected = if splat < 12 {
            clean.row(splat)
        } else {
            vec![0.0; parameters]
        };
        assert_eq!(found.row(splat), expected, "gradient of splat {splat}");
    }
}
