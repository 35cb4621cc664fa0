//! Schedules of training as pure functions of configuration and iteration, without state, so that a resumed run cannot
//! be out of step.
//!
//! Iterations count from 1 to `config.iterations`, as in the 3DGS code.

use super::config::{Background, ExposureModel, StrategyKind, TrainConfig};
use super::rng::{self, Stream};

/// Iterations after an opacity reset whose pictures tell nothing of poses and transients.
const RESET_REST: u32 = 300;

/// Epochs before patches are first ignored.
const TRANSIENT_EPOCHS: usize = 3;

/// Iterations after which they are, in a run of any length: splats learn what stays.
const TRANSIENT_FROM_MOST: f64 = 1_000.0;

/// Learning rate of the means at an iteration, world units; `extent` is the scene extent in world units.
pub fn mean_rate(config: &TrainConfig, extent: f64, iteration: u32) -> f32 {
    let (start, end) = (f64::from(config.rates.mean_start), f64::from(config.rates.mean_end));
    if start <= 0.0 {
        return 0.0;
    }
    let last_interval = config.iterations.saturating_sub(1).max(1);
    let progress = f64::from(iteration.saturating_sub(1)) / f64::from(last_interval);
    (start * (end / start).powf(progress.min(1.0)) * extent) as f32
}

/// Share of the learning rates of all but the means at an iteration.
pub fn rate_share(config: &TrainConfig, iteration: u32) -> f32 {
    let until = config.refine.until.min(config.iterations);
    let progress = f64::from(iteration.saturating_sub(until)) / f64::from((config.iterations - until).max(1));
    f64::from(config.rates.end_share).powf(progress.min(1.0)) as f32
}

/// Adam's bias corrections 1 / (1 − β₁ᵗ) and 1 / (1 − β₂ᵗ) at an iteration, in `f64` because the second loses all
/// digits in `f32` at the first iterations.
pub fn bias_corrections(config: &TrainConfig, iteration: u32) -> [f32; 2] {
    [config.adam.beta1, config.adam.beta2].map(|beta| {
        let remaining = f64::from(beta).powf(f64::from(iteration.max(1)));
        (1.0 / (1.0 - remaining)) as f32
    })
}

/// SH degree trained and drawn at an iteration.
pub fn sh_degree(config: &TrainConfig, iteration: u32) -> u32 {
    let reached = config.sh_degree_from.iter().filter(|&&from| iteration >= from);
    (reached.count() as u32).min(config.sh_degree)
}

/// Whether splats are added and removed after an iteration's update.
pub fn is_refine(config: &TrainConfig, iteration: u32) -> bool {
    let times = &config.refine;
    iteration > times.from && iteration < times.until && iteration.is_multiple_of(times.every)
}

/// Whether opacities are lowered after an iteration's update (and after its refinement, if any).
pub fn is_reset(config: &TrainConfig, iteration: u32) -> bool {
    let every = config.adc.opacity_reset_every;
    config.strategy == StrategyKind::Adc
        && every > 0
        && iteration > 0
        && iteration < config.refine.until
        && iteration.is_multiple_of(every)
}

/// Whether the harmonics are updated at an iteration: every few iterations, before changes of the splats or of their SH
/// degree, and at the end.
pub fn is_color_step(config: &TrainConfig, iteration: u32) -> bool {
    iteration.is_multiple_of(config.adam.color_every)
        || iteration >= config.iterations
        || is_refine(config, iteration)
        || is_reset(config, iteration)
        || sh_degree(config, iteration) != sh_degree(config, iteration + 1)
}

/// First of the iterations up to this one whose gradients of colours wait for the next update of the harmonics; none up
/// to `last_updated` does.
pub fn first_color_step(config: &TrainConfig, last_updated: u32, iteration: u32) -> u32 {
    let mut first = iteration;
    while first > last_updated + 1 && !is_color_step(config, first - 1) {
        first -= 1;
    }
    first
}

/// First moments by which the harmonics lie ahead of their place after an update at an iteration: the mean, over the
/// iterations until the next update, of what their momentum adds by then. 0 at the end of the run.
pub fn look_ahead(config: &TrainConfig, iteration: u32) -> f32 {
    if iteration >= config.iterations {
        return 0.0;
    }
    let beta1 = f64::from(config.adam.beta1);
    let added = |steps: u32| (1..=steps).map(|step| beta1.powi(step as i32)).sum::<f64>();
    let every = config.adam.color_every;
    ((0..every).map(added).sum::<f64>() / f64::from(every)) as f32
}

