//! Splats of several SH degrees in one scene: trained as if all had the highest, except for the absent coefficients.

use crate::common::device;
use crate::common::scenes::{self, Scene};
use crate::gradients::oracle::compare_smoothed;
use crate::gradients::{BEGUN, config, dataset, step_from};
use ashfall::gpu::Gpu;
use ashfall::render::{Blocks, Precision, of_degree};
use ashfall::scene::sh_coefficient_count;
use ashfall::train::checkpoint::{Checkpoint, fingerprint};
use ashfall::train::state::Planes;
use ashfall::train::{HostState, StrategyKind, TrainConfig, Trainer};

/// SH degree of a splat by index: of every eight splats four have 0, two 1, one 2, and one 3.
fn degree(splat: usize) -> u8 {
    [0, 3, 0, 1, 0, 2, 1, 0][splat % 8]
}

fn degrees(scene: &Scene) -> Vec<u8> {
    (0..scene.splats.len()).map(degree).collect()
}

/// The scene with the coefficients above each splat's degree set to zero.
fn mixed(mut scene: Scene) -> Scene {
    let stride = scene.splats.sh_stride();
    for (splat, row) in scene.splats.sh.chunks_mut(stride).enumerate() {
        row[3 * sh_coefficient_count(degree(splat).into())..].fill(0.0);
    }
    scene
}

#[test]
fn gradients_of_several_degrees_are_the_oracles() {
    let scenes = [
        mixed(scenes::gentle(150, 64, 64, 48, 3)),
        mixed(scenes::hard(153, 90, 64, 48, 3)),
    ];
    compare_smoothed("mixed", &scenes.map(|scene| (scene, Vec::new())));
}

/// Both states of a scene: each splat with its own degree, and all with the highest, padded with zeros.
fn states(scene: &Scene) -> [HostState; 2] {
    let whole = HostState::from_splats(&scene.splats, scene.splats.sh_degree);
    let mut lowered = whole.clone();
    lowered.lower_degrees(&degrees(scene));
    assert_eq!(lowered.params, whole.params);
    [lowered, whole]
}

/// The bits of all coefficients within the splats' degrees; zeros without their sign, which a sum with more zeros may
/// change.
fn own(planes: &Planes) -> Vec<u32> {
    let mut numbers = Vec::new();
    for splat in 0..planes[0].len() {
        let row = planes.iter().flat_map(|plane| plane[splat]);
        let kept = 12 + 3 * sh_coefficient_count(degree(splat).into());
        numbers.extend(row.take(kept).map(|x| (x + 0.0).to_bits()));
    }
    numbers
}

#[test]
fn a_step_is_that_of_the_highest_degree_to_the_bit() {
    let gpu = device::gpu();
    for scene in [
        mixed(scenes::gentle(160, 700, 64, 48, 3)),
        mixed(scenes::hard(161, 270, 64, 48, 3)),
    ] {
        let [lowered, whole] = states(&scene).map(|state| step_from(&gpu, &scene, &state));
        assert!(lowered.image == whole.image, "another picture");
        assert_eq!(lowered.report, whole.report);
        assert!(own(&lowered.gradients) == own(&whole.gradients));
        for (lowered, whole) in [
            (&lowered.after.params, &whole.after.params),
            (&lowered.after.m, &whole.after.m),
            (&lowered.after.v, &whole.after.v),
        ] {
            assert!(own(lowered) == own(whole), "another step");
            assert!(lowered != whole, "the bands above were not trained either");
        }
    }
}

/// State and statistics after seven steps from a state, noise included.
fn steps(gpu: &Gpu, scene: &Scene, config: TrainConfig, state: &HostState) -> (HostState, Vec<[f32; 4]>) {
    let dataset = dataset(scene, &scene.camera);
    let mut trainer = Trainer::from_state(gpu, &dataset, config, state, BEGUN).unwrap();
    for _ in 0..7 {
        trainer.step().unwrap();
    }
    (trainer.download().unwrap(), trainer.statistics().unwrap())
}

