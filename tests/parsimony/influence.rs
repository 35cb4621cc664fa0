//! What splats do to pictures, held against pictures without them.

use super::device::gpu;
use super::scenes::{self, Random};
use super::{lens, weigher};
use ashfall::parsimony::kept;
use ashfall::render::Compatibility;

#[test]
fn what_would_change_without_a_splat_is_what_does() {
    let gpu = gpu();
    for (scene, compatibility) in [
        (scenes::gentle(31, 40, 40, 30, 1), Compatibility::Engine),
        (scenes::hard(32, 30, 33, 28, 2), Compatibility::Original),
    ] {
        let lens = lens(&scene.options, compatibility);
        let mut whole = weigher(&gpu, &scene.splats, lens);
        let pixels = (scene.camera.width * scene.camera.height) as usize;
        let before = whole.show(&scene.camera).unwrap().planes;
        let found = whole.influences(&scene.camera, None).unwrap();
        let covered: f32 = before[3 * pixels..]
            .iter()
            .map(|passing| 1.0 - passing)
            .sum();
        let weights: f32 = found.iter().map(|influence| influence.weight).sum();
        assert!(
            (weights / covered - 1.0).abs() < 1e-4,
            "{weights} of {covered}"
        );
        let mut seen = 0;
        for (splat, influence) in found.iter().enumerate() {
            let mut gone = vec![false; scene.splats.len()];
            gone[splat] = true;
            let mut rest = weigher(&gpu, &kept(&scene.splats, &gone), lens);
            let after = rest.show(&scene.camera).unwrap().planes;
            let changes = before.iter().zip(&after).take(3 * pixels);
            let change: f64 = changes.map(|(a, b)| f64::from(a - b).powi(2)).sum();
            // Where a pixel had ended, what comes to light is not what was behind: 1e-4 of it.
            let off = (f64::from(influence.change) - change).abs();
            assert!(
                off <= 2e-3 * change + 1e-6,
                "splat {splat}: {influence:?}, {change}"
            );
            seen += usize::from(change > 1e-3);
        }
        assert!(seen > scene.splats.len() / 4, "{seen} splats are seen");
    }
}

#[test]
fn errors_go_to_those_whose_pixels_have_them() {
    let gpu = gpu();
    let scene = scenes::gentle(33, 40, 40, 30, 0);
    let mut whole = weigher(
        &gpu,
        &scene.splats,
        lens(&scene.options, Compatibility::Engine),
    );
    let random = &mut Random::new(5);
    let errors: Vec<f32> = (0..40 * 30)
        .map(|_| random.between(0.0, 1.0) as f32)
        .collect();
    let shown = whole.show(&scene.camera).unwrap().planes;
    let judge = |planes: &[f32]| {
        assert_eq!(planes, &shown[..planes.len()]);
        errors.clone()
    };
    let found = whole.influences(&scene.camera, Some(&judge)).unwrap();
    let sum: f32 = found.iter().map(|influence| influence.error).sum();
    let covered = errors.iter().zip(&shown[3 * errors.len()..]);
    let wanted: f32 = covered
        .map(|(error, passing)| error * (1.0 - passing))
        .sum();
    assert!((sum / wanted - 1.0).abs() < 1e-4, "{sum}, not {wanted}");
    let alike = whole.influences(&scene.camera, None).unwrap();
    assert!(alike.iter().all(|influence| influence.error == 0.0));
}
