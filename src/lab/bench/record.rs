//! Records: measurements on a device on a day, in `<folder>/<device>/<date>.csv`. Committed, they are the evidence for
//! the choices of [`prefer`](crate::kernels).

use super::row::{BenchRow, KEY_COLUMNS, column_names, csv_of_fields};
use crate::io::atomic::write_atomically;
use crate::{Error, Result};
use std::collections::HashMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// Files rows under a device and today's date (UTC), beside other measurements of that day. Returns the file.
pub fn write(folder: &Path, device: &str, rows: &[BenchRow]) -> Result<PathBuf> {
    let path = file(folder, device, ".csv")?;
    let earlier = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
        Err(error) => return Err(Error::io(&path)(error)),
    };
    let text = merged(&earlier, rows)?;
    write_atomically(&path, |file| file.write_all(text.as_bytes()))?;
    Ok(path)
}

/// `<folder>/<device>/<today><ending>`, in a folder made on demand.
pub fn file(folder: &Path, device: &str, ending: &str) -> Result<PathBuf> {
    let folder = folder.join(slug(device));
    std::fs::create_dir_all(&folder).map_err(Error::io(&folder))?;
    Ok(folder.join(today() + ending))
}

/// Today's date (UTC), year-month-day.
pub fn today() -> String {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    date(since.map_or(0, |since| since.as_secs() / 86_400))
}

/// A device's name as a folder: `llvmpipe-llvm-15-0-6-256-bits`.
pub fn slug(device: &str) -> String {
    let lower = device.to_lowercase();
    let words = lower.split(|c: char| !c.is_ascii_alphanumeric());
    let words: Vec<&str> = words.filter(|word| !word.is_empty()).collect();
    match words.as_slice() {
        [] => "device".into(),
        words => words.join("-"),
    }
}

/// Earlier rows, except those measured again, and the new ones. Columns are matched by name, so that records of earlier
/// versions can be extended.
fn merged(earlier: &str, rows: &[BenchRow]) -> Result<String> {
    let measured: Vec<_> = rows.iter().map(BenchRow::fields).collect();
    let mut all = Vec::new();
    for line in csv::Reader::from_reader(earlier.as_bytes()).deserialize() {
        let line: csv::Result<HashMap<String, String>> = line;
        let mut line = line.map_err(|error| Error::Config(format!("the record: {error}")))?;
        let fields = column_names().map(|column| line.remove(column).unwrap_or_default());
        if !measured.iter().any(|row| row[..KEY_COLUMNS] == fields[..KEY_COLUMNS]) {
            all.push(fields);
        }
    }
    all.extend(measured);
    csv_of_fields(all)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_become_dates() {
        let dates = [0, 11_016, 11_017, 20_778].map(date);
        assert_eq!(dates, ["1970-01-01", "2000-02-29", "2000-03-01", "2026-11-21"]);
    }

    #[test]
    fn names_become_folders() {
        let name = "llvmpipe (LLVM 15.0.6, 256 bits)";
        assert_eq!(slug(name), "llvmpipe-llvm-15-0-6-256-bits");
        assert_eq!([slug("../.."), slug("")], ["device", "device"]);
    }

    #[test]
    fn a_record_keeps_other_measurements() -> Result<()> {
        let row = |input: &str, median_ns: f64| BenchRow {
            bench: "kernels".into(),
            input: input.into(),
            stage: "total".into(),
            median_ns,
            ..BenchRow::default()
        };
        let first = merged("", &[row("a", 1.0), row("b", 2.0)])?;
        let second = merged(&first, &[row("b", 3.0), row("c", 4.0)])?;
        let inputs: Vec<(&str, &str)> = second
            .lines()
            .skip(1)
            .map(|line| {
                let fields: Vec<&str> = line.split(',').collect();
                (fields[1], fields[5])
            })
            .collect();
        assert_eq!(inputs, [("a", "1"), ("b", "3"), ("c", "4")]);
        // A file with fewer columns, in another order.
        let old = "stage,bench,input,median_ns\ntotal,kernels,a,5\n";
        let both = merged(old, &[row("b", 6.0)])?;
        assert!(both.contains("\nkernels,a,,total,,5,,,,,,,,,\n"), "{both}");
        Ok(())
    }

    #[test]
    fn committed_records_are_written_as_they_are() -> Result<()> {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/record");
        let folder = folder.join("llvmpipe-llvm-15-0-6-256-bits");
        for date in ["2026-11-21", "2026-11-22"] {
            let path = folder.join(format!("{date}.csv"));
            let text = std::fs::read_to_string(&path).map_err(Error::io(&path))?;
            assert!(text.lines().count() > 100);
            assert_eq!(merged(&text, &[])?, text);
        }
        Ok(())
    }
}
