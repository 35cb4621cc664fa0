//! Lenses: closed inverses, special cases, folds, and wide photographs as several pinhole pictures.

use crate::common::files;
use ashfall::io::dataset::{self, OpenOptions};
use ashfall::io::photo;
use ashfall::scene::{Dataset, Distortion, Lens, PhotoSource, Split};
use glam::{DVec2, DVec3};
use std::fmt::Write as _;
use std::path::Path;

/// Directions up to an angle from the axis, in degrees.
fn directions(most: f64) -> Vec<DVec3> {
    let ring = |angle: f64| {
        (0..12).map(move |i| {
            let (sin, cos) = angle.to_radians().sin_cos();
            (sin * DVec2::from_angle(0.3 + f64::from(i) * 0.55)).extend(cos)
        })
    };
    (1..=20).flat_map(|i| ring(most * f64::from(i) / 20.0)).collect()
}

#[track_caller]
fn assert_same(a: DVec3, b: DVec3) {
    let angle = a.normalize().cross(b.normalize()).length();
    assert!(angle < 1e-9 && a.dot(b) > 0.0, "{a} {b}: {angle}");
}

#[test]
fn models_agree_with_their_closed_inverses() {
    for direction in directions(70.0) {
        let omega: f64 = 0.9;
        let at = Lens::FieldOfView(omega).project(direction).unwrap();
        let r = (at.length() * omega).tan() / (2.0 * (0.5 * omega).tan());
        assert_same((at.normalize() * r).extend(1.0), direction);
        for k in [-0.2, -0.05] {
            let at = Lens::Division(k).project(direction).unwrap();
            assert_same((at / (1.0 + k * at.length_squared())).extend(1.0), direction);
        }
    }
    for direction in directions(100.0) {
        let (alpha, beta): (f64, f64) = (0.62, 1.1);
        let at = Lens::Unified([alpha, beta]).project(direction).unwrap();
        let s = beta * at.length_squared();
        let z = (1.0 - alpha * alpha * s) / (alpha * (1.0 - (2.0 * alpha - 1.0) * s).sqrt() + 1.0 - alpha);
        assert_same(at.extend(z), direction);
    }
    for direction in directions(175.0) {
        let at = Lens::Fisheye([0.0; 4]).project(direction).unwrap();
        let (sin, cos) = at.length().sin_cos();
        assert_same((at.normalize() * sin).extend(cos), direction);
        let at = Lens::Equirectangular.project(direction).unwrap();
        let ((sin, cos), level) = (at.x.sin_cos(), at.y.cos());
        assert_same(DVec3::new(level * sin, at.y.sin(), level * cos), direction);
    }
}

#[test]
fn special_cases_are_those_of_smaller_models() {
    let brown = Lens::Brown(Distortion {
        k1: -0.1,
        k2: 0.02,
        p1: 1e-3,
        p2: -2e-3,
    });
    let rational = |radial| Lens::Rational {
        radial,
        tangential: [1e-3, -2e-3],
    };
    assert_eq!(rational([-0.1, 0.02, 0.0, 0.0, 0.0, 0.0]).simplified(), brown);
    let prism = |prism| Lens::ThinPrism {
        radial: [0.01, 0.02, 0.03, 0.04],
        tangential: [0.0; 2],
        prism,
    };
    assert_eq!(prism([0.0; 2]).simplified(), Lens::Fisheye([0.01, 0.02, 0.03, 0.04]));
    assert!(Lens::Division(0.0).is_none() && Lens::Brown(Distortion::default()).is_none());
    for direction in directions(60.0) {
        let plane = direction.truncate() / direction.z;
        let near = |lens: Lens, to: DVec2| {
            let at = lens.project(direction).unwrap();
            assert!(at.distance(to) < 1e-6, "{lens:?}: {at} {to}");
        };
        near(Lens::FieldOfView(1e-4), plane);
        near(Lens::FieldOfView(0.0), plane);
        near(Lens::Unified([0.0, 1.0]), plane);
        near(Lens::Division(1e-12), plane);
        // OpenCV's rational model, written out.
        let s = plane.length_squared();
        let ratio =
            (1.0 + 0.3 * s - 0.1 * s * s + 0.02 * s.powi(3)) / (1.0 + 0.2 * s + 0.01 * s * s + 0.003 * s.powi(3));
        let [x, y] = plane.to_array();
        let tangent = DVec2::new(
            2e-3 * x * y - 2e-3 * (s + 2.0 * x * x),
            -4e-3 * x * y + 1e-3 * (s + 2.0 * y * y),
        );
        near(rational([0.3, -0.1, 0.02, 0.2, 0.01, 0.003]), plane * ratio + tangent);
        // Six radial terms of which two remain, and no tangential ones.
        let aria = Lens::RadTanThinPrism {
            radial: [0.05, -0.01, 0.0, 0.0, 0.0, 0.0],
            tangential: [0.0; 2],
            prism: [1e-3, 0.0, 0.0, 2e-3],
        };
        let at = Lens::Fisheye([0.05, -0.01, 0.0, 0.0]).project(direction).unwrap();
        let s = at.length_squared();
        near(aria, at + DVec2::new(1e-3 * s, 2e-3 * s * s));
    }
}

