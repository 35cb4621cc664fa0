//! Refuses a configuration that cannot mean anything, naming the field, its value and what it may be.

use super::{Background, TrainConfig};
use crate::{Error, Result};

impl TrainConfig {
    /// Checks every field; the error names the first that is out of its range.
    pub fn validate(&self) -> Result<()> {
        at_least("iterations", self.iterations, 1)?;
        at_least("refine.every", self.refine.every, 1)?;
        at_least("init.random_count", self.init.random_count, 1)?;
        if let Some(limit) = self.max_splats {
            at_least("max_splats", limit, 1)?;
        }
        if self.sh_degree > 3 {
            return Err(bad("sh_degree", self.sh_degree, "0, 1, 2 or 3"));
        }
        self.accuracy.validate()?;
        if self.sh_degree_from.is_sorted() {
            self.validate_reals()
        } else {
            Err(bad(
                "sh_degree_from",
                format_args!("{:?}", self.sh_degree_from),
                "ascending iterations",
            ))
        }
    }

    fn validate_reals(&self) -> Result<()> {
        let (rates, adam, adc, mcmc) = (&self.rates, &self.adam, &self.adc, &self.mcmc);
        inside("lambda_dssim", self.lambda_dssim, 0.0, 1.0)?;
        for (name, rate) in [
            ("rates.mean_start", rates.mean_start),
            ("rates.mean_end", rates.mean_end),
            ("rates.quaternion", rates.quaternion),
            ("rates.log_scale", rates.log_scale),
            ("rates.opacity", rates.opacity),
            ("rates.sh_dc", rates.sh_dc),
            ("rates.sh_rest", rates.sh_rest),
            ("mip.smoothing", self.mip.smoothing),
            ("mip.margin", self.mip.margin),
            ("size_penalty", self.size_penalty),
            ("init.cull_fence", self.init.cull_fence),
            ("adc.grad_threshold", adc.grad_threshold),
            ("adc.dense_fraction", adc.dense_fraction),
            ("adc.prune_scale", adc.prune_scale),
            ("adc.prune_radius_px", adc.prune_radius_px),
            ("mcmc.noise_rate", mcmc.noise_rate),
            ("mcmc.opacity_regularization", mcmc.opacity_regularization),
            ("mcmc.scale_regularization", mcmc.scale_regularization),
        ] {
            inside(name, rate, 0.0, f32::MAX)?;
        }
        if rates.mean_start < rates.mean_end {
            return Err(bad(
                "rates.mean_start",
                rates.mean_start,
                "at least rates.mean_end",
            ));
        }
        if (rates.mean_end == 0.0) != (rates.mean_start == 0.0) {
            let wanted = "above 0, for the decay is exponential";
            return Err(bad("rates.mean_end", rates.mean_end, wanted));
        }
        // The largest f32 below 1: a decay of 1 would never forget, an opacity of 1 has no logit.
        let below_one = 1.0 - f32::EPSILON / 2.0;
        inside("adam.beta1", adam.beta1, 0.0, below_one)?;
        inside("adam.beta2", adam.beta2, 0.0, below_one)?;
        inside("adam.epsilon", adam.epsilon, f32::MIN_POSITIVE, 1.0)?;
        inside("adc.split_factor", adc.split_factor, 1.0, 100.0)?;
        inside("mcmc.growth", mcmc.growth, 1.0, 8.0)?;
        let tiny = f32::MIN_POSITIVE;
        inside("mcmc.reference_extent", mcmc.reference_extent, tiny, 1e6)?;
        inside("init.scale_factor", self.init.scale_factor, 1e-6, 1e6)?;
        inside("near_factor", self.near_factor, 1e-9, 1.0)?;
        if self.max_aspect != 0.0 {
            inside("max_aspect", self.max_aspect, 1.01, f32::MAX)?;
        }
        inside("photo_share", self.photo_share, 0.0, 1.0)?;
        for (name, opacity) in [
            ("adc.prune_opacity", adc.prune_opacity),
            ("adc.opacity_reset_value", adc.opacity_reset_value),
            ("mcmc.min_opacity", mcmc.min_opacity),
            ("init.opacity", self.init.opacity),
        ] {
            inside(name, opacity, 1e-6, below_one)?;
        }
        if let Background::Fixed(color) = self.background {
            for channel in color {
                inside("background", channel, 0.0, 1.0)?;
            }
        }
        Ok(())
    }
}

