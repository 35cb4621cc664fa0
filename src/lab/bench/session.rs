//! Taking measurements on one device.

use super::clock::CpuClock;
use super::row::{BenchRow, Work};
use crate::gpu::{Frames, Gpu, Recorder};
use crate::stats::Summary;
use crate::{Error, Result};
use std::cell::RefCell;
use std::collections::BTreeSet;

/// Bytes of the copy that bandwidths are held against: more than any cache holds.
const COPY_BYTES: usize = 64 << 20;

/// What is measured, and how often.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Options {
    /// Only what has this in its name, `bench/input/variant`.
    pub filter: Option<String>,
    /// Runs that count.
    pub runs: usize,
    /// Runs before them: the first compiles shaders, the next fill caches.
    pub warm_up: usize,
}

impl Default for Options {
    fn default() -> Options {
        Options {
            filter: None,
            runs: 21,
            warm_up: 3,
        }
    }
}

/// What one run took.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Times {
    /// Its parts in order, ns; the sum is the run's time.
    pub stages: Vec<(&'static str, f64)>,
    /// Processor time of the process, ns. `None`: [`Bench::measure`] takes it, around the whole call.
    pub cpu_ns: Option<f64>,
}

impl From<Vec<(&'static str, f64)>> for Times {
    fn from(stages: Vec<(&'static str, f64)>) -> Times {
        Times {
            stages,
            cpu_ns: None,
        }
    }
}

/// What a measurement is called, and the work that one run does.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Case {
    /// What is measured, on what: `rasterize/small`.
    pub input: String,
    /// How: `subgroup/8`; may be empty.
    pub variant: String,
    /// Work of one run.
    pub work: Work,
}

/// Takes measurements on a device and keeps them.
pub struct Bench {
    name: &'static str,
    options: Options,
    gpu: Gpu,
    copy_rate: Option<f64>,
    rows: Vec<BenchRow>,
    names: RefCell<BTreeSet<String>>,
    /// Called with each row as it is measured.
    progress: Box<dyn FnMut(&BenchRow)>,
}

