//! Training to no more splats than a scene needs: built-in scenes, small pictures, short runs.

use super::device::gpu;
use ashfall::Result;
use ashfall::gpu::Gpu;
use ashfall::lab::synth::{Kind, SynthOptions, scene};
use ashfall::scene::{Dataset, PhotoSource, Split};
use ashfall::simplify::{
    Act, CountController, History, PREFERENCE_DB, Phase, for_auto_count, part,
};
use ashfall::stats::mean;
use ashfall::train::checkpoint::{Checkpoint, Steering, fingerprint};
use ashfall::train::{HostState, StrategyKind, TrainConfig, Trainer};
use std::path::Path;

pub(super) const ITERATIONS: u32 = 320;

/// Photographs of a scene.
const VIEWS: usize = 20;

fn options() -> SynthOptions {
    SynthOptions {
        views: VIEWS,
        width: 64,
        height: 48,
        points: 800,
        ..SynthOptions::default()
    }
}

pub(super) fn dataset(kind: Kind) -> Dataset {
    scene(kind).dataset(&options())
}

pub(super) fn config(strategy: StrategyKind) -> TrainConfig {
    let config = TrainConfig {
        sh_degree: 1,
        ..TrainConfig::for_iterations(ITERATIONS)
    };
    for_auto_count(config.with_strategy(strategy), VIEWS)
}

/// Of a run long enough for a round of harmonics.
pub(super) fn longer() -> TrainConfig {
    let config = TrainConfig {
        sh_degree: 1,
        ..TrainConfig::for_iterations(600)
    };
    for_auto_count(config, VIEWS)
}

/// A run from its beginning to the end, and what it found.
fn run(
    gpu: &Gpu,
    dataset: &Dataset,
    config: TrainConfig,
    gain: f64,
) -> Result<(HostState, History)> {
    let mut trainer = Trainer::new(gpu, dataset, config)?;
    let mut controller = CountController::begin(&mut trainer, dataset, gain, false)?;
    while !trainer.is_done() {
        trainer.step()?;
        controller.after_step(&mut trainer)?;
    }
    Ok((trainer.download()?, controller.history().clone()))
}

/// Writes a run down, forgets it and goes on from the file.
fn reopened<'a>(
    gpu: &Gpu,
    dataset: &'a Dataset,
    (mut trainer, controller): (Trainer<'a>, CountController<'a>),
    path: &Path,
) -> Result<(Trainer<'a>, CountController<'a>)> {
    let checkpoint = Checkpoint {
        config: trainer.config().clone(),
        state: trainer.download()?,
        iteration: trainer.iteration(),
        statistics: trainer.statistics()?,
        fingerprint: fingerprint(dataset),
        steering: Some(Steering {
            notes: serde_json::to_value(controller.history()).unwrap(),
            kept: controller.kept().cloned(),
        }),
    };
    drop((trainer, controller));
    checkpoint.write(path)?;
    let saved = Checkpoint::read(path)?;
    assert!(saved == checkpoint, "a checkpoint comes back as another");
    let mut trainer =
        Trainer::from_state(gpu, dataset, saved.config, &saved.state, saved.iteration)?;
    let steering = saved.steering.unwrap();
    let history = serde_json::from_value(steering.notes).unwrap();
    let controller = CountController::resume(&mut trainer, dataset, history, steering.kept)?;
    trainer.set_statistics(&saved.statistics)?;
    Ok((trainer, controller))
}

#[test]
fn who_pays_for_smaller_gains_gets_more_splats() -> Result<()> {
    let gpu = gpu();
    let dataset = dataset(Kind::Intricate);
    let mut counts = Vec::new();
    for gain in [1e-4, 0.03, 2.0] {
        counts.push(
            run(&gpu, &dataset, config(StrategyKind::Adc), gain)?
                .0
                .len(),
        );
    }
    assert!(counts[0] > counts[1] && counts[1] > counts[2], "{counts:?}");
    Ok(())
}