/// Index of the training view of an iteration, of `view_count`: each once an epoch, in an order that is a function of
/// (seed, epoch).
///
/// Panics if there are no views.
pub fn view(config: &TrainConfig, view_count: usize, iteration: u32) -> usize {
    assert!(view_count > 0, "a training step needs a view");
    let ordinal = iteration.saturating_sub(1) as usize;
    view_order(config.seed, view_count, (ordinal / view_count) as u32)[ordinal % view_count]
}

/// Halvings of the photographs' width and height in the step after so many iterations.
pub fn halvings(config: &TrainConfig, iterations: u32) -> u32 {
    if iterations >= config.coarse_until {
        return 0;
    }
    let most = u64::from(config.coarse_halvings);
    (most - u64::from(iterations) * most / u64::from(config.coarse_until)) as u32
}

/// Distance of SSIM's windows, pixels; without SSIM pixels are compared one by one.
pub fn window_stride(config: &TrainConfig) -> u32 {
    if config.lambda_dssim > 0.0 {
        config.ssim_stride
    } else {
        1
    }
}

/// Offset of the lattice of SSIM's windows at an iteration, pixels: in as many epochs as there are offsets, a view has
/// each once.
pub fn window_offset(config: &TrainConfig, view_count: usize, iteration: u32) -> [u32; 2] {
    let stride = window_stride(config);
    let epoch = (iteration.saturating_sub(1) as usize / view_count) as u32;
    let index = view(config, view_count, iteration) as u32;
    let first = rng::bits(config.seed, 0, index, Stream::Window)[0];
    // Diagonal neighbours first: together they cover the image evenly.
    let turn = first.wrapping_add(epoch) % (stride * stride);
    [(turn + turn / stride) % stride, turn % stride]
}

/// Permutation of the training views in an epoch (Fisher–Yates).
pub fn view_order(seed: u64, view_count: usize, epoch: u32) -> Vec<usize> {
    let mut order: Vec<usize> = (0..view_count).collect();
    for i in (1..view_count).rev() {
        let words = rng::bits(seed, epoch, i as u32, Stream::ViewOrder);
        order.swap(i, rng::below(words, i as u64 + 1) as usize);
    }
    order
}

/// Whether gains of the photographs are updated after an iteration: at the end of each epoch but those of the last
/// tenth.
pub fn is_exposure(config: &TrainConfig, view_count: usize, iteration: u32) -> bool {
    let is_early = u64::from(iteration) * 10 <= u64::from(config.iterations) * 9;
    config.exposure != ExposureModel::Off && is_early && (iteration as usize).is_multiple_of(view_count)
}

/// Whether poses are adjusted after an iteration: evenly over their part of the run. Opacity resets leave pictures that
/// tell nothing of poses: 300 iterations after each have no round.
pub fn is_pose_round(config: &TrainConfig, iteration: u32) -> bool {
    let poses = &config.poses;
    let [from, until] = [poses.from, poses.until].map(|share| f64::from(share) * f64::from(config.iterations));
    let every = (until - from) / f64::from(poses.rounds.max(2) - 1);
    let round = |k: u32| (from + every * f64::from(k)).round().max(1.0) as u32;
    let is_due = (0..poses.rounds).any(|k| round(k) == iteration);
    config.refine_poses && is_due && !was_reset(config, iteration)
}

/// Weights of the terms of geometry at an iteration: consistency of normals, and distortion. Each grows linearly from 0
/// at its start.
pub fn geometry(config: &TrainConfig, iteration: u32) -> [f32; 2] {
    let terms = &config.geometry;
    let progress = f64::from(iteration) / f64::from(config.iterations);
    [
        (terms.normal, terms.normal_from),
        (terms.distortion, terms.distortion_from),
    ]
    .map(|(weight, from)| {
        let past = progress - f64::from(from);
        match past > 0.0 {
            true => (f64::from(weight) * (past / f64::from(terms.ramp)).min(1.0)) as f32,
            false => 0.0,
        }
    })
}

