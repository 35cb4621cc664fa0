//! Constants of earlier versions: files that hold them at their defaults still load.

use super::{AutoConfig, PoseConfig, TrainConfig};
use serde_json::{Value, json};

/// Path of each retired constant, and its neutral value.
fn retired() -> [(&'static str, Value); 3] {
    [
        ("/ssim_skipped", json!(0)),
        ("/accuracy/sigma_max", Value::Null),
        ("/mcmc/error_max", json!(4.0)),
    ]
}

impl TrainConfig {
    /// Configuration saved by this version or an earlier one.
    ///
    /// # Errors
    /// A sentence that names an unknown constant, a value of the wrong type, or a retired constant that was in use.
    pub fn from_saved(mut saved: Value) -> Result<TrainConfig, String> {
        for (path, neutral) in retired() {
            let (parent, name) = path.rsplit_once('/').unwrap_or_default();
            let Some(Value::Object(fields)) = saved.pointer_mut(parent) else {
                continue;
            };
            if let Some(value) = fields.remove(name)
                && value != neutral
            {
                let name = path[1..].replace('/', ".");
                return Err(format!("{name} is {value}, and this version has no such constant"));
            }
        }
        // Constants of earlier count controllers act under a controller alone, and the state of such a one is refused;
        // those of earlier refinements of poses have no counterpart.
        let groups = [
            ("auto", json!(AutoConfig::default())),
            ("poses", json!(PoseConfig::default())),
        ];
        for (group, known) in groups {
            if let Some(Value::Object(constants)) = saved.get_mut(group) {
                constants.retain(|name, _| known.get(name).is_some());
            }
        }
        serde_json::from_value(saved).map_err(|e| e.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_screen_filter_loads_by_either_name() {
        let config = TrainConfig {
            filter: crate::scene::ScreenFilter::Mip,
            ..TrainConfig::default()
        };
        let mut saved = serde_json::to_value(&config).unwrap_or_default();
        let mode = saved.as_object_mut().and_then(|fields| fields.remove("mode"));
        assert_eq!(mode, Some(json!("mip")));
        saved["filter"] = json!("mip");
        assert_eq!(TrainConfig::from_saved(saved), Ok(config));
    }

    #[test]
    fn constants_of_earlier_controllers_and_refinements_of_poses_are_dropped() {
        let config = TrainConfig::for_iterations(100);
        let mut saved = serde_json::to_value(&config).unwrap_or_default();
        saved["auto"]["preference_db"] = json!(0.08);
        saved["poses"]["reach_px"] = json!(5.0);
        assert_eq!(TrainConfig::from_saved(saved.clone()), Ok(config));
        saved["auto"]["loss_db"] = json!("much");
        assert!(TrainConfig::from_saved(saved).is_err());
    }

    #[test]
    fn retired_constants_load_where_they_change_nothing() {
        let config = TrainConfig::for_iterations(100);
        let saved = |skipped: u32, sigma: Value| {
            let mut saved = serde_json::to_value(&config).unwrap_or_default();
            saved["ssim_skipped"] = json!(skipped);
            saved["accuracy"]["sigma_max"] = sigma;
            TrainConfig::from_saved(saved)
        };
        assert_eq!(saved(0, Value::Null), Ok(config.clone()));
        let refused = |name: &str| Err(format!("{name}, and this version has no such constant"));
        assert_eq!(saved(3, Value::Null), refused("ssim_skipped is 3"));
        assert_eq!(saved(0, json!(3.0)), refused("accuracy.sigma_max is 3.0"));
    }
}
