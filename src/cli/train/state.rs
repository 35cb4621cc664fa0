//! `run.json`: the data set of a run and its history so far. With the checkpoint beside it, `--resume DIR` needs no
//! other option.

use crate::cli::args::DataArgs;
use crate::io::atomic::write_atomically;
use crate::lab::report::{HistoryEntry, Timings};
use crate::metrics::MeanScore;
use crate::train::StepReport;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Approximate number of history entries of an uninterrupted run.
const HISTORY_ENTRIES: u32 = 200;

/// Run as written to `run.json`. In the file, paths below the run's folder are relative to it, so that the folder can
/// be moved; in memory all are absolute.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::cli) struct RunState {
    /// Data set.
    pub data: PathBuf,
    /// Options of reading it.
    pub options: DataArgs,
    /// File of the initial points, if not the data set.
    pub init: Option<PathBuf>,
    /// Requested steps.
    pub iterations: u32,
    /// Steps done at the time of writing.
    pub iteration: u32,
    /// True once the results are written.
    pub is_finished: bool,
    /// Wall times so far.
    pub timings: Timings,
    /// History so far.
    pub history: Vec<HistoryEntry>,
    /// Warnings so far.
    pub warnings: Vec<String>,
    /// Sums since the last entry of the history.
    #[serde(skip)]
    pub pending: Pending,
}

/// Sums over the steps since the last entry.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::cli) struct Pending {
    loss: Mean,
    psnr_db: Mean,
}

/// Mean of the finite values.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Mean {
    sum: f64,
    count: u32,
}

impl Mean {
    fn add(&mut self, value: f64) {
        if value.is_finite() {
            self.sum += value;
            self.count += 1;
        }
    }

    fn get(self) -> Option<f64> {
        (self.count > 0).then(|| self.sum / f64::from(self.count))
    }
}

impl RunState {
    /// Adds a step's figures; every `iterations / HISTORY_ENTRIES` steps they become a history entry.
    pub(crate) fn add(&mut self, report: &StepReport) {
        if !report.loss.is_finite() {
            self.warn_once(NO_LOSS, NO_LOSS, report.iteration);
        }
        if let Some(splat) = report.poisoned_first {
            let what = format!("{POISONED} (splat {splat} the first of them)");
            self.warn_once(POISONED, &what, report.iteration);
        }
        if report.splat_count == 0 {
            self.warn_once(NO_SPLATS, NO_SPLATS, report.iteration);
        }
        self.pending.loss.add(report.loss);
        self.pending.psnr_db.add(report.psnr_db);
        let every = self.iterations.div_ceil(HISTORY_ENTRIES).max(1);
        if report.iteration.is_multiple_of(every) || report.iteration == self.iterations {
            let pending = std::mem::take(&mut self.pending);
            // A repeated step replaces its earlier entry (rounds of the count controller repeat steps).
            self.history.retain(|entry| entry.iteration < report.iteration);
            self.history.push(HistoryEntry {
                iteration: report.iteration,
                seconds: self.timings.train_seconds,
                splat_count: report.splat_count,
                loss: pending.loss.get(),
                psnr_db: pending.psnr_db.get(),
                test: None,
            });
        }
    }

    /// Adds warning `what` unless there is one of its `kind`; `what` begins with `kind`.
    fn warn_once(&mut self, kind: &str, what: &str, iteration: u32) {
        if !self.warnings.iter().any(|known| known.starts_with(kind)) {
            let warning = format!("{what}, first at iteration {iteration}");
            self.warnings.push(warning);
        }
    }

    /// Adds an evaluation on the held-out views after `iteration` steps.
    pub(crate) fn add_test(&mut self, iteration: u32, splat_count: usize, score: MeanScore) {
        if let Some(entry) = self.history.iter_mut().find(|e| e.iteration == iteration) {
            entry.test = Some(score);
            return;
        }
        self.history.push(HistoryEntry {
            iteration,
            seconds: self.timings.train_seconds,
            splat_count,
            loss: self.pending.loss.get(),
            psnr_db: self.pending.psnr_db.get(),
            test: Some(score),
        });
    }

    /// Drops entries after `iteration`, which a resumed run repeats.
    pub(crate) fn rewind(&mut self, iteration: u32) {
        self.history.retain(|entry| entry.iteration <= iteration);
        self.pending = Pending::default();
        self.iteration = iteration;
        if let Some(last) = self.history.last() {
            self.timings.train_seconds = self.timings.train_seconds.max(last.seconds);
        }
    }

    /// Reads `run.json` of a run's folder.
    pub(crate) fn read(dir: &Path) -> Result<RunState> {
        let path = file(dir);
        let text = std::fs::read(&path).map_err(Error::io(&path))?;
        let fault = |e| Error::file(&path, format!("is no record of a run: {e}"));
        let mut state: RunState = serde_json::from_slice(&text).map_err(fault)?;
        let dir = absolute(dir)?;
        state.paths().for_each(|path| *path = dir.join(&*path));
        Ok(state)
    }

