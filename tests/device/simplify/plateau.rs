//! Automatic splat counts where quality is saturated.

use super::auto::{ITERATIONS, config, dataset, longer, paint};
use crate::common::device::gpu;
use ashfall::Result;
use ashfall::gpu::Gpu;
use ashfall::lab::synth::Kind;
use ashfall::scene::Dataset;
use ashfall::simplify::gain::steps_of_ten_percent;
use ashfall::simplify::{Act, CountController, History, HistoryEntry, Phase, Round, split_views};
use ashfall::train::config::AutoConfig;
use ashfall::train::{Controller, StrategyKind, Trainer};

/// A wall of one colour stays near-perfect after almost any removal: rounds that show this run their steps once.
#[test]
fn where_nothing_can_be_missed_a_round_takes_its_steps_once() -> Result<()> {
    let gpu = gpu();
    let mut dataset = dataset(Kind::Plane);
    paint(&mut dataset);
    let mut trainer = Trainer::new(&gpu, &dataset, longer())?;
    let mut controller = CountController::begin(&mut trainer, &dataset, false)?;
    let mut steps = 0;
    while !trainer.is_done() {
        trainer.step()?;
        steps += 1;
        controller.after_step(&mut trainer)?;
    }
    let entries = controller.history().entries.iter();
    let rounds: Vec<bool> = entries
        .filter_map(|entry| entry.without.as_ref())
        .map(|(_, psnr_db)| psnr_db.iter().all(|&psnr| psnr >= 40.0))
        .collect();
    let twice = rounds.iter().filter(|&&is_perfect| !is_perfect).count();
    assert!(twice < rounds.len(), "{rounds:?}");
    assert_eq!(steps, 600 + 30 * twice, "{rounds:?}");
    Ok(())
}

/// History and splat count after a last round that removed half of the splats, with the given scores, when growth had
/// stopped.
fn after_last_round(gpu: &Gpu, dataset: &Dataset, without_db: Vec<f64>) -> Result<(History, usize)> {
    let mut trainer = Trainer::new(gpu, dataset, config(StrategyKind::Adc))?;
    while trainer.iteration() < 200 {
        trainer.step()?;
    }
    let (splats, (fitted, held)) = (trainer.splat_count(), split_views(dataset, &AutoConfig::default()));
    let own = fitted.len().div_ceil(fitted.len().div_ceil(held.len()));
    let stopped = HistoryEntry {
        iteration: 200,
        act: Act::Stopped,
        splats,
        psnr_db: vec![40.0; held.len()],
        without: None,
        gain_db: None,
        lost_db: 0.0,
        is_merged: false,
    };
    let round = Round {
        from: 200,
        without: Some((splats / 2, without_db)),
        // Training views miss nothing.
        train_psnr_db: vec![99.0; own],
        ..Round::default()
    };
    let history = History {
        preference_db: AutoConfig::default().preference_db,
        phase: Phase::Pruning,
        share: 0.5,
        end: ITERATIONS,
        round: Some(round),
        entries: vec![stopped],
        ..History::default()
    };
    let kept = trainer.download()?;
    let mut controller = CountController::resume(&mut trainer, dataset, history, Some(kept))?;
    while controller.history().entries.len() == 1 {
        trainer.step()?;
        controller.after_step(&mut trainer)?;
    }
    Ok((controller.history().clone(), trainer.splat_count()))
}

/// The same round with hopeless scores, and with scores at 1.25 times the allowed cost.
#[test]
fn of_splats_that_the_last_round_missed_by_little_some_go() -> Result<()> {
    let (gpu, dataset) = (gpu(), dataset(Kind::Demo));
    let (history, splats) = after_last_round(&gpu, &dataset, vec![0.0; 3])?;
    let missed = &history.entries[1];
    assert_eq!((missed.act, missed.splats), (Act::Missed, splats));
    assert!(history.entries.iter().all(|e| e.act != Act::PartPruned));

    let gone = steps_of_ten_percent(splats / 2, splats);
    let nearly = |psnr: &f64| psnr - 1.25 * AutoConfig::default().preference_db * gone;
    let without_db = missed.psnr_db.iter().map(nearly).collect();
    let (history, left) = after_last_round(&gpu, &dataset, without_db)?;
    let [_, missed, part] = &history.entries[..3] else {
        panic!("{:?}", history.entries);
    };
    assert_eq!((missed.act, part.act), (Act::Missed, Act::PartPruned));
    assert_eq!(part.without.as_ref().map(|&(left, _)| left), Some(left));
    // Four fifths of the half.
    assert!((left as f64 / splats as f64 - 0.6).abs() < 2e-3, "{left} of {splats}");
    Ok(())
}
