//! Lookup of a frame's keys, with the root's as fallback.

use super::super::check::Check;
use super::super::json::{number, text};
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
