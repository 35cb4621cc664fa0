//! A short training of what is left: no splat comes or goes.

use crate::scene::Splats;
use crate::train::{Background, RefineTimes, TrainConfig};

/// Step sizes here, of those of a training run: its splats stand where they should, and the optimiser's first steps,
/// which are as long as the step size whatever the gradient, would move them from there.
const SHARE_OF_RATES: f32 = 0.1;

/// The constants of a re-fit of `splats` in so many iterations, before the background that they belong to.
pub fn refit_config(splats: &Splats, iterations: u32, background: [f32; 3]) -> TrainConfig {
    let mut config = TrainConfig::for_iterations(iterations);
    config.mode = splats.mode;
    config.sh_degree = splats.sh_degree;
    config.sh_degree_from = [0; 3];
    config.background = Background::Fixed(background);
    config.refine = RefineTimes {
        until: 0,
        ..config.refine
    };
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
    // Means are where a run ends: they go on as slowly as it ended.
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
