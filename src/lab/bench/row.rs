//! What was measured, one row each, and how rows are written.

use crate::stats::Summary;
use serde::Serialize;
use std::fmt::Write;

/// What a rate counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Unit {
    /// Nothing: only the time matters.
    #[default]
    None,
    /// Bytes read and written.
    Bytes,
    /// Sorted or summed.
    Keys,
    /// Pixel–splat pairs that were blended.
    Pairs,
    /// Gaussians of the scene.
    Splats,
    /// Pixels of the image.
    Pixels,
    /// Splat–tile intersections.
    Isects,
}

impl Unit {
    /// As it stands in tables and files.
    pub fn name(self) -> &'static str {
        match self {
            Unit::None => "",
            Unit::Bytes => "bytes",
            Unit::Keys => "keys",
            Unit::Pairs => "blended pairs",
            Unit::Splats => "splats",
            Unit::Pixels => "pixels",
            Unit::Isects => "isects",
        }
    }
}

/// The work that one run does.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Work {
    /// How many.
    pub items: u64,
    /// Of what.
    pub unit: Unit,
    /// Bytes that have to be read and written, where that is what a kernel does most; else 0.
    pub bytes: u64,
}

impl Work {
    /// So many items, which are not a matter of bytes.
    pub fn of(items: usize, unit: Unit) -> Work {
        Work {
            items: items as u64,
            unit,
            bytes: 0,
        }
    }

    /// The same, for a kernel that mainly moves so many bytes.
    pub fn moving(self, bytes: usize) -> Work {
        Work {
            bytes: bytes as u64,
            ..self
        }
    }
}

/// One measurement.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Row {
    /// Which bench: `kernels`, `frame`, `train`.
    pub bench: String,
    /// What was measured, on what: `rasterize/small`.
    pub input: String,
    /// How: variant and workgroup, `subgroup/8`; empty where there is no choice.
    pub variant: String,
    /// Which part of it; `total` is all of it.
    pub stage: String,
    /// Runs that count.
    pub runs: usize,
    /// Median of the time, ns.
    pub median_ns: f64,
    /// Median absolute deviation from it, ns.
    pub mad_ns: f64,
    /// Lower end of the median's 95 % interval, ns.
    pub low_ns: f64,
    /// Upper end of it, ns.
    pub high_ns: f64,
    /// Median of the process's processor time, ns; 0 where it was not measured.
    pub cpu_ns: f64,
    /// Work of one run.
    pub items: u64,
    /// What that counts.
    pub unit: &'static str,
    /// Items per second.
    pub rate: f64,
    /// Bytes read and written by one run; 0 where that is not the point.
    pub bytes: u64,
    /// Bytes per second as a share of what the device's own copying reaches; 0 where not measured.
    pub copy_share: f64,
}

/// The columns of the CSV, in order.
pub const COLUMNS: [&str; 15] = [
    "bench",
    "input",
    "variant",
    "stage",
    "runs",
    "median_ns",
    "mad_ns",
    "low_ns",
    "high_ns",
    "cpu_ns",
    "items",
    "unit",
    "rate",
    "bytes",
    "copy_share",
];

/// Columns that say which measurement a row is.
pub const KEY_COLUMNS: usize = 4;

impl Row {
    /// A row's times, from those of its runs.
    pub fn with_times(self, times: &Summary, cpu_ns: f64) -> Row {
        Row {
            runs: times.runs,
            median_ns: times.median,
            mad_ns: times.mad,
            low_ns: times.interval[0],
            high_ns: times.interval[1],
            cpu_ns,
            ..self
        }
    }

    /// A row's rates; its times must stand. `copy_rate` is the device's, bytes per second.
    pub fn with_work(self, work: Work, copy_rate: Option<f64>) -> Row {
        let seconds = self.median_ns * 1e-9;
        let per_second = |count: u64| {
            if seconds > 0.0 {
                count as f64 / seconds
            } else {
                0.0
            }
        };
        Row {
            items: work.items,
            unit: work.unit.name(),
            rate: per_second(work.items),
            bytes: work.bytes,
            copy_share: copy_rate.map_or(0.0, |rate| per_second(work.bytes) / rate),
            ..self
        }
    }

    /// Its fields, in the order of [`COLUMNS`].
    pub fn fields(&self) -> [String; COLUMNS.len()] {
        let whole = |ns: f64| format!("{ns:.0}");
        [
            self.bench.clone(),
            self.input.clone(),
            self.variant.clone(),
            self.stage.clone(),
            self.runs.to_string(),
            whole(self.median_ns),
            whole(self.mad_ns),
            whole(self.low_ns),
            whole(self.high_ns),
            whole(self.cpu_ns),
            self.items.to_string(),
            self.unit.to_owned(),
            whole(self.rate),
            self.bytes.to_string(),
            format!("{:.4}", self.copy_share),
        ]
    }

    /// A line of a table for people.
    pub fn line(&self) -> String {
        let name = match (self.stage.as_str(), self.variant.as_str()) {
            ("total", "") => self.input.clone(),
            ("total", variant) => format!("{} {variant}", self.input),
            (stage, _) => format!("    {stage}"),
        };
        let mut line = format!(
            "{name:<44} {:>10.3} ms ± {:<7.3} {:>10.3} CPU-ms",
            self.median_ns * 1e-6,
            self.mad_ns * 1e-6,
            self.cpu_ns * 1e-6
        );
        // Writing to a string does not fail.
        if self.items > 0 && self.unit != Unit::Bytes.name() {
            _ = write!(line, "  {:.1} M {}/s", self.rate * 1e-6, self.unit);
        }
        if self.bytes > 0 {
            let rate = self.bytes as f64 / self.median_ns;
            _ = write!(line, "  {rate:.1} GB/s");
        }
        if self.copy_share > 0.0 {
            _ = write!(line, " ({:.0} % of copying)", 100.0 * self.copy_share);
        }
        line
    }
}

/// All rows as CSV, with a header.
pub fn csv(rows: &[Row]) -> String {
    let mut text = COLUMNS.join(",") + "\n";
    for row in rows {
        text.push_str(&line(&row.fields()));
    }
    text
}

/// Fields as one line of CSV. Names of inputs and variants are ours and hold no commas; were one to appear,
/// it must not shift the columns.
pub(super) fn line(fields: &[String]) -> String {
    let fields: Vec<String> = fields.iter().map(|f| f.replace([',', '\n'], ";")).collect();
    fields.join(",") + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_follow_from_times() {
        let row = Row {
            input: "a,b".into(),
            stage: "total".into(),
            ..Row::default()
        };
        let row = row.with_times(&Summary::of(&[1e6, 2e6, 3e6]), 4e6);
        let work = Work::of(1000, Unit::Keys).moving(8000);
        let row = row.with_work(work, Some(8e6));
        assert_eq!((row.median_ns, row.rate, row.copy_share), (2e6, 5e5, 0.5));
        let text = csv(std::slice::from_ref(&row));
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], COLUMNS.join(","));
        assert_eq!(
            lines[1],
            ",a;b,,total,3,2000000,1000000,1000000,3000000,4000000,1000,keys,500000,8000,0.5000"
        );
        assert!(row.line().contains("0.5 M keys/s"), "{}", row.line());
        let never = Row::default().with_work(work, None);
        assert_eq!(never.rate, 0.0);
    }
}
