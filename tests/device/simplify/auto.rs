//! Automatic splat counts: built-in scenes, small pictures, short runs.

use crate::common::device::gpu;
use ashfall::Result;
use ashfall::gpu::Gpu;
use ashfall::lab::synth::{Kind, SynthOptions, scene};
use ashfall::scene::{Dataset, PhotoSource, Point, Split};
use ashfall::simplify::{Act, AutoRun, CountController, History, Phase, ViewScores, for_auto_count, split_views};
use ashfall::stats::mean;
use ashfall::train::checkpoint::Checkpoint;
use ashfall::train::config::AutoConfig;
use ashfall::train::{Controller, HostState, StrategyKind, TrainConfig, Trainer};
use std::path::Path;

const ITERATIONS: u32 = 320;

/// Photographs of a scene.
const VIEWS: usize = 20;

fn options() -> SynthOptions {
    SynthOptions {
        views: VIEWS,
        width: 64,
        height: 48,
        points: 400,
        ..SynthOptions::default()
    }
}

fn dataset(kind: Kind) -> Dataset {
    scene(kind).dataset(&options())
}

fn config(strategy: StrategyKind) -> TrainConfig {
    let config = TrainConfig {
        sh_degree: 1,
        ..TrainConfig::for_iterations(ITERATIONS)
    };
    for_auto_count(config.with_strategy(strategy), VIEWS as f64)
}

/// Iterations of a longer run, and of a round in it.
const LONGER: u32 = 400;
const ROUND: usize = 20;

fn longer() -> TrainConfig {
    let config = TrainConfig {
        sh_degree: 1,
        ..TrainConfig::for_iterations(LONGER)
    };
    for_auto_count(config, VIEWS as f64)
}

/// Final state and history of a run.
fn run_to_end(gpu: &Gpu, dataset: &Dataset, config: TrainConfig, loss: f64) -> Result<(HostState, History)> {
    let mut run = controlled(gpu, dataset, config, loss)?;
    while !run.is_done() {
        run.step()?;
    }
    Ok((state_of(&mut run)?, history_of(&run).clone()))
}

/// Saves a run, drops it and resumes it from the file.
fn reopened<'a>(gpu: &Gpu, dataset: &'a Dataset, mut run: AutoRun<'a>, path: &Path) -> Result<AutoRun<'a>> {
    run.save(path)?;
    let saved = Checkpoint::read(path)?;
    drop(run);
    let run = AutoRun::resume(gpu, dataset, path)?;
    let copy = path.with_extension("copy");
    saved.write(&copy)?;
    assert!(Checkpoint::read(&copy)? == saved, "a checkpoint comes back as another");
    Ok(run)
}

fn controlled<'a>(gpu: &Gpu, dataset: &'a Dataset, mut config: TrainConfig, loss: f64) -> Result<AutoRun<'a>> {
    config.auto.loss_db = loss;
    AutoRun::new(gpu, dataset, config)?.controlled(|trainer, dataset| CountController::begin(trainer, dataset, false))
}

fn history_of<'r>(run: &'r AutoRun<'_>) -> &'r History {
    run.controller().unwrap().history()
}

/// Parameters and moments, from a checkpoint.
fn state_of(run: &mut AutoRun<'_>) -> Result<HostState> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    run.save(&path)?;
    Ok(Checkpoint::read(&path)?.state)
}

/// Height of points above all that the photographs show.
const UNSEEN_HEIGHT: f64 = 100.0;

/// Number of splats at that height.
fn unseen(state: &HostState) -> usize {
    state.params[0]
        .iter()
        .filter(|mean| f64::from(mean[2]) > 0.5 * UNSEEN_HEIGHT)
        .count()
}

/// Losses of accepted rounds add up and decide: the more is allowed, the fewer splats are left. Splats that no view
/// shows stay.
#[test]
fn splats_go_while_the_summed_losses_are_within_what_is_allowed() -> Result<()> {
    let gpu = gpu();
    let mut dataset = dataset(Kind::Intricate);
    dataset.points.extend([0.0, 0.1, 0.2, 0.3].map(|x| Point {
        position: [x, 0.0, UNSEEN_HEIGHT],
        color: [0.5; 3],
    }));
    let (mut counts, mut rejected) = (Vec::new(), 0);
    for loss in [1e-4, 5.0] {
        let (state, history) = run_to_end(&gpu, &dataset, config(StrategyKind::Adc), loss)?;
        rejected += check_rounds(&history, state.len());
        assert_eq!(unseen(&state), 4);
        counts.push(state.len());
    }
    assert!(counts[0] > counts[1], "{counts:?}");
    assert!(rejected > 0, "nothing was rejected");
    Ok(())
}