fn was_reset(config: &TrainConfig, iteration: u32) -> bool {
    (iteration.saturating_sub(RESET_REST)..iteration).any(|i| is_reset(config, i))
}

/// Whether residuals of an iteration's photograph count as a visit: not soon after an opacity reset.
pub fn is_transient_visit(config: &TrainConfig, iteration: u32) -> bool {
    config.ignore_transients && !was_reset(config, iteration)
}

/// Whether the ignored patches are found anew after an iteration: at the end of each epoch from the third on, once
/// their share of the run, or 1,000 iterations, have passed.
pub fn is_transient_update(config: &TrainConfig, view_count: usize, iteration: u32) -> bool {
    let from = f64::from(config.transients.from) * f64::from(config.iterations);
    let is_end = (iteration as usize).is_multiple_of(view_count);
    let is_late =
        f64::from(iteration) >= from.min(TRANSIENT_FROM_MOST) && iteration as usize >= TRANSIENT_EPOCHS * view_count;
    is_end && is_late && is_transient_visit(config, iteration)
}

/// Background colour of an iteration.
pub fn background(config: &TrainConfig, iteration: u32) -> [f32; 3] {
    match config.background {
        Background::Fixed(color) => color,
        Background::Random => {
            let [r, g, b, _] = rng::uniform(config.seed, iteration, 0, Stream::Background);
            [r, g, b]
        }
    }
}

/// Share of the splats dropped at an iteration, times 2³², and the key of its random numbers.
pub fn dropout(config: &TrainConfig, iteration: u32) -> [u32; 2] {
    let progress = f64::from(iteration) / f64::from(config.iterations);
    let share = f64::from(config.drop_rate) * progress.min(1.0);
    let [key, ..] = rng::bits(config.seed, iteration, 0, Stream::Dropout);
    [(share * 2_f64.powi(32)) as u32, key]
}

/// Factor of Σ ξ w(opacity) that MCMC adds to a mean at an iteration, ξ standard normal, in 1 / world units; 0 with
/// other strategies.
///
/// The published factor is `noise_rate` times the means' rate, which grows with the third power of the
/// world's unit (Σ with its square); dividing by the square of the extent makes it a length again.
pub fn noise_scale(config: &TrainConfig, extent: f64, iteration: u32) -> f32 {
    if config.strategy != StrategyKind::Mcmc {
        return 0.0;
    }
    let unit = f64::from(config.mcmc.reference_extent) / extent;
    let rate = f64::from(mean_rate(config, extent, iteration));
    (f64::from(config.mcmc.noise_rate) * rate * unit * unit) as f32
}

/// Weights of the penalties that the loss adds to the photographs' error, per world unit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Penalties {
    /// Weight of the mean opacity.
    pub opacity: f32,
    /// Weight of the mean standard deviation.
    pub scale: f32,
    /// Weight of the sum of the squared standard deviations.
    pub size: f32,
}

