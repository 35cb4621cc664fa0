//! Settings of constants at other values.

use crate::train::TrainConfig;

/// Settings of a numeric constant at half and at twice its value, as far as these are in its range; of NAME=VALUE this
/// setting alone.
///
/// # Errors
/// A sentence on an unknown name, a constant that is no number, or a value that is not valid.
pub fn variations(config: &TrainConfig, name: &str) -> Result<Vec<String>, String> {
    let with = |setting: &String| config.clone().with_settings(std::slice::from_ref(setting));
    if name.contains('=') {
        let given = name.to_owned();
        with(&given)?.validate().map_err(|e| e.to_string())?;
        return Ok(vec![given]);
    }
    let value = config.constant(name)?;
    let number = value.as_f64().ok_or_else(|| format!("{name} is no number"))?;
    let setting = |factor: f64| match value.is_f64() {
        true => format!("{name}={}", factor * number),
        false => format!("{name}={}", (factor * number).round()),
    };
    let is_valid = |setting: &String| with(setting).is_ok_and(|other| other != *config && other.validate().is_ok());
    Ok([0.5, 2.0].map(setting).into_iter().filter(is_valid).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constants_vary_within_their_ranges() {
        let config = TrainConfig::for_iterations(2_000);
        let of = |name| variations(&config, name);
        assert_eq!(
            of("auto.round_share"),
            Ok(vec!["auto.round_share=0.025".into(), "auto.round_share=0.1".into()])
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
        assert_eq!(of("auto.growth_share"), Ok(vec!["auto.growth_share=0.275".into()]));
        assert_eq!(of("adam.beta1").map(|found| found.len()), Ok(1));
        assert_eq!(of("drop_rate"), Ok(Vec::new()));
        assert!(of("auto.growth").is_err_and(|why| why.contains("there are few_views, full_db,")));
        assert!(of("strategy").is_err());
        assert_eq!(of("drop_rate=0.1"), Ok(vec!["drop_rate=0.1".into()]));
        assert!(of("drop_rate=2").is_err());
    }
}