fn at_least(name: &str, value: u32, least: u32) -> Result<()> {
    if value < least {
        return Err(bad(name, value, &format!("at least {least}")));
    }
    Ok(())
}

/// NaN is in no range.
fn inside(name: &str, value: f32, least: f32, most: f32) -> Result<()> {
    if (least..=most).contains(&value) {
        return Ok(());
    }
    let wanted = match most {
        f32::MAX => format!("a number from {least}"),
        _ => format!("from {least} to {most}"),
    };
    Err(bad(name, value, &wanted))
}

fn bad(name: &str, value: impl std::fmt::Display, wanted: &str) -> Error {
    Error::Config(format!("{name} is {value}, but must be {wanted}"))
}

#[cfg(test)]
mod tests {
    use super::super::{StrategyKind, TrainConfig};

    #[test]
    fn every_length_of_run_gives_a_valid_configuration() {
        for n in [1, 2, 49, 300, 2_000, 7_000, 30_000, u32::MAX] {
            let adc = TrainConfig::for_iterations(n);
            assert!(adc.validate().is_ok(), "{n}: {:?}", adc.validate());
            let mcmc = adc.with_strategy(StrategyKind::Mcmc);
            assert!(mcmc.validate().is_ok(), "{n}: {:?}", mcmc.validate());
            assert!(mcmc.refine.until <= n);
        }
    }

    #[test]
    fn published_lengths_have_the_published_constants() {
        let adc = TrainConfig::for_iterations(30_000);
        assert_eq!(
            (adc.refine.from, adc.refine.until, adc.refine.every),
            (500, 15_000, 100)
        );
        assert_eq!(adc.sh_degree_from, [1_000, 5_000, 10_000]);
        let mcmc = adc.with_strategy(StrategyKind::Mcmc);
        assert_eq!((mcmc.refine.until, mcmc.mcmc.growth), (25_000, 1.05));
        assert_eq!((mcmc.init.opacity, mcmc.init.scale_factor), (0.5, 0.1));
        let short = TrainConfig::for_iterations(2_000).with_strategy(StrategyKind::Mcmc);
        assert_eq!(short.init.scale_factor, 1.0);
        assert!(
            (short.mcmc.growth.powi(7) - 10.0).abs() < 0.1,
            "{}",
            short.mcmc.growth
        );
    }

    #[test]
    fn an_error_names_the_field_and_its_range() {
        let message = |change: fn(&mut TrainConfig)| {
            let mut config = TrainConfig::for_iterations(100);
            change(&mut config);
            config.validate().map_err(|e| e.to_string())
        };
        let wanted = |text: &str| Err(text.to_string());
        assert_eq!(
            message(|c| c.sh_degree = 4),
            wanted("sh_degree is 4, but must be 0, 1, 2 or 3")
        );
        assert_eq!(
            message(|c| c.iterations = 0),
            wanted("iterations is 0, but must be at least 1")
        );
        assert_eq!(
            message(|c| c.rates.opacity = f32::NAN),
            wanted("rates.opacity is NaN, but must be a number from 0")
        );
        assert_eq!(
            message(|c| c.lambda_dssim = 1.5),
            wanted("lambda_dssim is 1.5, but must be from 0 to 1")
        );
        assert!(message(|c| c.init.opacity = 1.0).is_err());
        assert!(message(|c| c.adam.beta2 = 1.0).is_err());
        assert!(message(|c| c.rates.mean_end = 0.0).is_err());
    }

    #[test]
    fn json_keeps_a_configuration_and_refuses_unknown_fields() -> Result<(), serde_json::Error> {
        let config = TrainConfig::for_iterations(2_000).with_strategy(StrategyKind::Mcmc);
        let text = serde_json::to_string(&config)?;
        assert_eq!(serde_json::from_str::<TrainConfig>(&text)?, config);
        let extended = text.replacen('{', "{\"iteratoins\": 3,", 1);
        assert!(serde_json::from_str::<TrainConfig>(&extended).is_err());
        Ok(())
    }
}
