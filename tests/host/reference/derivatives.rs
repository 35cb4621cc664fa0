//! Dual numbers against central differences, operation by operation.

use crate::common::scenes::{self, Random};
use crate::reference::{assert_close, central_difference};
use ashfall::reference::project::GEOMETRY_PARAMETERS;
use ashfall::reference::{Dual, Real, Splat, Viewpoint, linear, project, sh};
use ashfall::scene::{ScreenFilter, Splats};

/// Checks the derivative of a function of one number, by duals against differences.
macro_rules! check {
    ($x:expr, |$t:ident| $body:expr) => {{
        fn on<R: Real>($t: R) -> R {
            $body
        }
        let x: f64 = $x;
        let dual = on(Dual::<1>::variable(x, Some(0)));
        assert_close(dual.v, on(x), 1e-15, 0.0);
        assert_close(dual.d[0], central_difference(on::<f64>, x, 1e-4 * x.abs()), 1e-8, 1e-3);
    }};
}

#[test]
fn every_operation_differentiates_itself() {
    for x in [0.3, 1.7, 4.0] {
        check!(x, |t| t.exp());
        check!(x, |t| t.ln());
        check!(x, |t| t.sqrt());
        check!(x, |t| t.squared());
        check!(x, |t| t.sigmoid());
        check!(-x, |t| t.sigmoid());
        check!(-x, |t| t.abs());
        check!(x, |t| R::of(2.0) / t + t * t - -t);
        check!(x, |t| t.exp() / (t + R::of(1.0)).sqrt() * (t * R::of(0.3)).ln());
        check!(x, |t| {
            let mut sum: R = [t, t * t].into_iter().sum();
            sum = sum + t.ln();
            sum
        });
    }
}

#[test]
fn gates_shut_completely() {
    let x = Dual::<1>::variable(0.5, Some(0));
    assert_eq!(x.at_least(0.6), Dual::of(0.6));
    assert_eq!(x.at_least(0.5), Dual::of(0.5));
    assert_eq!(x.at_least(0.4), x);
    assert_eq!(x.at_most(0.4), Dual::of(0.4));
    assert_eq!(x.at_most(0.6), x);
    assert!(f64::NAN.at_least(0.0).is_nan() && f64::NAN.at_most(1.0).is_nan());
    assert_eq!(Dual::<1>::variable(0.0, Some(0)).abs().d, [0.0]);
    assert_eq!(800f64.sigmoid(), 1.0);
    assert!((-700f64).sigmoid() > 0.0);
}

/// Derivatives of all outputs of the projection by all parameters, duals against differences.
fn check_projection(splats: &Splats, index: usize, view: &Viewpoint) {
    const LANES: usize = GEOMETRY_PARAMETERS + 48;
    let values = Splat::<f64>::of(splats, index).parameters();
    let lifted: Vec<Dual<LANES>> = values
        .iter()
        .enumerate()
        .map(|(i, &v)| Dual::variable(v, Some(i)))
        .collect();
    let Some(screen) = project(&Splat::from_parameters(&lifted), view) else {
        return;
    };
    for (output, number) in screen.row().iter().enumerate() {
        let row = |changed: usize, x: f64| {
            let mut values = values.clone();
            values[changed] = x;
            project(&Splat::from_parameters(&values), view).map_or(f64::NAN, |s| s.row()[output])
        };
        let largest = number.d.iter().fold(0.0, |m: f64, d| m.max(d.abs()));
        for (parameter, &value) in values.iter().enumerate() {
            let difference = central_difference(|x| row(parameter, x), value, 3e-4);
            assert_close(number.d[parameter], difference, 1e-8, largest.max(1e-3));
        }
    }
}

#[test]
fn projection_differentiates_itself_even_where_it_clamps() {
    for (scene, filter) in [
        (scenes::gentle(11, 6, 40, 31, 3), ScreenFilter::Classic),
        (scenes::gentle(12, 6, 40, 31, 3), ScreenFilter::Mip),
        (scenes::hard(13, 18, 40, 31, 3), ScreenFilter::Classic),
    ] {
        let view = Viewpoint::new(&scene.camera, &scene.options, filter);
        for index in 0..scene.splats.len() {
            check_projection(&scene.splats, index, &view);
        }
    }
}