#[test]
fn lenses_end_where_they_fold() {
    // θ (1 - 0.2 θ²) grows up to θ = 1 / √0.6.
    let reach = Lens::Fisheye([-0.2, 0.0, 0.0, 0.0]).reach();
    assert!((reach - 1.0 / 0.6_f64.sqrt()).abs() < 2e-3, "{reach}");
    assert_eq!(Lens::Fisheye([0.0; 4]).reach(), std::f64::consts::PI);
    // r (1 - 0.3 r²) grows up to r² = 1 / 0.9.
    let lens = Lens::Rational {
        radial: [-0.3, 0.0, 0.0, 0.0, 0.0, 1e-9],
        tangential: [0.0; 2],
    };
    assert!(
        (lens.reach().tan().powi(2) - 1.0 / 0.9).abs() < 0.01,
        "{}",
        lens.reach()
    );
    assert!(Lens::Division(-0.1).reach() > 1.5);
}

/// Colour of a direction, in levels: smooth, and different on all sides.
fn color(direction: DVec3) -> [u8; 3] {
    let d = direction.normalize();
    let wave = |x: f64| (127.5 + 100.0 * x.sin()).round() as u8;
    [
        wave(3.0 * d.x + 1.0),
        wave(4.0 * d.y - d.x),
        wave(3.0 * d.z + 2.0 * d.x),
    ]
}

/// A data set of wide photographs: each pixel is `ray` of its place from the middle, in focal lengths.
fn wide(folder: &Path, camera: &str, size: [u32; 2], focal: DVec2, ray: impl Fn(DVec2) -> Option<DVec3>) -> Dataset {
    let model = folder.join("sparse/0");
    std::fs::create_dir_all(&model).unwrap();
    std::fs::create_dir_all(folder.join("images")).unwrap();
    std::fs::write(model.join("cameras.txt"), format!("1 {camera}\n")).unwrap();
    let (mut images, mut points) = (String::new(), String::new());
    for pose in files::poses() {
        let glam::DQuat { x, y, z, w } = pose.quaternion;
        let t = pose.translation;
        let name = pose.name.replace(['/', ' '], "_");
        writeln!(
            images,
            "{} {w} {x} {y} {z} {} {} {} 1 {name}\n1 1 1",
            pose.id, t.x, t.y, t.z
        )
        .unwrap();
        let pixel = |x: u32, y: u32| {
            let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let place = (at - 0.5 * DVec2::new(size[0].into(), size[1].into())) / focal;
            let direction = ray(place).map(|ray| pose.rotation().transpose() * ray);
            image::Rgb(direction.map_or([0; 3], color))
        };
        let picture = image::RgbImage::from_fn(size[0], size[1], pixel);
        picture.save(folder.join("images").join(name)).unwrap();
    }
    writeln!(points, "1 0 0 9 10 20 30 0.5 7 0").unwrap();
    std::fs::write(model.join("images.txt"), images).unwrap();
    std::fs::write(model.join("points3D.txt"), points).unwrap();
    let options = OpenOptions {
        test_every: 2,
        ..OpenOptions::default()
    };
    dataset::open(folder, &options).unwrap()
}