/// Penalties of a run.
pub fn penalties(config: &TrainConfig, extent: f64) -> Penalties {
    let size = (f64::from(config.size_penalty) / (extent * extent)) as f32;
    let weight = match config.strategy {
        StrategyKind::Mcmc => 1.0,
        StrategyKind::Adc => config.regularization,
    };
    let unit = f64::from(config.mcmc.reference_extent) / extent;
    let scale = f64::from(weight * config.mcmc.scale_regularization) * unit;
    Penalties {
        opacity: weight * config.mcmc.opacity_regularization,
        scale: scale as f32,
        size,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::config::LearningRates;

    #[test]
    fn the_mean_rate_decays_exponentially_from_start_to_end() {
        let config = TrainConfig {
            rates: LearningRates::default(),
            ..TrainConfig::for_iterations(1_001)
        };
        let at = |i| f64::from(mean_rate(&config, 2.0, i));
        assert!((at(1) / 3.2e-4 - 1.0).abs() < 1e-6);
        assert!((at(1_001) / 3.2e-6 - 1.0).abs() < 1e-6);
        assert!((at(501) / 3.2e-5 - 1.0).abs() < 1e-6);
        assert_eq!(at(5_000), at(1_001));
        assert!(mean_rate(&TrainConfig::for_iterations(1), 1.0, 1).is_finite());
    }

    #[test]
    fn rounds_of_poses_are_even_and_none_follows_a_reset() {
        let mut config = TrainConfig::for_iterations(1_000);
        let rounds = |config: &TrainConfig| -> Vec<u32> { (1..=1_000).filter(|&i| is_pose_round(config, i)).collect() };
        assert!(rounds(&config).is_empty());
        config.refine_poses = true;
        assert_eq!(rounds(&config), [100, 240, 380, 520, 660, 800]);
        config.adc.opacity_reset_every = 370;
        assert!(is_reset(&config, 370) && is_reset(&config, 740));
        assert_eq!(rounds(&config), [100, 240]);
        config.poses.rounds = 1;
        assert_eq!(rounds(&config), [100]);
    }

    #[test]
    fn the_other_rates_fall_exponentially_from_the_last_refinement_on() {
        let mut config = TrainConfig::for_iterations(1_000);
        config.rates.end_share = 0.25;
        config.refine.until = 600;
        assert_eq!(
            [1, 600, 800, 1_000, 2_000].map(|i| rate_share(&config, i)),
            [1.0, 1.0, 0.5, 0.25, 0.25]
        );
        config.refine.until = 5_000;
        assert_eq!(rate_share(&config, 1_000), 1.0);
        config.rates.end_share = 1.0;
        config.refine.until = 0;
        assert_eq!(rate_share(&config, 500), 1.0);
    }

    #[test]
    fn the_first_bias_correction_undoes_the_first_decay() {
        let [first, second] = bias_corrections(&TrainConfig::default(), 1);
        assert!((first - 10.0).abs() < 1e-4 && (second - 1000.0).abs() < 0.1);
        let late = bias_corrections(&TrainConfig::default(), 1_000_000);
        assert_eq!(late, [1.0, 1.0]);
    }

    #[test]
    fn halvings_are_taken_back_after_equal_parts() {
        let mut config = TrainConfig::for_iterations(1_000);
        assert_eq!(halvings(&config, 0), 0);
        config.coarse_until = 500;
        assert_eq!([0, 499, 500].map(|i| halvings(&config, i)), [1, 1, 0]);
        config.coarse_halvings = 2;
        assert_eq!([0, 249, 250, 499, 500].map(|i| halvings(&config, i)), [2, 2, 1, 1, 0]);
        config.coarse_halvings = 3;
        assert_eq!([166, 167, 333, 334].map(|i| halvings(&config, i)), [3, 2, 2, 1]);
    }

    #[test]
    fn a_view_has_each_offset_of_the_lattice_once_in_four_epochs() {
        let mut config = TrainConfig::for_iterations(100);
        let mut offsets = vec![Vec::new(); 5];
        for iteration in 1..=20 {
            offsets[view(&config, 5, iteration)].push(window_offset(&config, 5, iteration));
        }
        for offsets in &mut offsets {
            offsets.sort_unstable();
            assert_eq!(offsets[..], [[0, 0], [0, 1], [1, 0], [1, 1]]);
        }
        config.lambda_dssim = 0.0;
        assert_eq!(window_offset(&config, 5, 7), [0, 0]);
    }

    #[test]
    fn degrees_rise_on_time_and_stop_at_the_highest() {
        let mut config = TrainConfig::for_iterations(30_000);
        let degrees = [999, 1_000, 5_000, 10_000].map(|i| sh_degree(&config, i));
        assert_eq!(degrees, [0, 1, 2, 3]);
        config.sh_degree = 1;
        assert_eq!(sh_degree(&config, 20_000), 1);
    }

    #[test]
    fn refinement_and_resets_keep_to_the_published_times() {
        let config = TrainConfig::for_iterations(30_000);
        assert!(!is_refine(&config, 500) && is_refine(&config, 600) && !is_refine(&config, 650));
        assert!(is_refine(&config, 14_900) && !is_refine(&config, 15_000));
        let resets: Vec<u32> = (0..=30_000).filter(|&i| is_reset(&config, i)).collect();
        assert_eq!(resets, [3_000, 6_000, 9_000, 12_000]);
        let mcmc = config.with_strategy(StrategyKind::Mcmc);
        assert!((0..=30_000).all(|i| !is_reset(&mcmc, i)));
        assert!(is_refine(&mcmc, 24_900) && !is_refine(&mcmc, 25_000));
    }

    #[test]
    fn terms_of_geometry_grow_after_their_start() {
        let mut config = TrainConfig::for_iterations(1_000);
        assert_eq!(geometry(&config, 900), [0.0; 2]);
        config.geometry.normal = 0.05;
        config.geometry.distortion = 2.0;
        assert_eq!(geometry(&config, 100), [0.0; 2]);
        assert_eq!(geometry(&config, 150)[0], 0.0);
        assert!((geometry(&config, 150)[1] - 1.0).abs() < 1e-6);
        let [normal, distortion] = geometry(&config, 283);
        assert!((normal / 0.05 - 0.4967).abs() < 1e-3 && distortion == 2.0);
        assert_eq!(geometry(&config, 1_000), [0.05, 2.0]);
        config.geometry.ramp = 0.0;
        assert_eq!(geometry(&config, 234), [0.05, 2.0]);
    }

    #[test]
    fn every_epoch_visits_each_view_once_in_its_own_order() {
        let config = TrainConfig::for_iterations(1_000);
        let epoch = |e: u32| -> Vec<usize> { (1..=43).map(|i| view(&config, 43, e * 43 + i)).collect() };
        let mut sorted = epoch(3);
        assert_eq!(sorted, view_order(config.seed, 43, 3));
        assert_ne!(sorted, epoch(4));
        sorted.sort_unstable();
        assert_eq!(sorted, (0..43).collect::<Vec<_>>());
        assert_eq!(view(&config, 1, 77), 0);
    }

    #[test]
    fn a_random_background_changes_each_step_and_repeats_with_the_seed() {
        let mut config = TrainConfig::for_iterations(10);
        assert_eq!(background(&config, 1), [0.0; 3]);
        config.background = Background::Random;
        assert_ne!(background(&config, 1), background(&config, 2));
        assert_eq!(background(&config, 2), background(&config, 2));
    }

    #[test]
    fn noise_follows_the_world_unit() {
        let config = TrainConfig::for_iterations(100).with_strategy(StrategyKind::Mcmc);
        let published = f64::from(noise_scale(&config, 5.0, 1));
        let rate = f64::from(config.rates.mean_start);
        assert!((published / (5e5 * rate * 5.0) - 1.0).abs() < 1e-5);
        // A mean moves by scale × Σ: Σ grows fourfold with a doubled unit, the move must double.
        let doubled = f64::from(noise_scale(&config, 10.0, 1));
        assert!((doubled * 4.0 / published - 2.0).abs() < 1e-5);
    }

    #[test]
    fn dropout_grows_with_the_run_and_differs_by_step_and_seed() {
        let config = TrainConfig {
            drop_rate: 0.5,
            ..TrainConfig::for_iterations(100)
        };
        assert_eq!(dropout(&config, 0)[0], 0);
        assert_eq!(
            [50, 100, 200].map(|i| dropout(&config, i)[0]),
            [1 << 30, 1 << 31, 1 << 31]
        );
        let other = TrainConfig {
            seed: 1,
            ..config.clone()
        };
        let keys = [dropout(&config, 7)[1], dropout(&config, 8)[1], dropout(&other, 7)[1]];
        assert!(keys[0] != keys[1] && keys[0] != keys[2]);
        assert_eq!(dropout(&TrainConfig::for_iterations(100), 100)[0], 0);
    }

    #[test]
    fn penalties_of_density_control_are_those_of_mcmc_by_weight() {
        let usual = TrainConfig::for_iterations(100);
        assert_eq!(penalties(&usual, 2.0), Penalties::default());
        let mcmc = penalties(&usual.clone().with_strategy(StrategyKind::Mcmc), 2.0);
        assert!(mcmc.opacity > 0.0 && mcmc.scale > 0.0);
        let of = |regularization| TrainConfig {
            regularization,
            ..usual.clone()
        };
        assert_eq!(penalties(&of(1.0), 2.0), mcmc);
        let half = penalties(&of(0.5), 2.0);
        assert_eq!([half.opacity, half.scale], [0.5 * mcmc.opacity, 0.5 * mcmc.scale]);
    }
}
