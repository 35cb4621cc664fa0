//! Loop of a training run: step, display, save, stop on request.

use super::Session;
use super::state::RunState;
use crate::Result;
use crate::cli::Outcome;
use crate::cli::interrupt::Interrupt;
use crate::cli::output::{Output, Pace, grouped, score_text};
use crate::lab::report::Timings;
use crate::metrics::MeanScore;
use crate::scene::Split;
use crate::simplify::AutoRun;
use crate::train::StepReport;
use indicatif::ProgressBar;
use serde_json::json;
use std::path::Path;
use std::time::{Duration, Instant};

/// Steps until the end of the run or an interruption; a checkpoint is written in either case.
pub(super) fn run_steps(
    session: &Session<'_>,
    run: &mut AutoRun<'_>,
    state: &mut RunState,
    interrupt: &Interrupt,
) -> Result<Outcome> {
    let mut display = Display::new(state, run.iteration(), session.output);
    let mut outcome = Outcome::Done;
    while run.iteration() < state.iterations {
        if interrupt.is_requested() {
            outcome = Outcome::Interrupted;
            break;
        }
        timed(state, |t| &mut t.train_seconds, || run.step())?
            .iter()
            .for_each(|report| display.show(state, report));
        state.iterations = run.end();
        let done = run.iteration();
        let is_due = |every: u32| every > 0 && done.is_multiple_of(every) && done < state.iterations;
        let (evaluates, saves) = (is_due(session.eval_every), is_due(session.checkpoint_every));
        if evaluates {
            drain(run, state, &mut display)?;
            let splats = run.splats()?;
            let score = timed(
                state,
                |t| &mut t.evaluate_seconds,
                || {
                    let scores = session.evaluator(run.config(), Split::Test).scores(&splats)?;
                    Ok(MeanScore::of(&scores))
                },
            )?;
            state.add_test(done, splats.len(), score);
            display.show_test(done, &score);
        }
        if saves {
            save(run, state, &mut display, session.dir)?;
        }
    }
    save(run, state, &mut display, session.dir)?;
    display.bar.finish_and_clear();
    Ok(outcome)
}

/// Writes the checkpoint, then `run.json`: one older than its checkpoint lacks a few figures, a newer one is rewound.
fn save(run: &mut AutoRun<'_>, state: &mut RunState, display: &mut Display, dir: &Path) -> Result<()> {
    drain(run, state, display)?;
    state.iteration = run.iteration();
    let path = dir.join("checkpoint");
    timed(state, |t| &mut t.checkpoint_seconds, || run.save(&path))?;
    state.write(dir)
}

fn drain(run: &mut AutoRun<'_>, state: &mut RunState, display: &mut Display) -> Result<()> {
    let reports = timed(state, |t| &mut t.train_seconds, || run.finish())?;
    reports.iter().for_each(|report| display.show(state, report));
    Ok(())
}

/// Runs `call` and adds its duration to one of the run's timings.
fn timed<T>(
    state: &mut RunState,
    part: impl FnOnce(&mut Timings) -> &mut f64,
    call: impl FnOnce() -> Result<T>,
) -> Result<T> {
    let start = Instant::now();
    let result = call();
    *part(&mut state.timings) += start.elapsed().as_secs_f64();
    result
}

/// Progress bar, or JSON lines.
struct Display {
    bar: ProgressBar,
    output: Output,
    pace: Pace,
    /// Training seconds and iteration at the start of this session.
    start: (f64, u32),
}

impl Display {
    fn new(state: &RunState, iteration: u32, output: Output) -> Display {
        let bar = output.bar(u64::from(state.iterations), "training");
        bar.set_position(u64::from(iteration));
        bar.reset_eta();
        Display {
            bar,
            output,
            pace: Pace::new(Duration::from_millis(500)),
            start: (state.timings.train_seconds, iteration),
        }
    }

    fn show(&mut self, state: &mut RunState, report: &StepReport) {
        let entries = state.history.len();
        state.add(report);
        let (seconds, first) = self.start;
        let elapsed = state.timings.train_seconds - seconds;
        let rate = f64::from(report.iteration.saturating_sub(first)) / elapsed.max(1e-9);
        self.bar.set_position(u64::from(report.iteration));
        self.bar.set_message(format!(
            "· loss {:.4} · {:.2} dB · {} splats · {rate:.2} it/s",
            report.loss,
            report.psnr_db,
            grouped(report.splat_count),
        ));
        if state.history.len() > entries || self.pace.is_due() {
            self.output.event(|| {
                json!({
                    "event": "step",
                    "iteration": report.iteration,
                    "loss": report.loss,
                    "psnr_db": report.psnr_db,
                    "splat_count": report.splat_count,
                    "seconds": state.timings.train_seconds,
                    "steps_per_second": rate,
                })
            });
        }
    }

    fn show_test(&self, iteration: u32, score: &MeanScore) {
        let text = score_text(score);
        self.bar
            .suspend(|| self.output.remark(format_args!("iteration {iteration}: test {text}")));
        self.output
            .event(|| json!({"event": "test", "iteration": iteration, "score": score}));
    }
}