/// Pixels of all views that show the colour of their direction, and those that show nothing.
#[track_caller]
fn check_directions(data: &Dataset) -> [usize; 2] {
    let (mut seen, mut empty) = (0, 0);
    for view in &data.views {
        let photo = photo::load(view).unwrap();
        for (i, pixel) in photo.rgba.iter().enumerate() {
            if pixel[3] < 255 {
                empty += 1;
                continue;
            }
            let width = photo.width as usize;
            let at = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let expected = color(view.camera.ray_from_pixel(at));
            // Bilinear sampling of waves of at least twenty pixels, and both roundings.
            let worst = (0..3).map(|c| pixel[c].abs_diff(expected[c])).max().unwrap();
            assert!(worst <= 5, "{} at {at}: {pixel:?}, not {expected:?}", view.name);
            seen += 1;
        }
    }
    [seen, empty]
}

#[test]
fn a_fisheye_is_seen_as_the_sides_of_a_cube() {
    let folder = tempfile::tempdir().unwrap();
    // 160 degrees across.
    let focal = 64.0 / 80_f64.to_radians();
    let camera = format!("SIMPLE_FISHEYE 128 128 {focal} 64 64");
    let ray = |place: DVec2| {
        let (sin, cos) = place.length().sin_cos();
        Some((place.normalize_or_zero() * sin).extend(cos))
    };
    let data = wide(folder.path(), &camera, [128, 128], DVec2::splat(focal), ray);
    let names: Vec<&str> = data.views[..5]
        .iter()
        .map(|view| view.name.rsplit('#').next().unwrap())
        .collect();
    assert_eq!(names, ["down", "front", "left", "right", "up"]);
    assert_eq!(data.views.len(), 15);
    assert!(
        data.warnings
            .iter()
            .any(|w| w.contains("3 wide photographs are seen as 15 pinhole pictures"))
    );
    let [seen, empty] = check_directions(&data);
    assert!(seen > 3 * 128 * 128 && empty > 0, "{seen} {empty}");
    // Whole photographs are held out, so that no test pixel is trained on.
    assert_eq!(data.split(Split::Test), [0, 1, 2, 3, 4, 10, 11, 12, 13, 14]);
    assert_eq!(data.split(Split::Train), [5, 6, 7, 8, 9]);
    let front = &data.views[1].camera;
    assert!(front.width < 110 && (front.focal.x - focal).abs() < 1e-9);
}

#[test]
fn a_panorama_has_six_sides() {
    let folder = tempfile::tempdir().unwrap();
    let size = [192, 96];
    let focal = DVec2::new(192.0 / std::f64::consts::TAU, 96.0 / std::f64::consts::PI);
    let ray = |place: DVec2| {
        let (sin, cos) = place.x.sin_cos();
        Some(DVec3::new(place.y.cos() * sin, place.y.sin(), place.y.cos() * cos))
    };
    let data = wide(folder.path(), "EQUIRECTANGULAR 192 96 192 96", size, focal, ray);
    assert_eq!(data.views.len(), 18);
    let [seen, empty] = check_directions(&data);
    assert!(empty < seen / 50, "{seen} {empty}: a panorama shows everything");
}

#[test]
fn a_narrow_fisheye_is_one_pinhole() {
    let folder = tempfile::tempdir().unwrap();
    let focal = 64.0 / 45_f64.to_radians();
    let camera = format!("FISHEYE 128 96 {focal} {focal} 64 48");
    let ray = |place: DVec2| {
        let (sin, cos) = place.length().sin_cos();
        Some((place.normalize_or_zero() * sin).extend(cos))
    };
    let data = wide(folder.path(), &camera, [128, 96], DVec2::splat(focal), ray);
    assert_eq!(data.views.len(), 3);
    assert_eq!((data.views[0].camera.width, data.views[0].camera.height), (128, 96));
    assert!(matches!(
        &data.views[0].photo,
        PhotoSource::File { optics: Some(_), .. }
    ));
    let [seen, _] = check_directions(&data);
    assert!(seen > 3 * 120 * 90);
}
