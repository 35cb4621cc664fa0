//! Poses of the photographs, refined in training.

use crate::common::device;
use ashfall::lab::synth::{Kind, SynthOptions, scene};
use ashfall::scene::{Camera, Dataset, PoseDifference, Primitive, Similarity, Split};
use ashfall::train::{TrainConfig, Trainer};

/// A made scene whose training cameras have errors of so many half degrees and half percents of the extent.
fn made(errors: f64) -> Dataset {
    scene(Kind::Demo).dataset(&SynthOptions {
        views: 17,
        width: 96,
        height: 72,
        samples: 2,
        points: 800,
        tracks: true,
        pose_seed: (errors > 0.0).then_some(1),
        pose_amount: errors,
        ..SynthOptions::default()
    })
}

fn cameras(dataset: &Dataset) -> Vec<Camera> {
    let views = dataset.split(Split::Train).into_iter();
    views.map(|view| dataset.views[view].camera).collect()
}

/// Root mean square of the angles to the exact poses, degrees, after the best similarity.
fn error_degrees(cameras: &[Camera], exact: &[Camera]) -> f64 {
    let similarity = Similarity::between(cameras, exact);
    let pairs = cameras.iter().zip(exact);
    let all = pairs.map(|(camera, exact)| PoseDifference::of(&similarity.moved(camera), exact));
    PoseDifference::rms(&all.collect::<Vec<_>>()).degrees
}

/// A run's mean loss over the last steps, its refined cameras, and predicted over held bytes.
fn train(dataset: &Dataset, config: TrainConfig) -> (f64, Option<Vec<Camera>>, f64) {
    let gpu = device::limited(None);
    let mut trainer = Trainer::new(&gpu, dataset, config).unwrap();
    let mut loss = 0.0;
    while !trainer.is_done() {
        if let Some(report) = trainer.step().unwrap() {
            loss = 0.9 * loss + 0.1 * report.loss;
        }
    }
    trainer.finish().unwrap();
    let ratio = trainer.size().bytes() as f64 / gpu.memory_peak() as f64;
    let refined = trainer.refined_dataset().unwrap();
    (loss, refined.map(|dataset| cameras(&dataset)), ratio)
}

fn config(iterations: u32) -> TrainConfig {
    TrainConfig {
        refine_poses: true,
        sh_degree: 0,
        ..TrainConfig::for_iterations(iterations)
    }
}

#[test]
fn errors_of_poses_fall_and_pictures_fit_again() {
    let exact = cameras(&made(0.0));
    let disturbed = made(1.0);
    let kept = TrainConfig {
        refine_poses: false,
        ..config(200)
    };
    let (kept, none, _) = train(&disturbed, kept);
    assert!(none.is_none());
    for kind in [Primitive::Gaussian3d, Primitive::Surfel] {
        let config = TrainConfig { kind, ..config(200) };
        let (loss, refined, ratio) = train(&disturbed, config);
        let refined = refined.unwrap();
        let gauge = Similarity::between(&cameras(&disturbed), &refined);
        assert!(gauge.degrees() < 1e-4 && (gauge.scale - 1.0).abs() < 1e-6, "{gauge:?}");
        let [before, after] = [&cameras(&disturbed), &refined].map(|cameras| error_degrees(cameras, &exact));
        println!("{kind:?}: {before:.3}° before, {after:.3}° after; loss {loss:.4}, {kept:.4} without; {ratio:.3}");
        assert!(
            (0.4..0.6).contains(&before) && after < 0.6 * before,
            "{after}° after, {before}° before"
        );
        assert!(loss < 0.8 * kept, "{loss} with, {kept} without");
        assert!((0.9..1.2).contains(&ratio), "{ratio} of the held bytes predicted");
    }
}

#[test]
fn exact_poses_stay_and_rounds_repeat_to_the_bit() {
    let exact = made(0.0);
    let run = || train(&exact, config(120)).1.unwrap();
    let refined = run();
    assert!(refined == run(), "not the same bits twice");
    let moved = error_degrees(&refined, &cameras(&exact));
    println!("moved by {moved:.4}°");
    assert!(moved < 0.05 && moved > 0.0, "moved by {moved}°");
}
