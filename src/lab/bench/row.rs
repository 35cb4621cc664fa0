//! Measurements, a row each, as CSV and text.

use crate::stats::Summary;
use crate::{Error, Result};
use serde::Serialize;
use std::fmt::Write;

/// Work of one run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Work {
    /// Count.
    pub items: u64,
    /// Unit of the count, the word in tables and files; empty for time alone.
    pub unit: &'static str,
    /// Bytes read and written by a memory-bound kernel; else 0.
    pub bytes: u64,
}

impl Work {
    /// Work of `items`, without bytes.
    pub fn of(items: usize, unit: &'static str) -> Work {
        Work {
            items: items as u64,
            unit,
            bytes: 0,
        }
    }

    /// The same work of a memory-bound kernel that moves `bytes`.
    pub fn moving(self, bytes: usize) -> Work {
        Work {
            bytes: bytes as u64,
            ..self
        }
    }
}

/// One measurement.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct BenchRow {
    /// Bench: `kernels`, `frame`, `train`, `guest`.
    pub bench: String,
    /// Task and input: `rasterize/small`.
    pub input: String,
    /// Variant and workgroup, `subgroup/8`; empty without a choice.
    pub variant: String,
    /// Part of the task; `total` for all of it.
    pub stage: String,
    /// Number of runs.
    pub runs: usize,
    /// Median of the time, ns.
    pub median_ns: f64,
    /// Median absolute deviation from it, ns.
    pub mad_ns: f64,
    /// Lower end of the median's 95 % interval, ns.
    pub low_ns: f64,
    /// Upper end of it, ns.
    pub high_ns: f64,
    /// Median of the process's processor time, ns; 0 if not measured.
    pub cpu_ns: f64,
    /// Work of one run.
    pub items: u64,
    /// Unit of the work.
    pub unit: &'static str,
    /// Items per second.
    pub rate: f64,
    /// Bytes read and written by one run of a memory-bound kernel; else 0.
    pub bytes: u64,
    /// Bytes per second as a share of the device's copy rate; 0 if not measured.
    pub copy_share: f64,
}

/// Leading columns that identify a measurement.
pub const KEY_COLUMNS: usize = 4;

impl BenchRow {
    /// The row with the times of its runs.
    pub fn with_times(self, times: &Summary, cpu_ns: f64) -> BenchRow {
        BenchRow {
            runs: times.runs,
            median_ns: times.median,
            mad_ns: times.mad,
            low_ns: times.interval[0],
            high_ns: times.interval[1],
            cpu_ns,
            ..self
        }
    }

    /// The row with its rates, from its times. `copy_rate` is the device's, bytes per second.
    pub fn with_work(self, work: Work, copy_rate: Option<f64>) -> BenchRow {
        let seconds = self.median_ns * 1e-9;
        let per_second = |count: u64| {
            if seconds > 0.0 { count as f64 / seconds } else { 0.0 }
        };
        BenchRow {
            items: work.items,
            unit: work.unit,
            rate: per_second(work.items),
            bytes: work.bytes,
            copy_share: copy_rate.map_or(0.0, |rate| per_second(work.bytes) / rate),
            ..self
        }
    }

    /// Names and fields of the columns of the CSV, in order.
    pub fn columns(&self) -> [(&'static str, String); 15] {
        let whole = |ns: f64| format!("{ns:.0}");
        [
            ("bench", self.bench.clone()),
            ("input", self.input.clone()),
            ("variant", self.variant.clone()),
            ("stage", self.stage.clone()),
            ("runs", self.runs.to_string()),
            ("median_ns", whole(self.median_ns)),
            ("mad_ns", whole(self.mad_ns)),
            ("low_ns", whole(self.low_ns)),
            ("high_ns", whole(self.high_ns)),
            ("cpu_ns", whole(self.cpu_ns)),
            ("items", self.items.to_string()),
            ("unit", self.unit.to_owned()),
            ("rate", whole(self.rate)),
            ("bytes", self.bytes.to_string()),
            ("copy_share", format!("{:.4}", self.copy_share)),
        ]
    }

    /// Fields of the columns.
    pub(super) fn fields(&self) -> [String; 15] {
        self.columns().map(|(_, field)| field)
    }

    /// One line of text.
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
        if self.items > 0 && self.unit != "bytes" {
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

/// Names of the columns of the CSV, in order.
pub fn column_names() -> [&'static str; 15] {
    BenchRow::default().columns().map(|(name, _)| name)
}

/// Rows as CSV, with a header.
///
/// # Errors
/// Those of the CSV writer.
pub fn csv(rows: &[BenchRow]) -> Result<String> {
    csv_of_fields(rows.iter().map(BenchRow::fields))
}

/// Fields of rows as CSV, with a header.
pub(super) fn csv_of_fields(rows: impl IntoIterator<Item = [String; 15]>) -> Result<String> {
    csv_text([column_names().map(String::from)].into_iter().chain(rows))
}

/// Serialised lines as CSV; those of structs have a header.
pub(in crate::lab) fn csv_text<T: Serialize>(lines: impl IntoIterator<Item = T>) -> Result<String> {
    let text = || -> std::result::Result<String, Box<dyn std::error::Error>> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        for line in lines {
            writer.serialize(line)?;
        }
        Ok(String::from_utf8(writer.into_inner()?)?)
    };
    text().map_err(|error| Error::Config(format!("the CSV: {error}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_follow_from_times() -> Result<()> {
        let row = BenchRow {
            input: "a,b".into(),
            stage: "total".into(),
            ..BenchRow::default()
        };
        let row = row.with_times(&Summary::of(&[1e6, 2e6, 3e6]), 4e6);
        let work = Work::of(1000, "keys").moving(8000);
        let row = row.with_work(work, Some(8e6));
        assert_eq!((row.median_ns, row.rate, row.copy_share), (2e6, 5e5, 0.5));
        let text = csv(std::slice::from_ref(&row))?;
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], column_names().join(","));
        assert_eq!(
            lines[1],
            ",\"a,b\",,total,3,2000000,1000000,1000000,3000000,4000000,1000,keys,500000,8000,0.5000"
        );
        assert!(row.line().contains("0.5 M keys/s"), "{}", row.line());
        let never = BenchRow::default().with_work(work, None);
        assert_eq!(never.rate, 0.0);
        Ok(())
    }
}
