//! Validation of a configuration; errors name the field, its value and its range.

use super::constants::{RangedField, refused};
use super::{Background, StrategyKind, TrainConfig};
use crate::Result;
use crate::scene::Primitive;
use std::fmt::Debug;

impl TrainConfig {
    /// Checks every field; the error names the first one out of range.
    pub fn validate(&self) -> Result<()> {
        self.iterations.check("iterations", 1..=u32::MAX)?;
        if let Some(limit) = self.max_splats {
            limit.check("max_splats", 1..=u32::MAX)?;
        }
        self.sh_degree.check("sh_degree", 0..=3)?;
        ascending("sh_degree_from", &self.sh_degree_from)?;
        self.lambda_dssim.check("lambda_dssim", 0.0..=1.0)?;
        self.ssim_stride.check("ssim_stride", 1..=2)?;
        self.size_penalty.check("size_penalty", 0.0..=f32::MAX)?;
        self.regularization.check("regularization", 0.0..=1e3)?;
        self.drop_rate.check("drop_rate", 0.0..=0.9)?;
        if self.max_aspect != 0.0 {
            self.max_aspect.check("max_aspect", 1.01..=f32::MAX)?;
            if self.kind == Primitive::Surfel {
                return Err(refused("max_aspect", self.max_aspect, "0 for surfels, which are flat"));
            }
        }
        if self.sky && self.kind == Primitive::Surfel {
            return Err(refused("sky", true, "false for surfels"));
        }
        if self.sky && self.strategy == StrategyKind::Mcmc {
            return Err(refused(
                "sky",
                true,
                "false with mcmc, whose penalty of scale takes far splats for large ones",
            ));
        }
        if let Background::Fixed(color) = self.background {
            color.check("background", 0.0..=1.0)?;
        }
        self.near_factor.check("near_factor", 1e-9..=1.0)?;
        self.photo_share.check("photo_share", 0.0..=1.0)?;
        self.coarse_halvings.check("coarse_halvings", 1..=8)?;
        self.coarse_dilation.check("coarse_dilation", 0.0..=1e3)?;
        self.accuracy.validate()?;
        self.mip.check()?;
        self.rates.check()?;
        self.adam.check()?;
        self.refine.check()?;
        self.adc.check()?;
        self.mcmc.check()?;
        self.init.check()?;
        self.auto.check()?;
        self.poses.check()?;
        self.geometry.check()?;
        self.transients.check()?;
        self.shell.check()?;
        ascending("init.scale_range", &self.init.scale_range)?;
        ascending("init.random_depths", &self.init.random_depths)?;
        self.check_mean_rates()
    }

    fn check_mean_rates(&self) -> Result<()> {
        let rates = &self.rates;
        if rates.mean_start < rates.mean_end {
            let wanted = "at least rates.mean_end";
            return Err(refused("rates.mean_start", rates.mean_start, wanted));
        }
        if (rates.mean_end == 0.0) != (rates.mean_start == 0.0) {
            let wanted = "above 0, for the decay is exponential";
            return Err(refused("rates.mean_end", rates.mean_end, wanted));
        }
        Ok(())
    }
}

fn ascending<T: PartialOrd + Debug>(name: &str, values: &[T]) -> Result<()> {
    match values.is_sorted() {
        true => Ok(()),
        false => Err(refused(name, format_args!("{values:?}"), "ascending")),
    }
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
        assert!((short.mcmc.growth.powi(7) - 10.0).abs() < 0.1, "{}", short.mcmc.growth);
    }

    #[test]
    fn an_error_names_the_field_and_its_range() {
        type Change = fn(&mut TrainConfig);
        let message = |change: Change| {
            let mut config = TrainConfig::for_iterations(100);
            change(&mut config);
            config.validate().map_err(|e| e.to_string())
        };
        let refused: [(Change, &str); 5] = [
            (|c| c.sh_degree = 4, "sh_degree is 4, but must be from 0 to 3"),
            (|c| c.iterations = 0, "iterations is 0, but must be at least 1"),
            (
                |c| c.rates.opacity = f32::NAN,
                "rates.opacity is NaN, but must be at least 0",
            ),
            (|c| c.lambda_dssim = 1.5, "lambda_dssim is 1.5, but must be from 0 to 1"),
            (
                |c| c.init.scale_range = [0.5, 0.25],
                "init.scale_range is [0.5, 0.25], but must be ascending",
            ),
        ];
        for (change, wanted) in refused {
            assert_eq!(message(change), Err(wanted.to_string()));
        }
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
