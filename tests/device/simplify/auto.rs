//! Automatic splat counts: built-in scenes, small pictures, short runs.

use crate::common::device::gpu;
use ashfall::Result;
use ashfall::gpu::Gpu;
use ashfall::lab::synth::{Kind, SynthOptions, scene};
use ashfall::scene::{Dataset, PhotoSource, Split};
use ashfall::simplify::{Act, AutoRun, CountController, History, Phase, for_auto_count, split_views};
use ashfall::stats::mean;
use ashfall::train::checkpoint::Checkpoint;
use ashfall::train::config::AutoConfig;
use ashfall::train::{HostState, StrategyKind, TrainConfig};
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

/// Configuration of a run long enough for a round of SH reduction.
pub(super) fn longer() -> TrainConfig {
    let config = TrainConfig {
        sh_degree: 1,
        ..TrainConfig::for_iterations(600)
    };
    for_auto_count(config, VIEWS)
}

/// Final state and history of a run.
fn run_to_end(gpu: &Gpu, dataset: &Dataset, config: TrainConfig, gain: f64) -> Result<(HostState, History)> {
    let mut run = controlled(gpu, dataset, config, gain)?;
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

fn controlled<'a>(gpu: &Gpu, dataset: &'a Dataset, mut config: TrainConfig, gain: f64) -> Result<AutoRun<'a>> {
    config.auto.preference_db = gain;
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

#[test]
fn who_pays_for_smaller_gains_gets_more_splats() -> Result<()> {
    let gpu = gpu();
    let dataset = dataset(Kind::Intricate);
    let mut counts = Vec::new();
    for gain in [1e-4, 0.03, 2.0] {
        counts.push(run_to_end(&gpu, &dataset, config(StrategyKind::Adc), gain)?.0.len());
    }
    assert!(counts[0] > counts[1] && counts[1] > counts[2], "{counts:?}");
    Ok(())
}

/// A wall of one colour, for which a handful of splats suffices, and a scene full of detail.
#[test]
fn a_trivial_scene_ends_with_a_twentieth_of_an_intricate_one() -> Result<()> {
    let gpu = gpu();
    let mut counts = Vec::new();
    for kind in [Kind::Plane, Kind::Intricate] {
        let mut dataset = dataset(kind);
        if kind == Kind::Plane {
            paint(&mut dataset);
        }
        let (state, _) = run_to_end(&gpu, &dataset, longer(), AutoConfig::default().preference_db)?;
        counts.push((state.len(), degrees(&state)));
    }
    assert!(20 * counts[0].0 <= counts[1].0, "{counts:?}");
    assert_eq!(counts[0].1[0], counts[0].0, "harmonics where there is nothing to see");
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

/// Number of splats of degree 0 and of degree 1.
fn degrees(state: &HostState) -> [usize; 2] {
    [0, 1].map(|degree| state.degrees.iter().filter(|&&d| d == degree).count())
}

/// A wall of one colour, fully shown at half size, and a scene full of detail.
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
        let mut run = controlled(&gpu, &dataset, config, AutoConfig::default().preference_db)?;
        while history_of(&run).is_half {
            run.step()?;
        }
        let history = history_of(&run);
        let half = history.half_size().unwrap_or_default();
        assert_eq!(half.until, run.iteration());
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
        let whole = run_to_end(&gpu, &dataset, config.clone(), 0.02)?;
        let mut run = controlled(&gpu, &dataset, config, 0.02)?;
        let mut phases = Vec::new();
        while !run.is_done() {
            run.step()?;
            // 49: check of growth; 170: within a round; the others: arbitrary.
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

#[test]
fn a_run_resumed_at_half_the_size_goes_on_at_half_the_size() -> Result<()> {
    let gpu = gpu();
    let mut dataset = dataset(Kind::Plane);
    paint(&mut dataset);
    let config = config(StrategyKind::Adc);
    let whole = run_to_end(&gpu, &dataset, config.clone(), AutoConfig::default().preference_db)?;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    let mut run = controlled(&gpu, &dataset, config, AutoConfig::default().preference_db)?;
    while !run.is_done() {
        run.step()?;
        if [30, 110].contains(&run.iteration()) {
            assert!(history_of(&run).is_half);
            run = reopened(&gpu, &dataset, run, &path)?;
        }
    }
    assert_eq!(*history_of(&run), whole.1);
    assert!(state_of(&mut run)? == whole.0, "other splats");
    Ok(())
}

/// A run resumed just before SH reduction, and one without SH reduction.
#[test]
fn harmonics_go_in_the_last_fit_and_nothing_else_sets_a_run_apart_that_keeps_them() -> Result<()> {
    let gpu = gpu();
    let dataset = dataset(Kind::Demo);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    let (state, history) = run_to_end(&gpu, &dataset, longer(), 0.03)?;
    let (last, course) = history.entries.split_last().unwrap();
    assert_eq!((last.act, last.iteration), (Act::Lowered, 510));
    for keeps in [false, true] {
        let mut config = longer();
        config.auto.preference_db = 0.03;
        let run = AutoRun::new(&gpu, &dataset, config)?;
        let mut run = run.controlled(|trainer, dataset| {
            let mut controller = CountController::begin(trainer, dataset, false)?;
            if keeps {
                controller.keep_sh();
            }
            Ok(controller)
        })?;
        while !run.is_done() {
            run.step()?;
            if run.iteration() == 500 {
                assert!(history_of(&run).sh_goes.is_some());
                run = reopened(&gpu, &dataset, run, &path)?;
            }
        }
        let found = state_of(&mut run)?;
        if keeps {
            assert_eq!(history_of(&run).entries, course);
            assert_eq!((found.len(), degrees(&found)[0]), (state.len(), 0));
        } else {
            assert_eq!(*history_of(&run), history);
            assert!(found == state, "other splats");
        }
    }
    // At least a quarter of the twelve floats per splat is removed.
    let [bare, _] = degrees(&state);
    assert!(9 * bare >= 3 * state.len(), "{bare} of {}", state.len());
    Ok(())
}

#[test]
fn nothing_goes_that_the_held_out_views_miss() -> Result<()> {
    let gpu = gpu();
    // A preference so small that almost no loss is allowed.
    let (state, history) = run_to_end(&gpu, &dataset(Kind::Demo), config(StrategyKind::Adc), 1e-6)?;
    // The SH reduction of the last fit was decided in a round.
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
        // Splats beyond the knee stay as well, by the fitted law, although this round's views do not miss them.
        let known = History {
            entries: history.entries[..=index].to_vec(),
            ..history.clone()
        };
        let is_perfect = without.iter().all(|&psnr| psnr >= 40.0);
        let is_beyond =
            left < entry.splats && !is_perfect && known.knee().is_some_and(|knee| (left as f64) < 0.95 * knee);
        let has_gone = matches!(entry.act, Act::PruneResult | Act::Dispensable);
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
fn a_preference_that_is_no_gain_is_refused() -> Result<()> {
    let gpu = gpu();
    let dataset = dataset(Kind::Sphere);
    for gain in [0.0, -0.02, f64::NAN, f64::INFINITY] {
        let refused = controlled(&gpu, &dataset, config(StrategyKind::Adc), gain).err();
        let text = refused.map(|e| e.to_string()).unwrap_or_default();
        assert!(text.starts_with("auto.preference_db is"), "{text}");
    }
    Ok(())
}