impl Bench {
    /// Nothing measured yet. `progress` sees every row as it comes.
    ///
    /// # Errors
    /// When the device has no timestamps.
    pub fn new(
        name: &'static str,
        gpu: &Gpu,
        options: Options,
        progress: impl FnMut(&BenchRow) + 'static,
    ) -> Result<Bench> {
        if gpu.caps().timestamp_period_ns <= 0.0 {
            let what = format!("measuring: {} has no timestamps", gpu.caps().name);
            return Err(Error::Unsupported { what });
        }
        Ok(Bench {
            name,
            options,
            gpu: gpu.clone(),
            copy_rate: None,
            rows: Vec::new(),
            names: RefCell::default(),
            progress: Box::new(progress),
        })
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// What was asked for.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// All rows so far, in the order of measurement.
    pub fn rows(&self) -> &[BenchRow] {
        &self.rows
    }

    /// Whether a measurement of this name is asked for, before anything is made for it.
    pub fn wants(&self, case: &Case) -> bool {
        let whole = format!("{}/{}/{}", self.name, case.input, case.variant);
        let filter = self.options.filter.as_ref();
        let wanted = filter.is_none_or(|filter| whole.contains(filter.as_str()));
        self.names.borrow_mut().insert(whole);
        wanted
    }

    /// The names of all that was considered so far, whether it was wanted or not.
    pub fn names(&self) -> Vec<String> {
        self.names.borrow().iter().cloned().collect()
    }

    /// Runs something again and again, and keeps a row for each of its stages (if there are several) and
    /// one for the total, which is returned.
    pub fn measure(
        &mut self,
        case: &Case,
        mut run: impl FnMut() -> Result<Times>,
    ) -> Result<BenchRow> {
        for _ in 0..self.options.warm_up {
            run()?;
        }
        let mut runs = Vec::new();
        for _ in 0..self.options.runs.max(1) {
            let clock = CpuClock::now();
            let mut times = run()?;
            times.cpu_ns = times.cpu_ns.or_else(|| clock.elapsed_ns());
            runs.push(times);
        }
        Ok(self.keep(case, &runs))
    }

    /// Keeps the rows of runs that were taken elsewhere; see [`Bench::measure`]. There must be some, and all
    /// must have the same stages.
    pub fn keep(&mut self, case: &Case, runs: &[Times]) -> BenchRow {
        let stages: Vec<&str> = runs[0].stages.iter().map(|(label, _)| *label).collect();
        let row = |stage: &str| BenchRow {
            bench: self.name.into(),
            input: case.input.clone(),
            variant: case.variant.clone(),
            stage: stage.into(),
            ..BenchRow::default()
        };
        let total = |times: &Times| times.stages.iter().map(|(_, ns)| ns).sum();
        let totals: Vec<f64> = runs.iter().map(total).collect();
        let cpu: Vec<f64> = runs.iter().filter_map(|times| times.cpu_ns).collect();
        let whole = row("total")
            .with_times(&Summary::of(&totals), Summary::of(&cpu).median)
            .with_work(case.work, self.copy_rate);
        let mut rows = vec![whole.clone()];
        for (i, stage) in stages.iter().enumerate().filter(|_| stages.len() > 1) {
            let times: Vec<f64> = runs.iter().map(|times| times.stages[i].1).collect();
            rows.push(row(stage).with_times(&Summary::of(&times), 0.0));
        }
        rows.iter().for_each(|row| (self.progress)(row));
        self.rows.extend(rows);
        whole
    }

    /// Keeps rows that hold no times.
    pub fn note(&mut self, rows: impl IntoIterator<Item = BenchRow>) {
        self.rows.extend(rows);
    }

    /// Measures what `record` records. Whatever a run changes that the next one needs, `prepare` puts back,
    /// in a submission of its own that is not timed.
    pub fn measure_commands(
        &mut self,
        case: &Case,
        prepare: impl Fn(&mut Recorder<'_>),
        record: impl Fn(&mut Recorder<'_>),
    ) -> Result<BenchRow> {
        let mut frames = Frames::new(&self.gpu, 1, true)?;
        self.measure(case, || device_times(&mut frames, &prepare, &record))
    }

    /// The rate at which the device copies memory, bytes read and written per second; measured once.
    pub fn copy_rate(&mut self) -> Result<f64> {
        if let Some(rate) = self.copy_rate {
            return Ok(rate);
        }
        let words = COPY_BYTES / 4;
        let [from, to] = ["from", "to"].map(|name| self.gpu.buffer::<u32>(name, words));
        let (from, to) = (from?, to?);
        // Memory that was never written may not be there yet.
        self.gpu.run(|rec| {
            rec.fill(&from, 1);
            rec.fill(&to, 2);
        })?;
        let case = Case {
            input: "copy".into(),
            variant: String::new(),
            work: Work::of(2 * COPY_BYTES, super::Unit::Bytes).moving(2 * COPY_BYTES),
        };
        let row = self.measure_commands(&case, |_| {}, |rec| rec.copy(&from, 0..words, &to, 0))?;
        self.copy_rate = Some(row.rate);
        Ok(row.rate)
    }
}

/// One submission, by the device's clock and the process's, after another that prepares it.
pub fn device_times(
    frames: &mut Frames,
    prepare: impl Fn(&mut Recorder<'_>),
    record: impl Fn(&mut Recorder<'_>),
) -> Result<Times> {
    let (ticket, ()) = frames.submit(|rec| {
        prepare(rec);
        Ok(())
    })?;
    frames.wait(ticket)?;
    let clock = CpuClock::now();
    let (ticket, ()) = frames.submit(|rec| {
        record(rec);
        rec.timestamp("run");
        Ok(())
    })?;
    let stages = frames.timings(ticket)?;
    Ok(Times {
        stages,
        cpu_ns: clock.elapsed_ns(),
    })
}
