//! What a run's folder knows of the run beside the trainer's checkpoint: where the data came from, and
//! the course so far. With both, `--resume DIR` needs no other word.

use crate::cli::args::DataArgs;
use crate::io::atomic::write_atomically;
use crate::lab::report::{HistoryEntry, Timings};
use crate::metrics::MeanScore;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Entries of the history of an uninterrupted run, about.
const HISTORY_ENTRIES: u32 = 200;

/// The figures of one training step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::cli) struct StepFigures {
    /// The step.
    pub iteration: u32,
    /// Its loss.
    pub loss: f64,
    /// PSNR of its training view, decibels.
    pub psnr_db: f64,
    /// Splats drawn from.
    pub splat_count: usize,
    /// The first splat whose gradient was not finite, if there was one.
    pub poisoned: Option<usize>,
}

/// The run as written to `run.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::cli) struct Record {
    /// The data set, absolute.
    pub data: PathBuf,
    /// How it was read.
    pub options: DataArgs,
    /// Where the first splats came from, if not from the data set; absolute.
    pub init: Option<PathBuf>,
    /// Steps asked for.
    pub iterations: u32,
    /// Steps done when this was written.
    pub iteration: u32,
    /// Whether the results have been written.
    pub is_finished: bool,
    /// Wall times so far.
    pub timings: Timings,
    /// The course so far.
    pub history: Vec<HistoryEntry>,
    /// Noteworthy things so far.
    pub warnings: Vec<String>,
    /// What has come since the last entry of the history.
    #[serde(skip)]
    pub pending: Pending,
}

/// Sums over the steps since the last entry.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::cli) struct Pending {
    loss: Mean,
    psnr_db: Mean,
}

/// A mean of the finite ones of some numbers.
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

impl Record {
    /// Takes a step's figures; every so often an entry of the history is made of them.
    pub(crate) fn add(&mut self, figures: StepFigures) {
        if !figures.loss.is_finite() {
            self.warn_once(NO_LOSS, NO_LOSS, figures.iteration);
        }
        if let Some(splat) = figures.poisoned {
            let what = format!("{POISONED} (splat {splat} the first of them)");
            self.warn_once(POISONED, &what, figures.iteration);
        }
        if figures.splat_count == 0 {
            self.warn_once(NO_SPLATS, NO_SPLATS, figures.iteration);
        }
        self.pending.loss.add(figures.loss);
        self.pending.psnr_db.add(figures.psnr_db);
        let every = self.iterations.div_ceil(HISTORY_ENTRIES).max(1);
        if figures.iteration.is_multiple_of(every) || figures.iteration == self.iterations {
            let pending = std::mem::take(&mut self.pending);
            // Steps that are taken twice, as rounds that compare do, count the second time.
            self.history
                .retain(|entry| entry.iteration < figures.iteration);
            self.history.push(HistoryEntry {
                iteration: figures.iteration,
                seconds: self.timings.train_seconds,
                splat_count: figures.splat_count,
                loss: pending.loss.get(),
                psnr_db: pending.psnr_db.get(),
                test: None,
            });
        }
    }

    /// Warns of something unless there is a warning of its `kind`, with which `what` begins.
    fn warn_once(&mut self, kind: &str, what: &str, iteration: u32) {
        if !self.warnings.iter().any(|known| known.starts_with(kind)) {
            let warning = format!("{what}, first at iteration {iteration}");
            self.warnings.push(warning);
        }
    }

    /// Notes an evaluation on the held-out views after `iteration` steps.
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

    /// Forgets what happened after `iteration`: a resumed run does it again.
    pub(crate) fn rewind(&mut self, iteration: u32) {
        self.history.retain(|entry| entry.iteration <= iteration);
        self.pending = Pending::default();
        self.iteration = iteration;
        if let Some(last) = self.history.last() {
            self.timings.train_seconds = self.timings.train_seconds.max(last.seconds);
        }
    }

    /// Reads a run's folder.
    pub(crate) fn read(dir: &Path) -> Result<Record> {
        let path = file(dir);
        let text = std::fs::read(&path).map_err(Error::io(&path))?;
        let fault = |e| Error::file(&path, format!("is no record of a run: {e}"));
        serde_json::from_slice(&text).map_err(fault)
    }

    /// Writes it, whole or not at all.
    pub(crate) fn write(&self, dir: &Path) -> Result<()> {
        let text = serde_json::to_string_pretty(self);
        write_atomically(&file(dir), |file| writeln!(file, "{}", text?))
    }
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

    fn step(iteration: u32, loss: f64) -> StepFigures {
        StepFigures {
            iteration,
            loss,
            psnr_db: f64::INFINITY,
            splat_count: 10,
            poisoned: None,
        }
    }

    #[test]
    fn poisoned_gradients_are_told_once_by_splat_and_step() {
        let mut record = Record::default();
        for (iteration, poisoned) in [(1, None), (2, Some(7)), (3, Some(5))] {
            record.add(StepFigures {
                poisoned,
                ..step(iteration, 0.1)
            });
        }
        let warning = "gradients that were not finite changed nothing (splat 7 the first of them), \
                       first at iteration 2";
        assert_eq!(record.warnings, [warning]);
    }

    #[test]
    fn the_history_holds_means_and_ends_with_the_run() {
        let mut record = Record {
            iterations: 1_003,
            ..Record::default()
        };
        (1..=1_003).for_each(|i| record.add(step(i, f64::from(i))));
        let iterations: Vec<u32> = record.history.iter().map(|e| e.iteration).collect();
        assert_eq!(iterations[..3], [6, 12, 18]);
        assert_eq!(iterations.last(), Some(&1_003));
        assert_eq!(record.history[1].loss, Some(9.5));
        assert_eq!(record.history[1].psnr_db, None);
    }

    #[test]
    fn a_broken_loss_is_warned_of_once_and_left_out() {
        let mut record = Record {
            iterations: 4,
            ..Record::default()
        };
        let losses = [1.0, f64::NAN, f64::NAN];
        for (&loss, iteration) in losses.iter().zip(1..) {
            record.add(step(iteration, loss));
        }
        assert_eq!(
            record.warnings,
            ["the training loss is not a number, first at iteration 2"]
        );
        assert_eq!(record.history[1].loss, None);
    }

    #[test]
    fn a_rewound_record_goes_on_where_the_checkpoint_is() -> Result<()> {
        let mut record = Record {
            iterations: 10,
            ..Record::default()
        };
        (1..=8).for_each(|i| record.add(step(i, 1.0)));
        record.add_test(5, 10, MeanScore::default());
        let dir = tempfile::tempdir().map_err(Error::io("."))?;
        record.write(dir.path())?;
        let mut read = Record::read(dir.path())?;
        assert_eq!(read, record);
        read.rewind(5);
        assert_eq!(read.history.len(), 5);
        assert!(read.history[4].test.is_some());
        Ok(())
    }
}
