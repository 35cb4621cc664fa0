//! Smoothing of depths within surfaces.

use super::mesh::around;
use super::noise::noise;
use ashfall::mesh::DepthMap;
use ashfall::scene::Camera;
use glam::DVec2;

/// Camera and place of each of its pixels, row by row.
fn pixels() -> (Camera, Vec<DVec2>) {
    let camera = around(1, 4.0)[0];
    let (width, height) = (camera.width as usize, camera.height as usize);
    let place = |i: usize| DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
    (camera, (0..width * height).map(place).collect())
}

/// Depths, smoothed.
fn smoothed(camera: &Camera, depth: &[f32], deviation: f64) -> Vec<f32> {
    let count = depth.len();
    let normal = vec![[0.0, 0.0, 1.0]; count];
    let mut map = DepthMap::new(camera, depth, &normal, &vec![[0.5; 3]; count], &vec![1.0; count]);
    map.smooth(deviation);
    map.depth
}

/// Root mean square of the relative differences from a map.
fn error(depth: &[f32], truth: &[f32]) -> f64 {
    let squares = depth.iter().zip(truth).map(|(a, b)| f64::from(a / b - 1.0).powi(2));
    (squares.sum::<f64>() / depth.len() as f64).sqrt()
}

/// A plane whose depth doubles across the picture.
fn plane(camera: &Camera, places: &[DVec2]) -> Vec<f32> {
    let size = DVec2::new(camera.width.into(), camera.height.into());
    let inverse = |place: &DVec2| 0.25 + 0.2 * place.x / size.x + 0.05 * place.y / size.y;
    places.iter().map(|place| inverse(place).recip() as f32).collect()
}

#[test]
fn planes_stay_exact_up_to_the_border() {
    let (camera, places) = pixels();
    let truth = plane(&camera, &places);
    let smooth = smoothed(&camera, &truth, 1.5);
    // Sums of 29 numbers of 24 bits.
    assert!(smooth.iter().zip(&truth).all(|(a, b)| (a / b - 1.0).abs() < 2e-6));
    assert!(smoothed(&camera, &truth, 0.0) == truth);
}

#[test]
fn noise_shrinks_as_by_a_gaussian() {
    let (camera, places) = pixels();
    let truth = plane(&camera, &places);
    let mut random = noise();
    // A tenth of a footprint, far below the details that stay.
    let scale = 0.1 / camera.focal.max_element() as f32;
    let noisy: Vec<f32> = truth.iter().map(|depth| depth * (1.0 + scale * random())).collect();
    let smooth = smoothed(&camera, &noisy, 1.5);
    let ratio = error(&smooth, &truth) / error(&noisy, &truth);
    // White noise, a Gaussian of 1.5 pixels: 1 / √(4π) / 1.5 = 0.19 but for its end and the border of the picture.
    println!("{ratio:.3} of the noise");
    assert!((0.17..0.27).contains(&ratio));
}

#[test]
fn steps_and_holes_stay() {
    let (camera, places) = pixels();
    let middle = f64::from(camera.width / 2);
    let is_hole = |place: &DVec2| place.distance(camera.center) < 4.0;
    let truth = plane(&camera, &places);
    let depth = |(place, depth): (&DVec2, &f32)| match is_hole(place) {
        true => f32::NAN,
        false if place.x < middle => *depth,
        false => 1.2 * depth,
    };
    let step: Vec<f32> = places.iter().zip(&truth).map(depth).collect();
    let smooth = smoothed(&camera, &step, 1.5);
    for (i, place) in places.iter().enumerate() {
        assert_eq!(smooth[i].is_nan(), is_hole(place));
        assert!(is_hole(place) || (smooth[i] / step[i] - 1.0).abs() < 1e-4);
    }
}
