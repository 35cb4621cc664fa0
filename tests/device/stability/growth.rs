//! Section 8 of the catalogue, first part: density control and initialisation.

use crate::common::scenes::{self, Random, Scene};
use crate::stability::lab::{Lesson, lab, within};
use crate::stability::props::{Prop, logit, place, stage};
use ashfall::scene::{Dataset, Photo, PhotoSource, Point, View};
use ashfall::train::strategy::{self, RefineContext, RefineReport, SplatStats};
use ashfall::train::{HostState, TrainConfig, initial_splats};

/// The densification threshold is independent of the image size.
#[test]
fn f077_threshold_of_every_size() {
    let lab = lab();
    let mut scene = stage(96, 64);
    let random = &mut Random::new(877);
    for i in 0..200 {
        let prop = Prop {
            depth: 2.0 + f64::from(i) * 0.02,
            sigma: [0; 3].map(|_| random.between(4.0, 9.0)),
            quaternion: [0; 4].map(|_| random.normal()),
            color: [0; 3].map(|_| random.between(0.1, 0.9)),
            ..Prop::ball([random.between(0.0, 96.0), random.between(0.0, 64.0)], 1.0, -1.0)
        };
        place(&mut scene, &prop);
    }
    let mut large = scene.clone();
    large.camera = scene.camera.resized(192, 128);
    // Black to the left, white to the right: every pixel's gradient is known, and the same at every size.
    let lesson = |scene: &Scene| {
        let width = scene.camera.width as usize;
        let mut lesson = Lesson::flat(scene, 0);
        for (_i, pixel) in lesson
            .rgba
            .iter_mut()
            .enumerate()
            .filter(|(i, _)| 2 * (i % width) >= width)
        {
            *pixel = [255; 4];
        }
        lesson
    };
    let gradients = |scene: &Scene| -> Vec<f32> {
        let statistics = lab.step(scene, &lesson(scene)).statistics;
        statistics.iter().map(|s| s[0]).collect()
    };
    let (small, large) = (gradients(&scene), gradients(&large));
    let mut sorted = small.clone();
    sorted.sort_by(f32::total_cmp);
    let threshold = sorted[100];
    let differ = small
        .iter()
        .zip(&large)
        .filter(|(s, l)| (**s > threshold) != (**l > threshold))
        .count();
    // Few splats lie within 2 % of the median, the error of sampling a σ of 4 px and of the dilation.
    within(
        "train",
        "77",
        "splats chosen at one size only, share",
        differ as f64 / 200.0,
        0.02,
    );
}

/// A state of splats of given opacity and size; the colour is the row index.
pub(crate) fn state_of(splats: &[(f64, f64)]) -> HostState {
    let mut state = HostState::zeros(splats.len(), 0);
    let random = &mut Random::new(8);
    for (row, &(opacity, scale)) in splats.iter().enumerate() {
        let [x, y, z] = [0; 3].map(|_| random.normal() as f32);
        state.params[0][row] = [x, y, z, if opacity.is_finite() { logit(opacity) } else { f32::NAN }];
        state.params[1][row] = [1.0, 0.0, 0.0, 0.0];
        state.params[2][row] = [scale.ln() as f32, scale.ln() as f32, scale.ln() as f32, 0.0];
        state.params[3][row] = [row as f32, 0.0, 0.0, 0.0];
    }
    state
}

pub(crate) fn refine(config: &TrainConfig, state: &mut HostState, stats: &[SplatStats]) -> RefineReport {
    let context = RefineContext {
        iteration: 5_000,
        config,
        extent: 1.0,
        limit: config.splat_limit(),
        sky: None,
    };
    strategy::refine(state, stats, context)
}

/// A splat that was seen too large is removed by one refinement: the radii are still available then.
#[test]
fn f078_oversized_splats_go() {
    let mut config = TrainConfig::default();
    config.adc.prune_radius_px = 20.0;
    let mut state = state_of(&[(0.5, 0.001); 3]);
    let stats = [[0.0, 1.0, 21.0, 0.0], [0.0, 1.0, 19.0, 0.0], [0.0, 1.0, 1.0, 0.0]];
    let report = refine(&config, &mut state, &stats);
    assert_eq!((report.pruned, report.count), (1, 2));
    assert!(state.params[3].iter().all(|sh| sh[0] != 0.0), "another one is gone");
}

/// The halves of a split needle lie on both sides of its mean along it; an option of training bounds eccentricity.
#[test]
fn f085_split_of_needles() {
    let mut state = state_of(&[(0.5, 0.05)]);
    state.params[0][0][..3].fill(0.0);
    state.params[2][0] = [0.05f32.ln(), 5e-4f32.ln(), 0.005f32.ln(), 0.0];
    let config = TrainConfig::default();
    let report = refine(&config, &mut state, &[[1.0, 1.0, 1.0, 0.0]]);
    assert_eq!((report.split, report.count), (1, 2));
    let places = [state.mean(0), state.mean(1)].map(|mean| mean.map(f64::from));
    for (axis, wanted) in [0.05, 0.0, 0.0].into_iter().enumerate() {
        for place in places {
            let error = (place[axis].abs() - wanted).abs();
            within(
                "train",
                "85",
                &format!("halves' distance along axis {axis}"),
                error,
                1e-8,
            );
        }
    }
    assert!(places[0][0] * places[1][0] < 0.0, "both halves lie on one side");
    for (axis, wanted) in [0.03125, 3.125e-4, 0.003125].into_iter().enumerate() {
        let scale = f64::from(state.params[2][0][axis]).exp();
        assert!((scale / wanted - 1.0).abs() < 1e-5, "a half's scale is {scale}");
    }
}

/// Coincident cameras, coincident points, almost no points, NaN points.
#[test]
fn f086_degenerate_starts() {
    let scene = scenes::gentle(886, 0, 24, 20, 0);
    let photo = Photo {
        width: 24,
        height: 20,
        rgba: vec![[0; 4]; 480],
    };
    let view = View {
        name: "v".into(),
        camera: scene.camera,
        photo: PhotoSource::Memory(photo),
    };
    let config = TrainConfig::for_iterations(100);
    let at = |x: f64| Point {
        position: [x, 1.0, 2.0],
        color: [0.5; 3],
    };
    for points in [
        vec![],
        vec![at(0.0)],
        vec![at(0.0), at(1.0)],
        vec![at(0.0); 40],
        vec![at(f64::NAN), at(0.0), at(f64::INFINITY)],
        vec![at(f64::NAN); 3],
        vec![at(1e30), at(-1e30), at(0.0), at(1e-30)],
    ] {
        let dataset = Dataset {
            views: vec![view.clone(), view.clone(), view.clone()],
            points,
            ..Dataset::default()
        };
        let extent = dataset.extent();
        assert!(extent.is_finite() && extent > 0.0, "an extent of {extent}");
        let splats = initial_splats(&dataset, extent, &config).unwrap();
        let state = HostState::from_splats(&splats, config.sh_degree);
        assert!(!splats.is_empty());
        for row in 0..state.len() {
            assert!(state.is_finite(row) && state.max_scale(row) > 0.0, "{:?}", state.params);
        }
    }
}