#[test]
fn beyond_the_limit_the_footprint_ignores_x_but_not_z() {
    let scene = scenes::gentle(14, 1, 40, 30, 0);
    let mut view = Viewpoint::new(&scene.camera, &scene.options, ScreenFilter::Classic);
    view.camera.rotation = glam::DMat3::IDENTITY;
    view.camera.position = glam::DVec3::ZERO;
    view.dilation = 0.0;
    let (z, limit) = (3.0, view.limit[1]);
    let number = Dual::<3>::variable;
    let mut splat = Splat::<Dual<3>>::of(&scene.splats, 0);
    splat.mean = [
        number(2.0 * limit * z, Some(0)),
        number(0.0, Some(1)),
        number(z, Some(2)),
    ];
    splat.log_scale = [0.1f64.ln(); 3].map(Dual::of);
    let xx = project(&splat, &view).map_or(Dual::of(f64::NAN), |s| s.covariance[0]);
    // σ² (fx/z)² (1 + lim²): proportional to z⁻².
    let expected = 0.01 * (view.camera.focal.x / z).powi(2) * (1.0 + limit * limit);
    assert_close(xx.v, expected, 1e-13, 0.0);
    assert_eq!(xx.d[0], 0.0);
    assert_close(xx.d[2], -2.0 * expected / z, 1e-13, 0.0);
}

#[test]
fn the_limits_lie_beyond_each_border() {
    // 40 × 30 pixels, principal point (16, 18): 15 % of the size beyond each border.
    let mut scene = scenes::gentle(17, 1, 40, 30, 0);
    let camera = &mut scene.camera;
    camera.focal = glam::DVec2::new(50.0, 25.0);
    camera.center = glam::DVec2::new(16.0, 18.0);
    camera.rotation = glam::DMat3::IDENTITY;
    camera.position = glam::DVec3::ZERO;
    let view = Viewpoint::new(camera, &scene.options, ScreenFilter::Classic);
    let mut splat = Splat::<f64>::of(&scene.splats, 0);
    splat.log_scale = [0.1f64.ln(); 3];
    let spread = |x: f64, y: f64| {
        let splat = Splat {
            mean: [2.0 * x, 2.0 * y, 2.0],
            ..splat.clone()
        };
        let [xx, _, yy] = project(&splat, &view).map_or([f64::NAN; 3], |s| s.covariance);
        // σ² (f/z)² (1 + slope²) + 0.3, solved for the slope.
        let slope = |variance: f64, focal: f64| ((variance - 0.3) / (0.01 * (focal / 2.0).powi(2)) - 1.0).sqrt();
        [slope(xx, 50.0), slope(yy, 25.0)]
    };
    for (x, y, expected) in [
        (9.0, 0.3, [(46.0 - 16.0) / 50.0, 0.3]),
        (-9.0, -0.3, [(16.0 + 6.0) / 50.0, 0.3]),
        (0.3, 9.0, [0.3, (34.5 - 18.0) / 25.0]),
        (-0.3, -9.0, [0.3, (18.0 + 4.5) / 25.0]),
    ] {
        for (found, expected) in spread(x, y).into_iter().zip(expected) {
            assert_close(found, expected, 1e-9, 1.0);
        }
    }
}

#[test]
fn colour_that_is_clamped_has_no_gradient() {
    let scene = scenes::hard(15, 9, 40, 30, 1);
    let view = Viewpoint::new(&scene.camera, &scene.options, ScreenFilter::Classic);
    let dark = 8;
    assert_eq!(scenes::Trouble::of(dark), scenes::Trouble::Dark);
    let values = Splat::<f64>::of(&scene.splats, dark).parameters();
    let lifted: Vec<Dual<23>> = values
        .iter()
        .enumerate()
        .map(|(i, &v)| Dual::variable(v, Some(i)))
        .collect();
    let color = project(&Splat::from_parameters(&lifted), &view).map(|s| s.color);
    let [r, g, b] = color.unwrap_or([Dual::of(f64::NAN); 3]);
    assert!(r.v > 0.0 && r.d[GEOMETRY_PARAMETERS] > 0.28 && r.d[0] != 0.0);
    assert_eq!((g, b), (Dual::of(0.0), Dual::of(0.0)));
}

#[test]
fn harmonics_differentiate_along_the_sphere() {
    let random = &mut Random::new(16);
    for _ in 0..10 {
        let at = [0; 3].map(|_| random.normal());
        for function in 0..16 {
            let along = |axis: usize, x: f64| {
                let mut moved = at;
                moved[axis] = x;
                sh::basis(3, linear::normalize(moved))[function]
            };
            let mut axis = 0;
            let lifted = at.map(|x| {
                axis += 1;
                Dual::<3>::variable(x, Some(axis - 1))
            });
            let dual = sh::basis(3, linear::normalize(lifted))[function];
            for axis in 0..3 {
                let step = 1e-4 * linear::dot(at, at).sqrt();
                let difference = central_difference(|x| along(axis, x), at[axis], step);
                assert_close(dual.d[axis], difference, 1e-8, 1.0);
            }
        }
    }
}