/// A wall of one colour, which a handful of splats can show, and a scene full of detail.
#[test]
fn a_trivial_scene_ends_with_a_twentieth_of_an_intricate_one() -> Result<()> {
    let gpu = gpu();
    let mut counts = Vec::new();
    for kind in [Kind::Plane, Kind::Intricate] {
        let mut dataset = dataset(kind);
        if kind == Kind::Plane {
            paint(&mut dataset);
        }
        let (state, _) = run(&gpu, &dataset, longer(), PREFERENCE_DB)?;
        counts.push((state.len(), degrees(&state)));
    }
    assert!(20 * counts[0].0 <= counts[1].0, "{counts:?}");
    assert_eq!(
        counts[0].1[0], counts[0].0,
        "harmonics where there is nothing to see"
    );
    Ok(())
}

/// Makes all photographs of one colour.
pub(super) fn paint(dataset: &mut Dataset) {
    for view in &mut dataset.views {
        if let PhotoSource::Memory(photo) = &mut view.photo {
            photo.rgba.fill([140, 120, 100, 255]);
        }
    }
}

/// Splats of degree 0 and 1.
fn degrees(state: &HostState) -> [usize; 2] {
    [0, 1].map(|degree| state.degrees.iter().filter(|&&d| d == degree).count())
}

/// A wall of one colour, of which half the size shows all, and a scene full of detail.
#[test]
fn photographs_stay_small_for_longer_where_there_is_less_to_see() -> Result<()> {
    let gpu = gpu();
    let mut turns = Vec::new();
    for kind in [Kind::Plane, Kind::Intricate] {
        let mut dataset = dataset(kind);
        if kind == Kind::Plane {
            paint(&mut dataset);
        }
        let config = config(StrategyKind::Adc);
        let mut trainer = Trainer::new(&gpu, &dataset, config)?;
        let mut controller = CountController::begin(&mut trainer, &dataset, PREFERENCE_DB, false)?;
        while controller.history().is_half {
            trainer.step()?;
            controller.after_step(&mut trainer)?;
        }
        let history = controller.history();
        let half = history.half_size().unwrap_or_default();
        assert_eq!(half.until, trainer.iteration());
        turns.push((half, history.phase, history.settled_from));
    }
    let [(plain, _, settled_from), (full, phase, _)] = &turns[..] else {
        panic!("two scenes");
    };
    assert_eq!(Some(plain.until), *settled_from);
    assert!(2 * full.until <= plain.until, "{turns:?}");
    assert_eq!(*phase, Phase::Growing);
    assert!(full.limit_db.unwrap() < 30.0, "{full:?}");
    Ok(())
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
        let whole = run(&gpu, &dataset, config.clone(), 0.02)?;
        let mut trainer = Trainer::new(&gpu, &dataset, config)?;
        let mut controller = CountController::begin(&mut trainer, &dataset, 0.02, false)?;
        let mut phases = Vec::new();
        while !trainer.is_done() {
            trainer.step()?;
            controller.after_step(&mut trainer)?;
            // 49: where growth is looked at; 170: within a round; the others: wherever they fall.
            if [49, 101, 170, 215, 300].contains(&trainer.iteration()) {
                phases.push(controller.history().phase);
                (trainer, controller) = reopened(&gpu, &dataset, (trainer, controller), &path)?;
            }
        }
        let found = (trainer.download()?, controller.history().clone());
        assert!(phases.contains(&Phase::Growing) && phases.contains(&Phase::Settled));
        assert!(phases.contains(&Phase::Pruning), "{phases:?}");
        assert_eq!(found.1, whole.1, "{strategy:?}");
        assert!(found.0 == whole.0, "{strategy:?}: other splats");
    }
    Ok(())
}

#[test]
fn a_run_resumed_at_half_the_size_goes_on_at_half_the_size() -> Result<()> {
    let gpu = gpu();
    let mut dataset = dataset(Kind::Plane);
    paint(&mut dataset);
    let config = config(StrategyKind::Adc);
    let whole = run(&gpu, &dataset, config.clone(), PREFERENCE_DB)?;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    let mut trainer = Trainer::new(&gpu, &dataset, config)?;
    let mut controller = CountController::begin(&mut trainer, &dataset, PREFERENCE_DB, false)?;
    while !trainer.is_done() {
        trainer.step()?;
        controller.after_step(&mut trainer)?;
        if [30, 110].contains(&trainer.iteration()) {
            assert!(controller.history().is_half);
            (trainer, controller) = reopened(&gpu, &dataset, (trainer, controller), &path)?;
        }
    }
    assert_eq!(*controller.history(), whole.1);
    assert!(trainer.download()? == whole.0, "other splats");
    Ok(())
}