/// Checks sums and decisions of a run's rounds, and the splats left; returns the number of rejected rounds.
fn check_rounds(history: &History, left: usize) -> usize {
    let rounds = history
        .entries
        .iter()
        .filter(|entry| matches!(entry.act, Act::Removed | Act::Rejected));
    let (mut splats, mut lost, mut rejected) = (None, Vec::new(), 0);
    for entry in rounds {
        let reduced = entry.reduced.as_ref().unwrap();
        let by_view = |scores: &ViewScores| scores.psnr_db.clone();
        let (with, without) = (by_view(&entry.scores), by_view(&reduced.scores));
        lost.resize(with.len(), 0.0);
        let sum: Vec<f64> = (0..lost.len()).map(|i| lost[i] + with[i] - without[i]).collect();
        let held_out = reduced.loss.held_out.psnr_db.mean;
        assert!((mean(&sum) - held_out).abs() < 1e-9, "{entry:?}");
        assert_eq!(entry.splats, splats.unwrap_or(entry.splats));
        let is_removed = entry.act == Act::Removed;
        assert_eq!(is_removed, reduced.loss.share(&history.config).0 <= 1.0, "{entry:?}");
        if is_removed {
            lost = if mean(&sum) < 0.0 { vec![0.0; sum.len()] } else { sum };
        }
        splats = Some(if is_removed { reduced.splats } else { entry.splats });
        rejected += usize::from(!is_removed);
    }
    assert_eq!(Some(left), splats);
    rejected
}

/// Makes all photographs of one colour.
fn paint(dataset: &mut Dataset) {
    for view in &mut dataset.views {
        if let PhotoSource::Memory(photo) = &mut view.photo {
            photo.rgba.fill([140, 120, 100, 255]);
        }
    }
}

/// Number of splats of degree 0 and of degree 1.
fn degrees(state: &HostState) -> [usize; 2] {
    [0, 1].map(|degree| state.degrees.iter().filter(|&&d| d == degree).count())
}

#[test]
fn a_resumed_run_decides_and_ends_as_an_uninterrupted_one() -> Result<()> {
    let gpu = gpu();
    let dataset = dataset(Kind::Solids);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    for strategy in [StrategyKind::Adc, StrategyKind::Mcmc] {
        let mut config = config(strategy);
        config.max_splats = Some(1_500);
        let whole = run_to_end(&gpu, &dataset, config.clone(), 0.02)?;
        let mut run = controlled(&gpu, &dataset, config, 0.02)?;
        let mut phases = Vec::new();
        while !run.is_done() {
            run.step()?;
            // 49: evaluation in growth; 170: within a round; the others: arbitrary.
            if [49, 101, 170, 215, 300].contains(&run.iteration()) {
                phases.push(history_of(&run).phase);
                run = reopened(&gpu, &dataset, run, &path)?;
            }
        }
        let found = (state_of(&mut run)?, history_of(&run).clone());
        assert!(phases.contains(&Phase::Growing) && phases.contains(&Phase::Settled));
        assert!(phases.contains(&Phase::Pruning), "{phases:?}");
        assert_eq!(found.1, whole.1, "{strategy:?}");
        assert!(found.0 == whole.0, "{strategy:?}: other splats");
    }
    Ok(())
}

/// A run resumed just before SH reduction, and one without SH reduction.
#[test]
fn harmonics_go_before_the_last_fit_and_nothing_else_sets_a_run_apart_that_keeps_them() -> Result<()> {
    let gpu = gpu();
    let dataset = dataset(Kind::Demo);
    let (state, history) = run_to_end(&gpu, &dataset, longer(), 0.1)?;
    let last = history.entries.last().unwrap();
    assert_eq!((last.act, Some(last.iteration)), (Act::ShReduced, history.settled_from));
    // A fifth of the run is left for the last fit.
    assert!(last.iteration <= LONGER / 5 * 4, "{}", last.iteration);
    let run = AutoRun::new(&gpu, &dataset, longer())?;
    let mut run = run.controlled(|trainer, dataset| {
        let mut controller = CountController::begin(trainer, dataset, false)?;
        controller.keep_sh();
        Ok(controller)
    })?;
    while !run.is_done() {
        run.step()?;
    }
    let found = state_of(&mut run)?;
    assert_eq!(history_of(&run).entries, history.entries);
    assert_eq!((found.len(), degrees(&found)[0]), (state.len(), 0));
    // At least a quarter of the twelve floats per splat is removed.
    let [bare, _] = degrees(&state);
    assert!(9 * bare >= 3 * state.len(), "{bare} of {}", state.len());
    Ok(())
}

