//! Section 2 of the catalogue, second part: intrinsics, and the precision of positions.

use crate::common::scenes::{self, Random};
use crate::stability::lab::{U, apart, image_bound, lab, percentile, same, within};
use crate::stability::projection::{gradient_errors, scaled};
use crate::stability::props::{OPAQUE, Prop, place, stage};
use ashfall::reference::{Splat, Viewpoint, project};
use ashfall::scene::Camera;
use glam::{DMat3, DVec2, DVec3};

/// A principal point far outside the image, as in a crop of a larger image.
#[test]
fn f016_principal_point() {
    let lab = lab();
    for (cx, cy) in [(-5.0, 0.5), (0.5, 4.0), (3.0, -2.0)] {
        let mut scene = stage(48, 40);
        scene.camera.focal *= 2.0;
        scene.camera.center = DVec2::new(cx * 48.0, cy * 40.0);
        let random = &mut Random::new(316);
        for i in 0..30 {
            let pixel = [random.between(-5.0, 53.0), random.between(-5.0, 45.0)];
            let prop = Prop {
                depth: 2.0 + f64::from(i) * 0.1,
                sigma: [0; 3].map(|_| random.between(1.0, 5.0)),
                quaternion: [0; 4].map(|_| random.normal()),
                color: [0; 3].map(|_| random.between(0.1, 0.9)),
                ..Prop::ball(pixel, 1.0, 0.5)
            };
            place(&mut scene, &prop);
        }
        // Positions are sums of terms as large as the distance to the principal point.
        let error = apart(&scene, &lab.draw(&scene), 1e-3);
        let bound = image_bound(5 * 48, 0.55, 30, 1.0);
        within(
            "project",
            "16",
            &format!("principal point at ({cx}, {cy})"),
            error,
            bound,
        );
        let worst = percentile(&mut gradient_errors(&scene, 0..3), 1.0);
        within(
            "project_backward",
            "16",
            &format!("means' gradient, principal point at ({cx}, {cy})"),
            worst,
            1e-3,
        );
    }
}

#[test]
fn f017_sizes_and_pixels() {
    let lab = lab();
    for (width, height) in [
        (1, 1),
        (1, 17),
        (17, 1),
        (15, 16),
        (16, 17),
        (33, 47),
        (97, 129),
        (257, 5),
    ] {
        let scene = scenes::gentle(317, 30, width, height, 1);
        // Unequal focal lengths, principal point off the centre.
        assert!(scene.camera.focal.x != scene.camera.focal.y);
        let error = apart(&scene, &lab.draw(&scene), 1e-4);
        let bound = image_bound(width.max(height).max(8), 0.55, 30, 1.0);
        within("frame", "17", &format!("{width} × {height}"), error, bound);
    }
    // Intrinsics follow the rounded size per axis: corners stay corners.
    let camera = Camera {
        rotation: DMat3::IDENTITY,
        ..scenes::gentle(1, 0, 97, 129, 0).camera
    };
    let small = camera.resized(32, 43);
    for corner in [DVec3::new(0.0, 0.0, 1.0), DVec3::new(97.0, 129.0, 1.0)] {
        let ray = camera.ray_from_pixel(corner.truncate());
        let there = small.pixel_from_world(small.position + ray).unwrap();
        let expected = corner.truncate() * DVec2::new(32.0 / 97.0, 43.0 / 129.0);
        assert!((there - expected).length() < 1e-9, "{there} is not {expected}");
    }
}

/// A splat at the centre of a pixel is drawn with the symmetry of the pixel grid.
#[test]
fn f018_pixel_centres() {
    let lab = lab();
    let mut scene = stage(64, 64);
    scene.camera.center = DVec2::splat(20.5);
    place(&mut scene, &Prop::ball([20.5, 20.5], 3.0, OPAQUE));
    let image = lab.draw(&scene);
    let at = |x: i32, y: i32| image.transmittance[((20 + y) * 64 + 20 + x) as usize];
    assert_eq!(
        at(0, 0),
        1.0 - 0.999_984_74,
        "the peak lies at the pixel's centre, and is capped"
    );
    for (x, y) in (0..12).flat_map(|y| (0..12).map(move |x| (x, y))) {
        let quarters = [at(x, y), at(-x, y), at(x, -y), at(-x, -y)].map(f32::to_bits);
        assert_eq!(quarters, [quarters[0]; 4], "({x}, {y})");
        let mirrored = f64::from((at(x, y) - at(y, x)).abs());
        assert!(mirrored <= 16.0 * U, "({x}, {y}) mirrored: {mirrored}");
    }
}

/// Far from the origin, differences of positions are taken first: positions distinct in f32 are drawn exactly.
#[test]
fn f019_far_from_the_origin() {
    let lab = lab();
    let mut scene = stage(48, 40);
    let random = &mut Random::new(319);
    for i in 0..40 {
        let prop = Prop {
            depth: 200.0 + f64::from(i) * 5.0,
            sigma: [0; 3].map(|_| random.between(1.0, 5.0)),
            quaternion: [0; 4].map(|_| random.normal()),
            color: [0; 3].map(|_| random.between(0.1, 0.9)),
            ..Prop::ball([random.between(0.0, 48.0), random.between(0.0, 40.0)], 1.0, 0.5)
        };
        place(&mut scene, &prop);
    }
    // Positions in steps of 1/2, distinct in f32 up to 2^23.
    for x in scene.splats.mean.iter_mut().flatten() {
        *x = (*x * 2.0).round() / 2.0;
    }
    let clean = lab.draw(&scene);
    for distance in [1e3, 6e5, 5e6] {
        let by = DVec3::new(distance, -distance * 0.5, 1e3);
        let mut far = scene.clone();
        far.camera.position += by;
        for mean in &mut far.splats.mean {
            *mean = (DVec3::from(mean.map(f64::from)) + by).as_vec3().to_array();
        }
        assert!(same(&lab.draw(&far), &clean), "{distance} from the origin");
    }
}

/// Positions on the largest screens.
#[test]
fn f020_pixel_positions() {
    let lab = lab();
    let mut scene = scenes::gentle(320, 2000, 7680, 4320, 0);
    scene.options.near = 0.05;
    let (records, tiles) = lab.records(&scene);
    let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
    let mut worst = 0.0f64;
    for (i, record) in records.iter().enumerate().filter(|(i, _)| tiles[*i] > 0) {
        let exact = project(&Splat::<f64>::of(&scene.splats, i), &view).unwrap().mean;
        for (found, exact) in record.shape[..2].iter().zip(exact) {
            worst = worst.max((f64::from(*found) - exact).abs());
        }
    }
    // A view coordinate is a sum of three products of numbers up to 4, 8 · 4U of a depth of 2 at least; times the
    // focal length of up to 1.2 · 7680 px that is 9e-3 px in the worst case of all signs, and with signs at random
    // a tenth of it. The quotient and the principal point add 2U of 7680 px.
    within("project", "20", "position at 7680 × 4320, px", worst, 2e-3);
}

/// Divisors are unbiased: with depths scaled to a thousandth, pixels are the same.
#[test]
fn f021_biased_divisor() {
    let lab = lab();
    let scene = scenes::gentle(321, 100, 640, 480, 0);
    let (clean, _) = lab.records(&scene);
    for power in [-10, -20, -40] {
        let (small, tiles) = lab.records(&scaled(&scene, 2f64.powi(power)));
        for (i, (now, was)) in small.iter().zip(&clean).enumerate() {
            assert!(
                tiles[i] > 0 && now.shape[..2] == was.shape[..2],
                "2^{power}: {now:?}, {was:?}"
            );
        }
    }
}
