//! Undistortion against its inverse, and area-averaged reduction.

use crate::io::photo::{camera, save, view};
use ashfall::io::photo;
use ashfall::scene::{Camera, Distortion};
use glam::DVec2;

#[test]
fn reduction_averages_areas() {
    let folder = tempfile::tempdir().unwrap();
    let path = save(folder.path(), "a.png", |x, y| {
        image::Rgb([(16 * x) as u8, (64 * y) as u8, 8])
    });
    let half = photo::load(&view(&path, camera(8, 4).resized(4, 2), None)).unwrap();
    assert_eq!(half.rgba[0], [8, 32, 8, 255]);
    assert_eq!(half.rgba[7], [104, 160, 8, 255]);
    // 8 columns to 3: the first covers 2⅔ of them, (0 + 16 + 32 · ⅔) / 2⅔ = 14.
    let third = photo::load(&view(&path, camera(8, 4).resized(3, 2), None)).unwrap();
    assert_eq!(third.rgba[0], [14, 32, 8, 255]);
    // A flat image stays flat at any size.
    let path = save(folder.path(), "b.png", |_, _| image::Rgb([201u8, 3, 77]));
    for (width, height) in [(7, 4), (5, 3), (3, 2), (6, 3), (8, 4), (16, 8)] {
        let photo = photo::load(&view(&path, camera(8, 4).resized(width, height), None)).unwrap();
        assert_eq!(photo.rgba, vec![[201, 3, 77, 255]; (width * height) as usize]);
    }
    // Colours under transparent pixels have no weight.
    let path = save(folder.path(), "c.png", |x, _| match x % 2 {
        0 => image::Rgba([200u8, 100, 50, 255]),
        _ => image::Rgba([0, 0, 0, 0]),
    });
    let half = photo::load(&view(&path, camera(8, 4).resized(4, 2), None)).unwrap();
    assert_eq!(half.rgba, vec![[200, 100, 50, 128]; 8]);
}

/// A smooth picture of the plane at depth 1.
fn picture(at: DVec2) -> [f64; 3] {
    [
        120.0 + 100.0 * (3.0 * at.x).sin(),
        120.0 + 100.0 * (2.5 * at.y).cos(),
        120.0 + 60.0 * (2.0 * at.x - at.y).sin(),
    ]
}

/// OpenCV's formula, implemented independently.
fn distorted(at: DVec2, d: &Distortion) -> DVec2 {
    let r2 = at.x.powi(2) + at.y.powi(2);
    let scale = 1.0 + d.k1 * r2 + d.k2 * r2.powi(2);
    DVec2::new(
        at.x * scale + 2.0 * d.p1 * at.x * at.y + d.p2 * (r2 + 2.0 * at.x.powi(2)),
        at.y * scale + d.p1 * (r2 + 2.0 * at.y.powi(2)) + 2.0 * d.p2 * at.x * at.y,
    )
}

#[test]
fn undistortion_inverts_the_lens() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let camera = camera(96, 64);
    for (k1, k2, p1, p2) in [
        (-0.2, 0.03, 0.004, -0.003),
        (0.15, 0.05, 0.0, 0.0),
        (0.0, 0.0, 0.01, 0.01),
    ] {
        let lens = Distortion { k1, k2, p1, p2 };
        // The photograph: pixels at distorted positions of the picture.
        let seen = |x: u32, y: u32| {
            let pixel = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let target = (pixel - camera.center) / camera.focal;
            let mut ideal = target;
            for _ in 0..100 {
                ideal += target - distorted(ideal, &lens);
            }
            image::Rgb(picture(ideal).map(|c| c.round() as u8))
        };
        image::RgbImage::from_fn(96, 64, seen).save(&path).unwrap();
        let photo = photo::load(&view(&path, camera, Some(lens))).unwrap();
        let mut empty = 0;
        for (i, pixel) in photo.rgba.iter().enumerate() {
            let at = DVec2::new((i % 96) as f64 + 0.5, (i / 96) as f64 + 0.5);
            let ideal = (at - camera.center) / camera.focal;
            let source = distorted(ideal, &lens) * camera.focal + camera.center;
            let inside = source.min_element() >= 0.0 && source.x < 96.0 && source.y < 64.0;
            assert_eq!(pixel[3], if inside { 255 } else { 0 }, "pixel {at}");
            if !inside {
                assert_eq!(*pixel, [0; 4]);
                empty += 1;
                continue;
            }
            // Within half a pixel of the border there is no neighbour for interpolation.
            let margin = source.min_element().min(96.0 - source.x).min(64.0 - source.y);
            let tolerance = if margin < 0.5 { 4.0 } else { 1.6 };
            for (got, expected) in pixel.iter().zip(picture(ideal)) {
                assert!(
                    (f64::from(*got) - expected).abs() < tolerance,
                    "{lens:?} {at}: {got} {expected}"
                );
            }
        }
        assert!(empty > 0 || k1 < 0.0, "a cushion leaves empty borders");
    }
}

#[test]
fn a_lens_that_folds_back_shows_nothing_twice() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    image::RgbImage::from_pixel(64, 64, image::Rgb([9, 9, 9]))
        .save(&path)
        .unwrap();
    let wide = Camera {
        focal: DVec2::splat(20.0),
        center: DVec2::splat(32.0),
        ..camera(64, 64)
    };
    // r (1 - 0.3 r²) increases up to r = 1.054: 21 pixels from the centre.
    let lens = Distortion {
        k1: -0.3,
        ..Distortion::default()
    };
    let photo = photo::load(&view(&path, wide, Some(lens))).unwrap();
    for (i, pixel) in photo.rgba.iter().enumerate() {
        let at = DVec2::new((i % 64) as f64 + 0.5, (i / 64) as f64 + 0.5);
        let radius = at.distance(wide.center) / 20.0;
        assert_eq!(pixel[3] == 255, radius * radius < 1.0 / 0.9, "{at}");
    }
}
