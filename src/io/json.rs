//! Values of JSON documents, by key, with faults that name the key.

use super::check::Check;
use crate::error::{Error, Result};
use serde_json::{Map, Value};
use std::path::Path;

/// The document of a file.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Value> {
    serde_json::from_slice(bytes).map_err(|e| Error::file(path, format!("cannot be parsed as JSON: {e}")))
}

pub(super) fn object(value: &Value) -> Check<&Map<String, Value>> {
    match value {
        Value::Object(map) => Ok(map),
        other => Err(format!("is {}, not an object", kind(other))),
    }
}

/// A finite number; `null` counts as absent.
pub(super) fn number(level: &Map<String, Value>, key: &str) -> Check<Option<f64>> {
    match level.get(key) {
        None | Some(Value::Null) => Ok(None),
        Some(value) => match value.as_f64().filter(|v| v.is_finite()) {
            Some(number) => Ok(Some(number)),
            None => Err(format!("{key:?} is {}, not a number", kind(value))),
        },
    }
}

/// A finite number that must be there.
pub(super) fn needed(level: &Map<String, Value>, key: &str) -> Check<f64> {
    number(level, key)?.ok_or_else(|| format!("has no {key:?}"))
}

pub(super) fn text<'a>(level: &'a Map<String, Value>, key: &str) -> Check<Option<&'a str>> {
    match level.get(key) {
        None | Some(Value::Null) => Ok(None),
        Some(Value::String(text)) => Ok(Some(text)),
        Some(value) => Err(format!("{key:?} is {}, not a text", kind(value))),
    }
}

/// A list of `N` finite numbers that must be there.
pub(super) fn numbers<const N: usize>(level: &Map<String, Value>, key: &str) -> Check<[f64; N]> {
    let value = level.get(key).ok_or_else(|| format!("has no {key:?}"))?;
    row(value).map_err(|what| format!("{key:?} {what}"))
}

/// A list of `N` finite numbers.
pub(super) fn row<const N: usize>(value: &Value) -> Check<[f64; N]> {
    let list = value.as_array().filter(|list| list.len() == N);
    let list = list.ok_or_else(|| format!("is not a list of {N} numbers"))?;
    let mut row = [0.0; N];
    for (into, value) in row.iter_mut().zip(list) {
        let number = value.as_f64().filter(|v| v.is_finite());
        *into = number.ok_or_else(|| format!("holds {}, not a number", kind(value)))?;
    }
    Ok(row)
}

/// `R` rows of `C` finite numbers that must be there; further rows are passed over.
pub(super) fn matrix<const R: usize, const C: usize>(level: &Map<String, Value>, key: &str) -> Check<[[f64; C]; R]> {
    let value = level.get(key).ok_or_else(|| format!("has no {key:?}"))?;
    let rows = value.as_array().filter(|rows| rows.len() >= R && rows.len() <= C);
    let rows = rows.ok_or_else(|| format!("{key:?} is not {R} rows of {C} numbers"))?;
    let mut matrix = [[0.0; C]; R];
    for (into, value) in matrix.iter_mut().zip(rows) {
        *into = row(value).map_err(|what| format!("a row of {key:?} {what}"))?;
    }
    Ok(matrix)
}

/// Size in pixels, which some programs write as `50.0`.
pub(super) fn whole(value: f64) -> Check<u64> {
    if value >= 0.0 && value.fract() == 0.0 {
        // The cast saturates; `check_size` refuses too large values.
        Ok(value as u64)
    } else {
        Err(format!("{value} is no image size"))
    }
}

/// JSON type of a value, for a message.
pub(super) fn kind(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "true or false",
        Value::Number(_) => "a number",
        Value::String(_) => "a text",
        Value::Array(_) => "a list",
        Value::Object(_) => "an object",
    }
}
