//! Session of measurements on one device.

use super::clock::CpuClock;
use super::row::{BenchRow, Work};
use crate::gpu::{DeviceKind, Frames, Gpu, Recorder};
use crate::stats::Summary;
use crate::{Error, Result};
use std::collections::BTreeSet;
use std::time::{Duration, Instant};

/// Bytes of the copy that measures the bandwidth: beyond any cache.
const COPY_BYTES: usize = 64 << 20;

/// Least time of warming up on a GPU, which raises its clocks only under load.
const CLOCK_RAMP: Duration = Duration::from_millis(300);

/// Selection and repetitions of measurements.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BenchOptions {
    /// Only cases with this text in their name, `bench/input/variant`.
    pub filter: Option<String>,
    /// Counted runs.
    pub runs: usize,
    /// Warm-up runs: the first compiles shaders, the next fill caches.
    pub warm_up: usize,
}

impl Default for BenchOptions {
    fn default() -> BenchOptions {
        BenchOptions {
            filter: None,
            runs: 21,
            warm_up: 3,
        }
    }
}

/// Times of one run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Times {
    /// Stages in order, ns; the sum is the run's time.
    pub stages: Vec<(&'static str, f64)>,
    /// Processor time of the process, ns; `None` if it is not measured.
    pub cpu_ns: Option<f64>,
}

/// Name of a measurement, and the work of one run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Case {
    /// Task and input: `rasterize/small`.
    pub input: String,
    /// Variant and workgroup: `subgroup/8`; may be empty.
    pub variant: String,
    /// Work of one run.
    pub work: Work,
}

/// Measurements on a device.
pub struct Bench {
    name: &'static str,
    pub(super) options: BenchOptions,
    gpu: Gpu,
    copy_rate: Option<f64>,
    /// All rows so far, in the order of measurement.
    pub rows: Vec<BenchRow>,
    /// Names of all cases considered so far, selected or not.
    pub names: BTreeSet<String>,
    /// Called with each row once it is measured.
    progress: Box<dyn FnMut(&BenchRow)>,
}

impl Bench {
    /// A bench without rows. `progress` is called with every new row.
    ///
    /// # Errors
    /// A device without timestamps.
    pub fn new(
        name: &'static str,
        gpu: &Gpu,
        options: BenchOptions,
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
            names: BTreeSet::new(),
            progress: Box::new(progress),
        })
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// True if the filter selects a case; checked before its inputs are made.
    pub fn wants(&mut self, case: &Case) -> bool {
        let whole = format!("{}/{}/{}", self.name, case.input, case.variant);
        let filter = self.options.filter.as_ref();
        let wanted = filter.is_none_or(|filter| whole.contains(filter.as_str()));
        self.names.insert(whole);
        wanted
    }

    /// Runs a case repeatedly, and keeps a row for each of its stages (if there are several) and one for the total,
    /// which is returned.
    pub fn measure(&mut self, case: &Case, mut run: impl FnMut() -> Result<Times>) -> Result<BenchRow> {
        self.warm_up(&mut run)?;
        let mut runs = Vec::new();
        for _ in 0..self.options.runs.max(1) {
            runs.push(run()?);
        }
        Ok(self.keep(case, &runs))
    }

    /// Runs that do not count.
    pub(super) fn warm_up(&self, mut run: impl FnMut() -> Result<Times>) -> Result<()> {
        let least = match self.gpu.caps().kind {
            DeviceKind::Cpu => Duration::ZERO,
            _ => CLOCK_RAMP,
        };
        let begin = Instant::now();
        let mut done = 0;
        while done < self.options.warm_up || begin.elapsed() < least {
            run()?;
            done += 1;
        }
        Ok(())
    }

    /// Keeps the rows of runs timed elsewhere; see [`Bench::measure`]. At least one run is needed, and all must have
    /// the same stages.
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

    /// Measures the device's copy rate, for the rows that follow.
    ///
    /// # Errors
    /// Anything that Vulkan reports.
    pub fn measure_copy_rate(&mut self) -> Result<()> {
        let words = COPY_BYTES / 4;
        let [from, to] = ["from", "to"].map(|name| self.gpu.buffer::<u32>(name, words));
        let (from, to) = (from?, to?);
        // Memory that was never written may not be backed by pages.
        self.gpu.run(|rec| {
            rec.fill(&from, 1);
            rec.fill(&to, 2);
        })?;
        let case = Case {
            input: "copy".into(),
            variant: String::new(),
            work: Work::of(2 * COPY_BYTES, "bytes").moving(2 * COPY_BYTES),
        };
        let mut frames = Frames::new(&self.gpu, 1, true)?;
        let copy = || device_times(&mut frames, |_| {}, |rec| rec.copy(&from, 0..words, &to, 0));
        self.copy_rate = Some(self.measure(&case, copy)?.rate);
        Ok(())
    }
}

/// Device and processor time of one submission, after another that prepares it.
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
