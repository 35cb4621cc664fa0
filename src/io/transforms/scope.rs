//! Lookup of a frame's keys, with the root's as fallback.

use super::super::check::Check;
use serde_json::{Map, Value};

/// The two levels of a key.
pub(super) struct Scope<'a> {
    pub(super) frame: &'a Map<String, Value>,
    pub(super) root: &'a Map<String, Value>,
}

impl<'a> Scope<'a> {
    pub(super) fn value(&self, key: &str) -> Option<&'a Value> {
        self.frame.get(key).or_else(|| self.root.get(key))
    }

    /// A number, from the frame or else from the root.
    pub(super) fn number(&self, key: &str) -> Check<Option<f64>> {
        match number(self.frame, key)? {
            Some(value) => Ok(Some(value)),
            None => number(self.root, key),
        }
    }

    /// A text of the frame alone.
    pub(super) fn text_of_frame(&self, key: &str) -> Check<Option<&'a str>> {
        text(self.frame, key)
    }

    /// A text, from the frame or else from the root.
    pub(super) fn text(&self, key: &str) -> Check<Option<&'a str>> {
        match text(self.frame, key)? {
            Some(value) => Ok(Some(value)),
            None => text(self.root, key),
        }
    }
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

pub(super) fn text<'a>(level: &'a Map<String, Value>, key: &str) -> Check<Option<&'a str>> {
    match level.get(key) {
        None | Some(Value::Null) => Ok(None),
        Some(Value::String(text)) => Ok(Some(text)),
        Some(value) => Err(format!("{key:?} is {}, not a text", kind(value))),
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