#[test]
fn runs_are_those_of_the_highest_degree_while_harmonics_rest() {
    let gpu = device::gpu();
    let scene = mixed(scenes::gentle(162, 300, 64, 48, 3));
    let mut config = config(&scene).with_strategy(StrategyKind::Mcmc);
    config.rates.sh_rest = 0.0;
    let [lowered, whole] = states(&scene).map(|state| steps(&gpu, &scene, config.clone(), &state));
    assert!(own(&lowered.0.params) == own(&whole.0.params));
    assert!(own(&lowered.0.v) == own(&whole.0.v));
    assert!(lowered.1 == whole.1, "other statistics");
    let noise = |state: &HostState| state.params[0][1];
    config.mcmc.noise_rate = 0.0;
    let [quiet, _] = states(&scene).map(|state| steps(&gpu, &scene, config.clone(), &state));
    assert_ne!(noise(&quiet.0), noise(&lowered.0), "nothing was perturbed");
}

#[test]
fn a_run_of_several_degrees_repeats_and_resumes_to_the_bit() {
    let gpu = device::gpu();
    let scene = mixed(scenes::hard(163, 270, 64, 48, 3));
    let dataset = dataset(&scene, &scene.camera);
    let [start, _] = states(&scene);
    let config = config(&scene);
    let run = || steps(&gpu, &scene, config.clone(), &start);
    let (end, statistics) = run();
    assert!(run() == (end.clone(), statistics.clone()), "not the same bits twice");
    assert_eq!(end.degrees, degrees(&scene));
    let mut first = Trainer::from_state(&gpu, &dataset, config.clone(), &start, BEGUN).unwrap();
    for _ in 0..3 {
        first.step().unwrap();
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    Checkpoint {
        config,
        iteration: first.iteration(),
        state: first.download().unwrap(),
        statistics: first.statistics().unwrap(),
        colors: first.pending_colors().unwrap(),
        fingerprint: fingerprint(&dataset),
        controller: None,
        exposure: None,
        poses: None,
        transients: None,
    }
    .write(&path)
    .unwrap();
    drop(first);
    let Checkpoint {
        config,
        iteration,
        state,
        statistics: known,
        colors,
        ..
    } = Checkpoint::read(&path).unwrap();
    let mut resumed = Trainer::from_state(&gpu, &dataset, config, &state, iteration).unwrap();
    resumed.set_statistics(&known).unwrap();
    resumed.set_pending_colors(&colors).unwrap();
    while resumed.iteration() < BEGUN + 7 {
        resumed.step().unwrap();
    }
    assert!(resumed.download().unwrap() == end, "resumed elsewhere");
    assert!(resumed.statistics().unwrap() == statistics);
}

#[test]
fn a_trainer_lowers_degrees_between_two_steps() {
    let gpu = device::gpu();
    let scene = scenes::gentle(164, 300, 64, 48, 3);
    let dataset = dataset(&scene, &scene.camera);
    let state = HostState::from_splats(&scene.splats, 3);
    let begin =
        |state: &HostState, iteration| Trainer::from_state(&gpu, &dataset, config(&scene), state, iteration).unwrap();
    let mut trainer = begin(&state, BEGUN);
    trainer.step().unwrap();
    let (mut between, statistics) = (trainer.download().unwrap(), trainer.statistics().unwrap());
    assert!(statistics.iter().any(|s| s[1] == 1.0));
    trainer.lower_degrees(&degrees(&scene)).unwrap();
    between.lower_degrees(&degrees(&scene));
    assert!(trainer.download().unwrap() == between);
    assert!(trainer.statistics().unwrap() == statistics);
    trainer.step().unwrap();
    // As from that state; the bands above the degrees stay zero.
    let mut other = begin(&between, BEGUN + 1);
    other.set_statistics(&statistics).unwrap();
    other.step().unwrap();
    assert!(trainer.download().unwrap() == other.download().unwrap());
    assert!(trainer.statistics().unwrap() == other.statistics().unwrap());
    let mut clean = trainer.download().unwrap();
    clean.degrees.fill(3);
    clean.lower_degrees(&degrees(&scene));
    assert!(trainer.download().unwrap() == clean, "a band has come back");
    // All at degree 0: a file without SH coefficients, and a third of the memory.
    trainer.lower_degrees(&[0; 300]).unwrap();
    trainer.step().unwrap();
    assert_eq!(trainer.splats().unwrap().sh_degree, 0);
    let vectors = [3, 0].map(|degree| Blocks::new(gpu.caps(), of_degree(300, degree), Precision::Full).vectors());
    assert_eq!(vectors, [300 * 15, 300 * 4]);
}