    /// Writes `run.json` atomically.
    pub(crate) fn write(&self, dir: &Path) -> Result<()> {
        let mut state = self.clone();
        let folder = absolute(dir)?;
        for path in state.paths() {
            if let Ok(inside) = path.strip_prefix(&folder) {
                *path = inside.to_owned();
            }
        }
        let text = serde_json::to_string_pretty(&state);
        write_atomically(&file(dir), |file| writeln!(file, "{}", text?))
    }

    fn paths(&mut self) -> impl Iterator<Item = &mut PathBuf> {
        let optional = self.init.iter_mut().chain(&mut self.options.images);
        std::iter::once(&mut self.data).chain(optional)
    }
}

/// Absolute path.
pub(super) fn absolute(path: &Path) -> Result<PathBuf> {
    std::path::absolute(path).map_err(Error::io(path))
}

const NO_LOSS: &str = "the training loss is not a number";
const POISONED: &str = "gradients that were not finite changed nothing";
const NO_SPLATS: &str = "density control has removed every splat";

fn file(dir: &Path) -> PathBuf {
    dir.join("run.json")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(iteration: u32, loss: f64) -> StepReport {
        StepReport {
            iteration,
            loss,
            psnr_db: f64::INFINITY,
            splat_count: 10,
            visible_count: 0,
            isect_count: 0,
            poisoned: 0,
            poisoned_first: None,
            refined: None,
        }
    }

    #[test]
    fn a_folder_that_moves_takes_its_data_with_it() -> Result<()> {
        let dir = tempfile::tempdir().map_err(Error::io("."))?;
        let [old, new] = ["old", "new"].map(|name| dir.path().join(name));
        std::fs::create_dir(&old).map_err(Error::io(&old))?;
        let outside = dir.path().join("photos");
        let state = RunState {
            data: old.join("data"),
            init: Some(outside.clone()),
            ..RunState::default()
        };
        state.write(&old)?;
        assert_eq!(RunState::read(&old)?, state);
        std::fs::rename(&old, &new).map_err(Error::io(&old))?;
        let moved = RunState::read(&new)?;
        assert_eq!((moved.data, moved.init), (new.join("data"), Some(outside)));
        Ok(())
    }

    #[test]
    fn poisoned_gradients_are_told_once_by_splat_and_step() {
        let mut state = RunState::default();
        for (iteration, poisoned) in [(1, None), (2, Some(7)), (3, Some(5))] {
            state.add(&StepReport {
                poisoned_first: poisoned,
                ..step(iteration, 0.1)
            });
        }
        let warning = "gradients that were not finite changed nothing (splat 7 the first of them), \
                       first at iteration 2";
        assert_eq!(state.warnings, [warning]);
    }

    #[test]
    fn the_history_holds_means_and_ends_with_the_run() {
        let mut state = RunState {
            iterations: 1_003,
            ..RunState::default()
        };
        (1..=1_003).for_each(|i| state.add(&step(i, f64::from(i))));
        let iterations: Vec<u32> = state.history.iter().map(|e| e.iteration).collect();
        assert_eq!(iterations[..3], [6, 12, 18]);
        assert_eq!(iterations.last(), Some(&1_003));
        assert_eq!(state.history[1].loss, Some(9.5));
        assert_eq!(state.history[1].psnr_db, None);
    }

    #[test]
    fn a_broken_loss_is_warned_of_once_and_left_out() {
        let mut state = RunState {
            iterations: 4,
            ..RunState::default()
        };
        let losses = [1.0, f64::NAN, f64::NAN];
        for (&loss, iteration) in losses.iter().zip(1..) {
            state.add(&step(iteration, loss));
        }
        assert_eq!(
            state.warnings,
            ["the training loss is not a number, first at iteration 2"]
        );
        assert_eq!(state.history[1].loss, None);
    }

    #[test]
    fn a_rewound_state_goes_on_where_the_checkpoint_is() -> Result<()> {
        let mut state = RunState {
            data: absolute(Path::new("photos"))?,
            iterations: 10,
            ..RunState::default()
        };
        (1..=8).for_each(|i| state.add(&step(i, 1.0)));
        state.add_test(5, 10, MeanScore::default());
        let dir = tempfile::tempdir().map_err(Error::io("."))?;
        state.write(dir.path())?;
        let mut read = RunState::read(dir.path())?;
        assert_eq!(read, state);
        read.rewind(5);
        assert_eq!(read.history.len(), 5);
        assert!(read.history[4].test.is_some());
        Ok(())
    }
}
