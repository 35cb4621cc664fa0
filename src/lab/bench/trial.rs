//! Trials: checked measurements, of one subject or of several in turns.

use super::check::Output;
use super::clock::CpuClock;
use super::row::Work;
use super::session::{Bench, Case, Times};
use crate::stats::Summary;
use crate::{Error, Result};
use std::time::Instant;

impl Case {
    /// A kernel on an input, in a variant with invocations per workgroup; 0 if fixed.
    pub fn of(kernel: &str, input: impl std::fmt::Display, variant: &str, workgroup: u32) -> Case {
        Case {
            input: format!("{kernel}/{input}"),
            variant: match workgroup {
                0 => variant.to_owned(),
                _ => format!("{variant}/{workgroup}"),
            },
            work: Work::default(),
        }
    }

    /// The same with the work of one run.
    pub fn doing(self, work: Work) -> Case {
        Case { work, ..self }
    }

    /// Compares the outputs with the reference.
    ///
    /// # Errors
    /// [`Error::Mismatch`] with the case and the first wrong output.
    pub fn judge(&self, outputs: &[Output]) -> Result<()> {
        let wrong = |what| {
            let kernel = format!("{} {}", self.input, self.variant);
            Err(Error::Mismatch { kernel, what })
        };
        if outputs.is_empty() {
            return wrong("nothing to check it by".into());
        }
        for output in outputs {
            if let Err(fault) = output.judge() {
                return wrong(format!("{}: {fault}", output.name));
            }
        }
        Ok(())
    }
}

impl Bench {
    /// Measures several subjects in turns, one run of each after the other, so that disturbances affect all alike.
    /// Returns the runs of each.
    pub fn measure_in_turns(&mut self, subjects: &mut [Subject<'_>]) -> Result<Vec<Vec<Times>>> {
        for subject in subjects.iter_mut() {
            self.warm_up(&mut subject.run)?;
        }
        let mut runs = vec![Vec::new(); subjects.len()];
        for _ in 0..self.options.runs.max(1) {
            for (subject, runs) in subjects.iter_mut().zip(&mut runs) {
                runs.push((subject.run)()?);
            }
        }
        for (subject, runs) in subjects.iter().zip(&runs) {
            self.keep(&subject.case, runs);
        }
        Ok(runs)
    }
}

/// Wall time of a subject over that of another by round, of runs in turns.
pub fn ratio_by_round(runs: &[Times], reference: &[Times]) -> Summary {
    let wall = |times: &Times| times.stages.iter().map(|(_, ns)| ns).sum::<f64>();
    let rounds = runs.iter().zip(reference);
    let ratios: Vec<f64> = rounds.map(|(run, reference)| wall(run) / wall(reference)).collect();
    Summary::of(&ratios)
}

/// One of several subjects measured in turns.
pub struct Subject<'a> {
    /// Name and work.
    pub case: Case,
    /// Runs it once.
    pub run: Box<dyn FnMut() -> Result<Times> + 'a>,
}

/// Times of a function on the processor.
pub fn host_times(run: impl FnOnce()) -> Times {
    let (clock, begin) = (CpuClock::now(), Instant::now());
    run();
    Times {
        stages: vec![("run", begin.elapsed().as_nanos() as f64)],
        cpu_ns: clock.elapsed_ns(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrong_result_names_its_kernel() {
        let case = Case::of("gather", 1024, "base", 64);
        let output = |found: f64| vec![Output::exact("values", vec![1.0, found], vec![1.0, 2.0])];
        assert!(case.judge(&output(2.0)).is_ok());
        let fault = case.judge(&output(3.0)).err().map(|error| error.to_string());
        let fault = fault.unwrap_or_default();
        assert!(
            fault.contains("gather/1024 base/64: wrong result: values: element 1"),
            "{fault}"
        );
        assert!(case.judge(&[]).is_err(), "nothing was checked");
    }
}
