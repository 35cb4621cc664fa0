//! Settings of constants by name.

use super::TrainConfig;
use serde_json::Value;

impl TrainConfig {
    /// The configuration with `NAME=VALUE` settings: a path into its JSON such as `adc.grad_threshold`, and a value as
    /// JSON or as a word. Ranges are not checked, see [`TrainConfig::validate`].
    ///
    /// # Errors
    /// The setting, and a sentence on an unknown name or a value of another type.
    pub fn with_settings(self, settings: &[String]) -> Result<TrainConfig, String> {
        let mut tree = serde_json::to_value(&self).map_err(|e| e.to_string())?;
        let mut config = self;
        for setting in settings {
            let refuse = |why: String| format!("{setting}: {why}");
            let Some((name, text)) = setting.split_once('=') else {
                return Err(refuse("NAME=VALUE is expected".into()));
            };
            let Some(place) = tree.pointer_mut(&pointer(name)) else {
                return Err(refuse(unknown(&tree, name)));
            };
            *place = value(text.trim());
            config = serde_json::from_value(tree.clone()).map_err(|e| refuse(e.to_string()))?;
        }
        Ok(config)
    }

    /// Value of a constant by its name.
    ///
    /// # Errors
    /// A sentence on an unknown name.
    pub fn constant(&self, name: &str) -> Result<Value, String> {
        let tree = serde_json::to_value(self).map_err(|e| e.to_string())?;
        let value = tree.pointer(&pointer(name)).cloned();
        value.ok_or_else(|| unknown(&tree, name))
    }
}

/// Text as JSON; else as a number such as `.5`; else as a string, so that words need no quotes.
fn value(text: &str) -> Value {
    let number = || text.parse().ok().filter(|number: &f64| number.is_finite());
    let parsed = serde_json::from_str(text).ok();
    parsed
        .or_else(|| number().map(Value::from))
        .unwrap_or_else(|| text.into())
}

/// JSON pointer of a dotted name.
fn pointer(name: &str) -> String {
    format!("/{}", name.trim().replace('.', "/"))
}

/// Error text with the valid names at the deepest level that `name` reaches.
fn unknown(tree: &Value, name: &str) -> String {
    let mut level = tree;
    let mut reached = Vec::new();
    for part in name.trim().split('.') {
        match level.get(part) {
            Some(inner) if inner.is_object() => level = inner,
            _ => break,
        }
        reached.push(part);
    }
    let names: Vec<&str> = level
        .as_object()
        .into_iter()
        .flatten()
        .map(|(n, _)| n.as_str())
        .collect();
    let place = match reached.is_empty() {
        true => String::new(),
        false => format!(" in {}", reached.join(".")),
    };
    format!("there is no such constant{place}; there are {}", names.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_json_numbers_or_words() {
        let config = TrainConfig::for_iterations(100);
        let with = |setting: &str| config.clone().with_settings(&[setting.into()]);
        for number in ["0.005", ".005", "5e-3", " 0.0050"] {
            assert_eq!(with(&format!("rates.opacity={number}")).unwrap().rates.opacity, 0.005);
        }
        assert!(with("strategy=mcmc").is_ok() && with("adam.color_every=4").is_ok());
        for wrong in ["rates.opacity=inf", "rates.opacity=fast", "adam.color_every=.5"] {
            let message = with(wrong).unwrap_err();
            assert!(message.starts_with(wrong), "{message}");
        }
    }
}