/// A wall of one colour, for which a handful of splats suffices, and a scene full of detail. The wall stays without
/// visible error after almost any removal: rounds that show this run their steps once.
#[test]
fn a_trivial_scene_ends_with_a_twentieth_of_an_intricate_one_and_most_rounds_take_their_steps_once() -> Result<()> {
    let gpu = gpu();
    let mut wall = dataset(Kind::Plane);
    paint(&mut wall);
    let mut trainer = Trainer::new(&gpu, &wall, longer())?;
    let mut controller = CountController::begin(&mut trainer, &wall, false)?;
    let mut steps = 0;
    while !trainer.is_done() {
        trainer.step()?;
        steps += 1;
        controller.after_step(&mut trainer)?;
    }
    let trivial = trainer.download()?;
    let intricate = dataset(Kind::Intricate);
    let (intricate, _) = run_to_end(&gpu, &intricate, longer(), AutoConfig::default().loss_db)?;
    let counts = [trivial.len(), intricate.len()];
    assert!(20 * counts[0] <= counts[1], "{counts:?}");
    assert_eq!(
        degrees(&trivial)[0],
        trivial.len(),
        "harmonics where there is nothing to see"
    );

    let entries = &controller.history().entries;
    let rounds: Vec<_> = entries
        .iter()
        .filter(|entry| matches!(entry.act, Act::Removed | Act::Rejected))
        .collect();
    // Scores of views trained on are not kept: without visible error in them, they lose nothing beyond earlier rounds.
    // After a loss, such a round may also have found none by the same splats twice.
    let (mut lost, mut twice, mut unclear) = (0.0, 0, 0);
    for entry in &rounds {
        let reduced = entry.reduced.as_ref().unwrap();
        let trained = reduced.loss.trained.psnr_db.mean;
        let is_full = reduced.scores.psnr_db.iter().all(|&psnr| psnr >= 40.0) && trained == lost;
        twice += usize::from(!is_full);
        unclear += usize::from(is_full && lost != 0.0);
        if entry.act == Act::Removed {
            lost = trained;
        }
    }
    assert!(2 * (twice + unclear) < rounds.len(), "{rounds:?}");
    // Steps that did not fit at first are taken again: some.
    let least = LONGER as usize + ROUND * twice;
    let most = least + ROUND * unclear;
    assert!((least..most + ROUND).contains(&steps), "{steps} steps: {rounds:?}");
    Ok(())
}

#[test]
fn views_are_held_out_evenly_and_are_never_test_views() {
    for views in [8, 12, 43, 200] {
        let mut dataset = dataset(Kind::Sphere);
        dataset.views = (0..views).map(|i| dataset.views[i % 20].clone()).collect();
        let train = dataset.split(Split::Train);
        let (fitted, held) = split_views(&dataset, &AutoConfig::default());
        assert!(held.iter().all(|view| train.contains(view)));
        if train.len() < 8 {
            assert_eq!((&fitted, &held), (&train, &train));
            continue;
        }
        assert_eq!(held.len(), train.len().div_ceil(8).max(3));
        assert_eq!(fitted.len() + held.len(), train.len());
        assert!(fitted.iter().all(|view| !held.contains(view)));
        assert!(held[0] > train[0] && held.last() < train.last());
    }
}

#[test]
fn a_loss_that_is_no_number_above_0_is_refused() -> Result<()> {
    let gpu = gpu();
    let dataset = dataset(Kind::Sphere);
    for loss in [0.0, -0.02, f64::NAN, f64::INFINITY] {
        let refused = controlled(&gpu, &dataset, config(StrategyKind::Adc), loss).err();
        let text = refused.map(|e| e.to_string()).unwrap_or_default();
        assert!(text.starts_with("auto.loss_db is"), "{text}");
    }
    Ok(())
}
