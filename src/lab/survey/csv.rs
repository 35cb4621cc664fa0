//! Runs as lines of a file, one each, for other programs and for going on where a survey was broken off.

use super::Run;
use crate::{Error, Result};
use serde_json::{Map, Number, Value};
use std::path::Path;

/// The columns. Lists are separated by spaces; what is not known is empty.
pub const COLUMNS: [&str; 31] = [
    "scene",
    "recipe",
    "seed",
    "iterations",
    "gain_db",
    "max_splats",
    "train_views",
    "test_views",
    "width",
    "height",
    "data",
    "device",
    "date",
    "version",
    "splats",
    "splats_by_degree",
    "psnr_db",
    "ssim",
    "train_seconds",
    "cpu_seconds",
    "ply_bytes",
    "device_bytes_by_degree",
    "sh_floats",
    "frame_ms",
    "frame_cpu_ms",
    "settled_from",
    "sh_lost_db",
    "knee",
    "law",
    "point_splats",
    "point_db",
];

/// Those that hold words, whatever they look like.
const WORDS: [&str; 6] = ["scene", "recipe", "data", "device", "date", "version"];

/// Those that hold lists of numbers.
const LISTS: [&str; 5] = [
    "splats_by_degree",
    "device_bytes_by_degree",
    "law",
    "point_splats",
    "point_db",
];

/// All runs, a line each.
pub fn csv(runs: &[Run]) -> String {
    let mut text = COLUMNS.join(",") + "\n";
    for run in runs {
        let tree = serde_json::to_value(run).unwrap_or_default();
        let fields = COLUMNS.map(|column| field(&tree[column]));
        text += &(fields.join(",") + "\n");
    }
    text
}

fn field(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        // Were a name to hold a comma, it must not shift the columns.
        Value::String(text) => text.replace([',', '\n', '\r'], ";"),
        Value::Array(values) => values.iter().map(field).collect::<Vec<_>>().join(" "),
        other => other.to_string(),
    }
}

/// The runs of a file's text; `path` is for messages.
///
/// # Errors
/// When a line is not one of a run: which, and why.
pub fn parse(path: &Path, text: &str) -> Result<Vec<Run>> {
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    if let Some(absent) = COLUMNS.iter().find(|column| !header.contains(column)) {
        let what = format!("is no record of what scenes need: no column {absent}");
        return Err(Error::file(path, what));
    }
    let run = |(index, line): (usize, &str)| {
        let fault = |what: String| Error::file(path, format!("line {}: {what}", index + 2));
        let fields: Vec<&str> = line.split(',').collect();
        if fields.len() != header.len() {
            let (found, wanted) = (fields.len(), header.len());
            return Err(fault(format!("{found} fields instead of {wanted}")));
        }
        let mut tree = Map::new();
        for (column, text) in header.iter().zip(fields) {
            let value = value(column, text).ok_or_else(|| fault(format!("{column} is {text:?}")));
            tree.insert((*column).to_owned(), value?);
        }
        serde_json::from_value(Value::Object(tree)).map_err(|e| fault(e.to_string()))
    };
    lines.enumerate().map(run).collect()
}

/// What a field says; `None` if that is nothing that its column may say.
fn value(column: &str, text: &str) -> Option<Value> {
    let number = |text: &str| text.parse::<Number>().ok().map(Value::Number);
    match text {
        _ if WORDS.contains(&column) => Some(Value::String(text.to_owned())),
        _ if LISTS.contains(&column) => {
            let values: Option<Vec<Value>> = text.split_whitespace().map(number).collect();
            values.map(Value::Array)
        }
        "" => Some(Value::Null),
        text => number(text),
    }
}

#[cfg(test)]
mod tests {
    use super::super::Recipe;
    use super::super::tests::{run, survey};
    use super::*;

    fn rich() -> Run {
        Run {
            recipe: Recipe::McmcRates,
            gain_db: 0.04,
            max_splats: Some(1_234),
            data: "00e1".into(),
            settled_from: Some(70),
            sh_lost_db: Some(1.0 / 256.0),
            knee: Some(1.0 / 3.0),
            law: vec![31.5, 900.0, 0.65],
            point_splats: vec![2e4, 1e4],
            point_db: vec![31.25, 30.0],
            ..run("1e5", Recipe::Fixed, 7, 10, 31.234_567_890_123)
        }
    }

    #[test]
    fn what_is_written_is_read_back_to_the_bit() -> Result<()> {
        let mut runs = survey().runs;
        runs.push(rich());
        let text = csv(&runs);
        let columns = COLUMNS.len();
        assert!(text.lines().all(|line| line.split(',').count() == columns));
        assert_eq!(parse(Path::new("needs.csv"), &text)?, runs);
        // No column is missing.
        let tree = serde_json::to_value(rich()).unwrap_or_default();
        assert_eq!(tree.as_object().map(Map::len), Some(columns));
        Ok(())
    }

    #[test]
    fn faults_are_named_with_their_line() {
        let text = csv(&[rich(), rich()]);
        let message = |text: &str| {
            let found = parse(Path::new("needs.csv"), text);
            found.err().map(|e| e.to_string()).unwrap_or_default()
        };
        assert!(message("a,b\n").contains("needs.csv: is no record"));
        let cut = &text[..text.len() - 30];
        assert!(message(cut).contains("line 3: "), "{}", message(cut));
        let wrong = text.replacen("mcmc-rates", "mcmc-rats", 1);
        assert!(message(&wrong).contains("line 2: "), "{}", message(&wrong));
        let wrong = text.replacen("900.0", "many", 1);
        assert!(message(&wrong).contains("law is"), "{}", message(&wrong));
        assert!(message(&text).is_empty());
    }
}
