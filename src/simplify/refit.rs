//! Refit: a short training with a fixed set of splats.

use crate::scene::Splats;
use crate::train::config::LearningRates;
use crate::train::{Background, RefineTimes, TrainConfig};

/// Learning rates relative to those of a training run: the splats are in place, and Adam's first steps, as long as the
/// learning rate at any gradient, would move them away.
const SHARE_OF_RATES: f32 = 0.1;

/// Training configuration of a refit of `splats`, for the background that they were trained with.
pub fn refit_config(splats: &Splats, iterations: u32, background: [f32; 3]) -> TrainConfig {
    let mut config = TrainConfig::for_iterations(iterations).with_kind(splats.primitive);
    config.filter = splats.filter;
    config.sh_degree = splats.sh_degree;
    config.sh_degree_from = [0; 3];
    config.background = Background::Fixed(background);
    config.refine = RefineTimes {
        until: 0,
        ..config.refine
    };
    config.rates = LearningRates::default();
    let rates = &mut config.rates;
    for rate in [
        &mut rates.quaternion,
        &mut rates.log_scale,
        &mut rates.opacity,
        &mut rates.sh_dc,
        &mut rates.sh_rest,
    ] {
        *rate *= SHARE_OF_RATES;
    }
    // Means start at the rate at which a run ends.
    rates.mean_start = rates.mean_end;
    config
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::schedule::{is_refine, is_reset};

    #[test]
    fn no_splat_comes_or_goes_and_all_harmonics_are_trained() {
        let splats = Splats {
            sh_degree: 2,
            ..Splats::default()
        };
        for iterations in [1, 100, 30_000] {
            let config = refit_config(&splats, iterations, [1.0; 3]);
            assert!(config.validate().is_ok());
            let touched = |i: &u32| is_refine(&config, *i) || is_reset(&config, *i);
            assert_eq!((0..=iterations).find(touched), None);
            assert_eq!(crate::train::schedule::sh_degree(&config, 1), 2);
        }
    }
}
