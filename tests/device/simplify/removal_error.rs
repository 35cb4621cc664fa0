//! Effects of splats on pictures, against pictures without them.

use super::{pass_options, weigher};
use crate::common::device::gpu;
use crate::common::scenes;
use ashfall::render::Compatibility;
use ashfall::scene::ScreenFilter;
use ashfall::simplify::kept;

#[test]
fn what_would_change_without_a_splat_is_what_does() {
    let gpu = gpu();
    let surfels = scenes::flattened(scenes::gentle(31, 40, 40, 30, 1), ScreenFilter::Classic);
    for (scene, compatibility) in [
        (scenes::gentle(31, 40, 40, 30, 1), Compatibility::Engine),
        (surfels, Compatibility::Engine),
        (scenes::hard(32, 30, 33, 28, 2), Compatibility::Inria),
    ] {
        let pass_options = pass_options(&scene.options, compatibility);
        let mut whole = weigher(&gpu, &scene.splats, pass_options);
        let pixels = (scene.camera.width * scene.camera.height) as usize;
        let before = whole.show(&scene.camera).unwrap().planes;
        let found = whole.removal_errors(&scene.camera).unwrap();
        let covered: f32 = before[3 * pixels..].iter().map(|passing| 1.0 - passing).sum();
        let weights: f32 = found.iter().map(|removal_error| removal_error.weight).sum();
        assert!((weights / covered - 1.0).abs() < 1e-4, "{weights} of {covered}");
        let mut seen = 0;
        for (splat, removal_error) in found.iter().enumerate() {
            let mut gone = vec![false; scene.splats.len()];
            gone[splat] = true;
            let mut rest = weigher(&gpu, &kept(&scene.splats, &gone), pass_options);
            let after = rest.show(&scene.camera).unwrap().planes;
            let changes = before.iter().zip(&after).take(3 * pixels);
            let change: f64 = changes.map(|(a, b)| f64::from(a - b).powi(2)).sum();
            // Behind the transmittance threshold the revealed splats differ from the recorded ones: 1e-4 of the pixel.
            let off = (f64::from(removal_error.change) - change).abs();
            assert!(
                off <= 2e-3 * change + 1e-6,
                "splat {splat}: {removal_error:?}, {change}"
            );
            seen += usize::from(change > 1e-3);
        }
        assert!(seen > scene.splats.len() / 4, "{seen} splats are seen");
    }
}