/// A run that is resumed just before harmonics go, and one that keeps them.
#[test]
fn harmonics_go_in_the_last_fit_and_nothing_else_sets_a_run_apart_that_keeps_them() -> Result<()> {
    let gpu = gpu();
    let dataset = dataset(Kind::Demo);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    let (state, history) = run(&gpu, &dataset, longer(), 0.03)?;
    let (last, course) = history.entries.split_last().unwrap();
    assert_eq!((last.act, last.iteration), (Act::Lowered, 510));
    for keeps in [false, true] {
        let mut trainer = Trainer::new(&gpu, &dataset, longer())?;
        let mut controller = CountController::begin(&mut trainer, &dataset, 0.03, false)?;
        if keeps {
            controller.keep_sh();
        }
        while !trainer.is_done() {
            trainer.step()?;
            controller.after_step(&mut trainer)?;
            if trainer.iteration() == 500 {
                assert!(controller.history().sh_goes.is_some());
                (trainer, controller) = reopened(&gpu, &dataset, (trainer, controller), &path)?;
            }
        }
        let found = trainer.download()?;
        if keeps {
            assert_eq!(controller.history().entries, course);
            assert_eq!((found.len(), degrees(&found)[0]), (state.len(), 0));
        } else {
            assert_eq!(*controller.history(), history);
            assert!(found == state, "other splats");
        }
    }
    // Of twelve floats a splat, a quarter goes at least.
    let [bare, _] = degrees(&state);
    assert!(9 * bare >= 3 * state.len(), "{bare} of {}", state.len());
    Ok(())
}

#[test]
fn nothing_goes_that_the_held_out_views_miss() -> Result<()> {
    let gpu = gpu();
    // A preference so small that hardly anything may go.
    let (state, history) = run(&gpu, &dataset(Kind::Demo), config(StrategyKind::Adc), 1e-6)?;
    // What goes in the last fit was judged in a round.
    let rounds = history
        .entries
        .iter()
        .enumerate()
        .filter(|(_, entry)| entry.without.is_some() && entry.act != Act::Lowered);
    let (mut splats, mut missed) = (None, 0);
    for (index, entry) in rounds {
        let (left, without) = entry.without.clone().unwrap();
        let is_missed = mean(&entry.psnr_db) - mean(&without) > 1e-6 * 10.0;
        assert_eq!(entry.splats, splats.unwrap_or(entry.splats));
        // What lies beyond the knee stays, too, though nobody misses it in this round: by the law it would be.
        let known = History {
            entries: history.entries[..=index].to_vec(),
            ..history.clone()
        };
        let is_perfect = without.iter().all(|&psnr| psnr >= 40.0);
        let is_beyond = left < entry.splats
            && !is_perfect
            && known.knee().is_some_and(|knee| (left as f64) < 0.95 * knee);
        let has_gone = matches!(entry.act, Act::Pruned | Act::Dispensable);
        assert_eq!(!has_gone, is_missed || is_beyond, "{entry:?}");
        splats = Some(if has_gone { left } else { entry.splats });
        missed += usize::from(is_missed);
    }
    assert_eq!(Some(state.len()), splats);
    assert!(missed > 0, "nothing was missed");
    Ok(())
}

#[test]
fn views_are_held_out_evenly_and_are_never_test_views() {
    for views in [8, 12, 43, 200] {
        let mut dataset = dataset(Kind::Sphere);
        dataset.views = (0..views).map(|i| dataset.views[i % 20].clone()).collect();
        let train = dataset.split(Split::Train);
        let (fitted, held) = part(&dataset);
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
fn a_preference_that_is_no_gain_is_refused() -> Result<()> {
    let gpu = gpu();
    let dataset = dataset(Kind::Sphere);
    for gain in [0.0, -0.02, f64::NAN, f64::INFINITY] {
        let mut trainer = Trainer::new(&gpu, &dataset, config(StrategyKind::Adc))?;
        let refused = CountController::begin(&mut trainer, &dataset, gain, false).err();
        let text = refused.map(|e| e.to_string()).unwrap_or_default();
        assert!(text.contains("smallest gain worth paying for"), "{text}");
    }
    Ok(())
}
