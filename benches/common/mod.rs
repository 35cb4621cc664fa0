//! What all benches share: options, repetition, and the record that they leave.
//!
//! Times are the device's own timestamps. Runs behind a warm-up are summed up by their median and the
//! median absolute deviation from it, which a stray interruption does not move.

use ashfall::gpu::{Gpu, GpuOptions};
use clap::Parser;
use std::error::Error;
use std::fmt::Write;
use std::path::PathBuf;
use std::time::{SystemTime, UNIX_EPOCH};

pub(crate) type Outcome<T> = Result<T, Box<dyn Error>>;

/// Runs before those that count: the first compiles shaders, the next fill caches.
const WARM_UP: usize = 3;

/// Measures the engine on one device.
#[derive(Parser)]
struct Options {
    /// Only what has this in its name
    filter: Option<String>,
    /// Runs of each that count
    #[arg(long, default_value_t = 21)]
    runs: usize,
    /// Index or part of the name of the device
    #[arg(long)]
    device: Option<String>,
    /// Write benches/record/<device>/<date>.csv, keeping what it has of other benches
    #[arg(long)]
    record: bool,
    /// What `cargo bench` says to every bench
    #[arg(long, hide = true)]
    bench: bool,
}

/// Labels and nanoseconds of one run.
pub(crate) type Times = Vec<(&'static str, f64)>;

/// Takes measurements and keeps them for the record.
pub(crate) struct Bench {
    name: &'static str,
    options: Options,
    rows: Vec<String>,
    pub(crate) gpu: Gpu,
}

const HEADER: &str = "bench,input,stage,runs,median_ns,mad_ns,items,unit";

impl Bench {
    /// Reads the command line and opens the device.
    pub(crate) fn new(name: &'static str) -> Outcome<Bench> {
        let options = Options::parse();
        let gpu = Gpu::create(&GpuOptions {
            device: options.device.clone(),
            ..GpuOptions::default()
        })?;
        println!("{}, {}", gpu.caps().name, gpu.caps().driver);
        Ok(Bench {
            name,
            options,
            rows: Vec::new(),
            gpu,
        })
    }

    /// Whether an input is asked for, before it is made.
    pub(crate) fn wants(&self, input: &str) -> bool {
        let name = format!("{}/{input}", self.name);
        self.options
            .filter
            .as_ref()
            .is_none_or(|filter| name.contains(filter.as_str()))
    }

    /// Runs something again and again. `items` of `unit` is the work that one run does.
    pub(crate) fn measure(
        &mut self,
        input: &str,
        (items, unit): (usize, &str),
        mut run: impl FnMut() -> ashfall::Result<Times>,
    ) -> Outcome<()> {
        for _ in 0..WARM_UP {
            run()?;
        }
        let runs: Vec<Times> = (0..self.options.runs.max(1))
            .map(|_| run())
            .collect::<Result<_, _>>()?;
        let stages: Vec<&str> = runs[0].iter().map(|(label, _)| *label).collect();
        if stages.is_empty() {
            return Err("the device has no timestamps".into());
        }
        let total = || runs.iter().map(|run| run.iter().map(|(_, ns)| ns).sum());
        println!("{}/{input}", self.name);
        let several = stages.len() > 1;
        for (i, stage) in stages.iter().enumerate().filter(|_| several) {
            self.row(
                input,
                stage,
                runs.iter().map(|run| run[i].1).collect(),
                None,
            );
        }
        self.row(input, "total", total().collect(), Some((items, unit)));
        Ok(())
    }

    fn row(&mut self, input: &str, stage: &str, times: Vec<f64>, work: Option<(usize, &str)>) {
        let runs = times.len();
        let median_ns = median(times.clone());
        let mad_ns = median(times.iter().map(|t| (t - median_ns).abs()).collect());
        let mut line = format!(
            "  {stage:<20} {:>10.3} ms ± {:.3}",
            median_ns * 1e-6,
            mad_ns * 1e-6
        );
        let (items, unit) = work.unwrap_or((0, ""));
        if items > 0 {
            let rate = items as f64 / median_ns * 1e3;
            let _ = write!(line, "  {rate:.1} M {unit}/s");
        }
        println!("{line}");
        self.rows.push(format!(
            "{},{input},{stage},{runs},{median_ns:.0},{mad_ns:.0},{items},{unit}",
            self.name
        ));
    }

    /// Writes the record, if one is asked for.
    pub(crate) fn finish(self) -> Outcome<()> {
        if !self.options.record {
            return Ok(());
        }
        let device: String = self.gpu.caps().name.to_lowercase();
        let words = device.split(|c: char| !c.is_ascii_alphanumeric());
        let device = words
            .filter(|w| !w.is_empty())
            .collect::<Vec<_>>()
            .join("-");
        let days = SystemTime::now().duration_since(UNIX_EPOCH)?.as_secs() / 86_400;
        let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
            .join("benches/record")
            .join(device);
        let path = folder.join(format!("{}.csv", date(days)));
        let earlier = std::fs::read_to_string(&path).unwrap_or_default();
        let name_of = |row: &str| row.split(',').take(3).collect::<Vec<_>>().join(",");
        let measured: Vec<String> = self.rows.iter().map(|row| name_of(row)).collect();
        let kept = earlier.lines().skip(1).map(str::to_owned);
        let mut rows: Vec<String> = kept
            .filter(|row| !measured.contains(&name_of(row)))
            .collect();
        rows.extend(self.rows);
        std::fs::create_dir_all(&folder)?;
        std::fs::write(&path, format!("{HEADER}\n{}\n", rows.join("\n")))?;
        println!("{}", path.display());
        Ok(())
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    if values.len() % 2 == 1 {
        values[middle]
    } else {
        0.5 * (values[middle - 1] + values[middle])
    }
}

/// Year-month-day of a count of days since 1970 (Hinnant, "chrono-compatible low-level date algorithms").
fn date(days: u64) -> String {
    let shifted = days + 719_468;
    let (era, of_era) = (shifted / 146_097, shifted % 146_097);
    let year = (of_era - of_era / 1_460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year + year / 4 - year / 100);
    let month = (5 * of_year + 2) / 153;
    let day = of_year - (153 * month + 2) / 5 + 1;
    let month = if month < 10 { month + 3 } else { month - 9 };
    let year = era * 400 + year + u64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02}")
}
