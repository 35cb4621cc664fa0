//! Sampled pixels of frames: equality with the whole frame, and bounds that are neither loose nor violated.

use crate::common::scenes::{self, Scene};
use crate::reference::metamorphic::draw;
use ashfall::reference::sample::{PixelBound, sample, spread};
use glam::DVec2;

fn all(scene: &Scene) -> Vec<PixelBound> {
    let pixels: Vec<usize> = (0..(scene.camera.width * scene.camera.height) as usize).collect();
    sample(&scene.splats, &scene.camera, &scene.options, &pixels)
}

fn error(sampled: &PixelBound, color: [f64; 3]) -> f64 {
    let errors = (0..3).map(|c| (sampled.color[c] - color[c]).abs());
    errors.fold(0.0, f64::max)
}

#[test]
fn samples_are_pixels_of_the_frame() {
    for scene in [scenes::gentle(71, 80, 40, 30, 3), scenes::hard(72, 120, 33, 29, 2)] {
        let frame = draw(&scene);
        let mut bounds = Vec::new();
        for (sampled, pixel) in all(&scene).iter().zip(&frame.pixels) {
            // A sample differs from the frame only within its bound, for rays that may end early.
            let error = error(sampled, pixel.color);
            assert!(error < 1e-12 || error <= sampled.color_bound, "{error:e}");
            let passes = (sampled.transmittance - pixel.transmittance).abs();
            assert!(passes < 1e-12 || passes <= sampled.transmittance_bound);
            bounds.push(sampled.color_bound);
        }
        bounds.sort_by(f64::total_cmp);
        let median = bounds[bounds.len() / 2];
        println!("median {median:.1e}, largest {:.1e}", bounds[bounds.len() - 1]);
        assert!((1e-6..3e-4).contains(&median), "{median:e}");
    }
}

/// A shift of the camera within single-precision rounding moves no pixel beyond its bound; a shift a thousand times
/// larger exceeds it.
#[test]
fn bounds_hold_under_perturbation_and_tell_a_thousandth() {
    let scene = scenes::hard(73, 150, 40, 33, 1);
    let sampled = all(&scene);
    let moved = |by: f64| {
        let mut moved = scene.clone();
        moved.camera.center += DVec2::new(by, -by);
        draw(&moved)
    };
    // Position errors within rounding: 16U of a focal length of 36 px or more.
    let slight = moved(2e-5);
    let gross = moved(2e-2);
    let excess = |frame: &ashfall::reference::Frame<f64>| -> f64 {
        let each = sampled.iter().zip(&frame.pixels);
        each.map(|(s, p)| error(s, p.color) / s.color_bound).fold(0.0, f64::max)
    };
    assert!(excess(&slight) <= 1.0, "{}", excess(&slight));
    assert!(excess(&gross) > 2.0, "{}", excess(&gross));
}

#[test]
fn pixels_are_spread_over_the_image() {
    assert_eq!(spread(3, 2, 10), [0, 1, 2, 3, 4, 5]);
    let chosen = spread(100, 80, 200);
    assert!(chosen.len() > 190 && chosen[0] == 0 && chosen[chosen.len() - 1] == 7999);
    for quarter in 0..4 {
        let inside = chosen.iter().filter(|&&i| {
            let (x, y) = (i % 100, i / 100);
            (x >= 50) == (quarter % 2 == 1) && (y >= 40) == (quarter / 2 == 1)
        });
        let count = inside.count();
        assert!((40..60).contains(&count), "{count}");
    }
    assert_eq!(spread(16_385, 1, 300).len(), 300);
}
