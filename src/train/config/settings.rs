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
            // Text that is not JSON is a string, so that words need no quotes.
            let text = text.trim();
            *place = serde_json::from_str(text).unwrap_or_else(|_| Value::String(text.into()));
            config = serde_json::from_value(tree.clone()).map_err(|e| refuse(e.to_string()))?;
        }
        Ok(config)
    }

    /// Settings of a numeric constant at half and at twice its value, as far as these are in its range; of NAME=VALUE
    /// this setting alone.
    ///
    /// # Errors
    /// A sentence on an unknown name, a constant that is no number, or a value that is not valid.
    pub fn variations(&self, name: &str) -> Result<Vec<String>, String> {
        if name.contains('=') {
            let given = [name.to_owned()];
            let config = self.clone().with_settings(&given)?;
            config.validate().map_err(|e| e.to_string())?;
            return Ok(given.to_vec());
        }
        let tree = serde_json::to_value(self).map_err(|e| e.to_string())?;
        let value = tree.pointer(&pointer(name)).ok_or_else(|| unknown(&tree, name))?;
        let number = value.as_f64().ok_or_else(|| format!("{name} is no number"))?;
        let setting = |factor: f64| match value.is_f64() {
            true => format!("{name}={}", factor * number),
            false => format!("{name}={}", (factor * number).round()),
        };
        let is_valid = |setting: &String| {
            let config = self.clone().with_settings(std::slice::from_ref(setting));
            config.is_ok_and(|config| config != *self && config.validate().is_ok())
        };
        Ok([0.5, 2.0].map(setting).into_iter().filter(is_valid).collect())
    }
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
    fn constants_vary_within_their_ranges() {
        let config = TrainConfig::for_iterations(2_000);
        let of = |name| config.variations(name);
        assert_eq!(
            of("auto.growth_share"),
            Ok(vec!["auto.growth_share=0.225".into(), "auto.growth_share=0.9".into()])
        );
        assert_eq!(
            of("refine.every"),
            Ok(vec!["refine.every=50".into(), "refine.every=200".into()])
        );
        assert_eq!(
            of("lambda_dssim"),
            Ok(vec![
                "lambda_dssim=0.10000000149011612".into(),
                "lambda_dssim=0.4000000059604645".into()
            ])
        );
        // Beyond its range, and without another value.
        assert_eq!(
            of("auto.last_fit_share"),
            Ok(vec![
                "auto.last_fit_share=0.125".into(),
                "auto.last_fit_share=0.5".into()
            ])
        );
        assert_eq!(of("adam.beta1").map(|found| found.len()), Ok(1));
        assert_eq!(of("drop_rate"), Ok(Vec::new()));
        assert!(of("auto.growth").is_err_and(|why| why.contains("there are few_views, full_db,")));
        assert!(of("strategy").is_err());
        assert_eq!(of("drop_rate=0.1"), Ok(vec!["drop_rate=0.1".into()]));
        assert!(of("drop_rate=2").is_err());
    }
}
