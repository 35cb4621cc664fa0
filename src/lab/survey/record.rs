//! Runs of a survey as CSV, a line each.

use super::SurveyRun;
use crate::lab::bench::row::csv_text;
use crate::{Error, Result};
use std::path::Path;

/// All runs; empty without any.
///
/// # Errors
/// Those of the CSV writer.
pub fn write(runs: &[SurveyRun]) -> Result<String> {
    csv_text(runs)
}

/// Columns that earlier versions did not write, or by another name: those with a default or an alias in [`SurveyRun`].
const OPTIONAL: [&str; 6] = [
    "setting",
    "loss_db",
    "train_psnr_db",
    "train_ssim",
    "point_lost_db",
    "point_lost_ssim",
];

/// Runs of a file's text. Columns are matched by name; columns that a run lacks are ignored.
///
/// # Errors
/// A missing column, or a line with a bad field; `path` is for the message.
pub fn read(path: &Path, text: &str) -> Result<Vec<SurveyRun>> {
    let fault = |error: csv::Error| Error::file(path, error.to_string());
    if text.is_empty() {
        return Ok(Vec::new());
    }
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let header = reader.headers().map_err(fault)?;
    let columns = write(&[SurveyRun::default()])?;
    let mut columns = columns.lines().next().unwrap_or_default().split(',');
    let is_present = |column: &str| OPTIONAL.contains(&column) || header.iter().any(|name| name == column);
    if let Some(absent) = columns.find(|column| !is_present(column)) {
        let what = format!("is no record of a survey: no column {absent}");
        return Err(Error::file(path, what));
    }
    reader.deserialize().map(|run| run.map_err(fault)).collect()
}

/// Lists as numbers separated by spaces.
pub(super) mod list {
    use serde::de::{DeserializeOwned, Error as _};
    use serde::ser::Error as _;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(crate) fn serialize<T: Serialize, S: Serializer>(values: &[T], serializer: S) -> Result<S::Ok, S::Error> {
        let text = serde_json::to_string(values).map_err(S::Error::custom)?;
        serializer.serialize_str(&text.trim_matches(['[', ']']).replace(',', " "))
    }

    pub(crate) fn deserialize<'de, T: DeserializeOwned, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Vec<T>, D::Error> {
        let text = String::deserialize(deserializer)?;
        let values: Vec<&str> = text.split_whitespace().collect();
        serde_json::from_str(&format!("[{}]", values.join(","))).map_err(D::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Recipe;
    use super::super::tests::{run, survey};
    use super::*;
    use std::path::PathBuf;

    fn full() -> SurveyRun {
        SurveyRun {
            recipe: Recipe::McmcRates,
            loss_db: 0.04,
            setting: "auto.growth_share=0.9".into(),
            max_splats: Some(1_234),
            data: "00e1".into(),
            train_psnr_db: Some(33.5),
            train_ssim: Some(0.91),
            settled_from: Some(70),
            point_splats: vec![2e4, 1e4],
            point_lost_db: vec![0.0, 1.0 / 3.0],
            point_lost_ssim: vec![0.0, 1.0 / 256.0],
            ..run("1e5", Recipe::Fixed, 7, 10, 31.234_567_890_123)
        }
    }

    #[test]
    fn runs_are_read_back_to_the_bit() -> Result<()> {
        let mut runs = survey();
        runs.push(full());
        let text = write(&runs)?;
        assert!(text.lines().all(|line| line.split(',').count() == 32));
        assert_eq!(read(Path::new("needs.csv"), &text)?, runs);
        assert_eq!(read(Path::new("needs.csv"), &write(&[])?)?, []);
        Ok(())
    }

    #[test]
    fn faults_are_named_with_their_line() -> Result<()> {
        let text = write(&[full(), full()])?;
        let message = |text: &str| {
            let found = read(Path::new("needs.csv"), text);
            found.err().map(|e| e.to_string()).unwrap_or_default()
        };
        assert!(message("a,b\n").contains("needs.csv: is no record"));
        let cut = &text[..text.len() - 30];
        assert!(message(cut).contains("line: 3"), "{}", message(cut));
        let wrong = text.replacen("mcmc-rates", "mcmc-rats", 1);
        assert!(message(&wrong).contains("line: 2"), "{}", message(&wrong));
        let wrong = text.replacen("0.00390625", "many", 1);
        assert!(message(&wrong).contains("line: 2"), "{}", message(&wrong));
        assert!(message(&text).is_empty());
        Ok(())
    }

    /// Committed records with `word` in their name.
    fn records(word: &str) -> std::io::Result<Vec<PathBuf>> {
        let mut paths = Vec::new();
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/record");
        for device in std::fs::read_dir(folder)? {
            for file in std::fs::read_dir(device?.path())? {
                let path = file?.path();
                let name = path.file_name().unwrap_or_default().to_string_lossy();
                if name.contains(word) && name.ends_with(".csv") {
                    paths.push(path);
                }
            }
        }
        Ok(paths)
    }

    #[test]
    fn committed_records_are_read_and_written_as_they_are() -> Result<()> {
        let folder = Path::new("benches/record");
        let paths = records("needs").map_err(Error::io(folder))?;
        assert!(!paths.is_empty());
        let mut same = 0;
        for path in paths {
            let text = std::fs::read_to_string(&path).map_err(Error::io(&path))?;
            let runs = read(&path, &text)?;
            assert_eq!(runs.len() + 1, text.lines().count(), "{}", path.display());
            let written = write(&runs)?;
            // Records of earlier versions have other columns.
            if text.lines().next() == written.lines().next() {
                assert_eq!(written, text, "{}", path.display());
                same += 1;
            } else {
                assert_eq!(read(&path, &written)?, runs, "{}", path.display());
            }
        }
        assert!(same > 0, "no record has today's columns");
        Ok(())
    }
}
