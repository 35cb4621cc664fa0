//! The loop of a training run: step, show, save, and stop when asked.

use super::record::{Record, StepFigures};
use crate::Result;
use crate::cli::Outcome;
use crate::cli::interrupt::Interrupt;
use crate::cli::output::{Output, Pace, grouped};
use crate::metrics::MeanScore;
use crate::scene::Splats;
use indicatif::ProgressBar;
use serde_json::json;
use std::path::Path;
use std::time::{Duration, Instant};

/// A training run that can be stepped; the figures of a step may come a few steps later.
pub(in crate::cli) trait Steps {
    /// Steps done.
    fn iteration(&self) -> u32;
    /// Does a step; gives the figures that have become known.
    fn step(&mut self) -> Result<Vec<StepFigures>>;
    /// Waits for all steps; gives the figures still outstanding.
    fn finish(&mut self) -> Result<Vec<StepFigures>>;
    /// The step that the run ends after, where the run itself decides that.
    fn end(&self) -> Option<u32> {
        None
    }
    /// The scene as it is.
    fn splats(&mut self) -> Result<Splats>;
    /// Writes all that is needed to go on.
    fn checkpoint(&mut self, path: &Path) -> Result<()>;
}

/// What happens on the way.
pub(in crate::cli) struct Plan<'a> {
    /// The run's folder.
    pub dir: &'a Path,
    /// Steps between checkpoints; 0: only at the end.
    pub checkpoint_every: u32,
    /// Steps between evaluations on the held-out views; 0: only at the end.
    pub eval_every: u32,
    /// How to speak.
    pub output: Output,
    /// Whether to stop.
    pub interrupt: &'a Interrupt,
}

/// Steps until the end of the run or an interruption; a checkpoint is written in either case.
pub(in crate::cli) fn run_steps(
    steps: &mut impl Steps,
    record: &mut Record,
    plan: &Plan<'_>,
    evaluate: &mut dyn FnMut(&Splats) -> Result<MeanScore>,
) -> Result<Outcome> {
    let mut display = Display::new(record, steps.iteration(), plan.output);
    let mut outcome = Outcome::Done;
    while steps.iteration() < record.iterations {
        if plan.interrupt.is_requested() {
            outcome = Outcome::Interrupted;
            break;
        }
        timed(record, |t| &mut t.train_seconds, || steps.step())?
            .into_iter()
            .for_each(|figures| display.show(record, figures));
        record.iterations = steps.end().unwrap_or(record.iterations);
        let done = steps.iteration();
        let is_due =
            |every: u32| every > 0 && done.is_multiple_of(every) && done < record.iterations;
        let (evaluates, saves) = (is_due(plan.eval_every), is_due(plan.checkpoint_every));
        if evaluates {
            drain(steps, record, &mut display)?;
            let splats = steps.splats()?;
            let score = timed(record, |t| &mut t.evaluate_seconds, || evaluate(&splats))?;
            record.add_test(done, splats.len(), score);
            display.show_test(done, &score);
        }
        if saves {
            save(steps, record, &mut display, plan.dir)?;
        }
    }
    save(steps, record, &mut display, plan.dir)?;
    display.bar.finish_and_clear();
    Ok(outcome)
}

/// Writes the checkpoint, and then the record: a record behind its checkpoint lacks a few figures, one
/// ahead of it is cut back.
fn save(
    steps: &mut impl Steps,
    record: &mut Record,
    display: &mut Display,
    dir: &Path,
) -> Result<()> {
    drain(steps, record, display)?;
    record.iteration = steps.iteration();
    let path = dir.join("checkpoint");
    timed(
        record,
        |t| &mut t.checkpoint_seconds,
        || steps.checkpoint(&path),
    )?;
    record.write(dir)
}

fn drain(steps: &mut impl Steps, record: &mut Record, display: &mut Display) -> Result<()> {
    let figures = timed(record, |t| &mut t.train_seconds, || steps.finish())?;
    figures.into_iter().for_each(|f| display.show(record, f));
    Ok(())
}

/// Runs something and adds the time it takes to one of the record's.
fn timed<T>(
    record: &mut Record,
    part: impl FnOnce(&mut crate::lab::report::Timings) -> &mut f64,
    run: impl FnOnce() -> Result<T>,
) -> Result<T> {
    let start = Instant::now();
    let result = run();
    *part(&mut record.timings) += start.elapsed().as_secs_f64();
    result
}

/// The progress bar, or lines for machines.
struct Display {
    bar: ProgressBar,
    output: Output,
    pace: Pace,
    /// Training seconds and iteration when this part of the run began.
    start: (f64, u32),
}

impl Display {
    fn new(record: &Record, iteration: u32, output: Output) -> Display {
        let bar = output.bar(u64::from(record.iterations), "training");
        bar.set_position(u64::from(iteration));
        bar.reset_eta();
        Display {
            bar,
            output,
            pace: Pace::new(Duration::from_millis(500)),
            start: (record.timings.train_seconds, iteration),
        }
    }

    fn show(&mut self, record: &mut Record, figures: StepFigures) {
        let entries = record.history.len();
        record.add(figures);
        let (seconds, first) = self.start;
        let elapsed = record.timings.train_seconds - seconds;
        let rate = f64::from(figures.iteration.saturating_sub(first)) / elapsed.max(1e-9);
        self.bar.set_position(u64::from(figures.iteration));
        self.bar.set_message(format!(
            "· loss {:.4} · {:.2} dB · {} splats · {rate:.2} it/s",
            figures.loss,
            figures.psnr_db,
            grouped(figures.splat_count),
        ));
        if record.history.len() > entries || self.pace.is_due() {
            self.output.event(|| {
                json!({
                    "event": "step",
                    "iteration": figures.iteration,
                    "loss": figures.loss,
                    "psnr_db": figures.psnr_db,
                    "splat_count": figures.splat_count,
                    "seconds": record.timings.train_seconds,
                    "steps_per_second": rate,
                })
            });
        }
    }

    fn show_test(&self, iteration: u32, score: &MeanScore) {
        let text = crate::cli::output::score_text(score);
        self.bar.suspend(|| {
            self.output
                .remark(format_args!("iteration {iteration}: test {text}"))
        });
        self.output
            .event(|| json!({"event": "test", "iteration": iteration, "score": score}));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Error;

    /// A run whose figures come two steps late.
    #[derive(Default)]
    struct Fake {
        iteration: u32,
        told: u32,
        checkpoints: Vec<u32>,
        stop_at: Option<(u32, Interrupt)>,
    }

    impl Fake {
        fn figures(&mut self, until: u32) -> Vec<StepFigures> {
            let news = self.told + 1..=until;
            self.told = self.told.max(until);
            let figures = |iteration| StepFigures {
                iteration,
                loss: 1.0 / f64::from(iteration),
                psnr_db: 20.0,
                splat_count: 5,
                poisoned: None,
            };
            news.map(figures).collect()
        }
    }

    impl Steps for Fake {
        fn iteration(&self) -> u32 {
            self.iteration
        }

        fn step(&mut self) -> Result<Vec<StepFigures>> {
            self.iteration += 1;
            if let Some((at, interrupt)) = &self.stop_at {
                if *at == self.iteration {
                    interrupt.request();
                }
            }
            Ok(self.figures(self.iteration.saturating_sub(2)))
        }

        fn finish(&mut self) -> Result<Vec<StepFigures>> {
            Ok(self.figures(self.iteration))
        }

        fn splats(&mut self) -> Result<Splats> {
            Ok(Splats::default())
        }

        fn checkpoint(&mut self, path: &Path) -> Result<()> {
            self.checkpoints.push(self.iteration);
            std::fs::write(path, self.iteration.to_string()).map_err(Error::io(path))
        }
    }

    fn run(fake: &mut Fake, record: &mut Record, dir: &Path) -> Result<(Outcome, Vec<u32>)> {
        let interrupt = fake
            .stop_at
            .as_ref()
            .map(|(_, i)| i.clone())
            .unwrap_or_default();
        let plan = Plan {
            dir,
            checkpoint_every: 10,
            eval_every: 15,
            output: Output { json: false },
            interrupt: &interrupt,
        };
        let mut scores = 0;
        let outcome = run_steps(fake, record, &plan, &mut |_| {
            scores += 1;
            Ok(MeanScore::default())
        })?;
        let tested = record.history.iter().filter(|e| e.test.is_some());
        Ok((outcome, tested.map(|e| e.iteration).collect()))
    }

    #[test]
    fn a_run_saves_tests_and_ends() -> Result<()> {
        let dir = tempfile::tempdir().map_err(Error::io("."))?;
        let mut record = Record {
            iterations: 40,
            ..Record::default()
        };
        let mut fake = Fake::default();
        let end = run(&mut fake, &mut record, dir.path())?;
        assert_eq!(end, (Outcome::Done, vec![15, 30]));
        assert_eq!(fake.checkpoints, [10, 20, 30, 40]);
        let iterations: Vec<u32> = record.history.iter().map(|e| e.iteration).collect();
        assert_eq!(iterations, (1..=40).collect::<Vec<_>>());
        Ok(())
    }

    #[test]
    fn an_interrupted_run_saves_and_its_rest_completes_the_history() -> Result<()> {
        let dir = tempfile::tempdir().map_err(Error::io("."))?;
        let mut record = Record {
            iterations: 40,
            ..Record::default()
        };
        let mut fake = Fake {
            stop_at: Some((17, Interrupt::default())),
            ..Fake::default()
        };
        let (outcome, _) = run(&mut fake, &mut record, dir.path())?;
        assert_eq!(outcome, Outcome::Interrupted);
        assert_eq!(fake.checkpoints, [10, 17]);
        let mut resumed = Record::read(dir.path())?;
        assert_eq!(resumed.iteration, 17);
        resumed.rewind(17);
        let mut fake = Fake {
            iteration: 17,
            told: 17,
            ..Fake::default()
        };
        let end = run(&mut fake, &mut resumed, dir.path())?;
        assert_eq!(end, (Outcome::Done, vec![15, 30]));
        assert_eq!(resumed.history.len(), 40);
        Ok(())
    }
}
