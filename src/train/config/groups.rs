//! Constants of the optimiser, of density control and of the first splats.

use super::PUBLISHED_ITERATIONS;
use super::constants::{BELOW_ONE, constants};
use crate::layout::COLOR_STEPS;

constants! {
    /// 3D smoothing filter of mip mode (Mip-Splatting, section 5.1 and its code).
    MipConfig as "mip" {
        /// Variance of the filter in squared sampling intervals of the closest view: 0.2; 0: no filter.
        smoothing: f32 = 0.2, 0.0..=f32::MAX;
        /// Border of an image, as a share of its size, within which the view still samples a splat: 0.15.
        margin: f32 = 0.15, 0.0..=f32::MAX;
    }
}

constants! {
    /// Step sizes of Adam, one per parameter group (3DGS, its code's defaults, for 30,000 iterations).
    LearningRates as "rates" {
        /// Means at the first iteration, in scene extents: 1.6e-4.
        mean_start: f32 = 1.6e-4, 0.0..=f32::MAX;
        /// Means at the last iteration, in scene extents: 1.6e-6; between them exponential.
        mean_end: f32 = 1.6e-6, 0.0..=f32::MAX;
        /// Quaternions: 1e-3.
        quaternion: f32 = 1e-3, 0.0..=f32::MAX;
        /// Log-scales: 5e-3.
        log_scale: f32 = 5e-3, 0.0..=f32::MAX;
        /// Opacity logits: 0.05 (0.025 in later versions of the 3DGS code).
        opacity: f32 = 0.05, 0.0..=f32::MAX;
        /// SH coefficient of degree 0: 2.5e-3.
        sh_dc: f32 = 2.5e-3, 0.0..=f32::MAX;
        /// Other SH coefficients: `sh_dc` / 20.
        sh_rest: f32 = 2.5e-3 / 20.0, 0.0..=f32::MAX;
        /// Share of all rates but the means' that is left at the last iteration: 1; exponential from the last
        /// refinement on.
        end_share: f32 = 1.0, 1e-6..=1.0;
    }
}

/// Exponent of the published length of a run over its own in the learning rates' factor.
const RATE_EXPONENT: f64 = 0.25;
/// Exponent of that factor's inverse in the share of the rates at the end.
const END_EXPONENT: f32 = 1.5;
/// Largest factor of the published learning rates, that of runs of 117 iterations.
const RATE_FACTOR_MAX: f64 = 4.0;

impl LearningRates {
    /// Factor of the published rates in a run of so many iterations: 1 from 30,000 on; the fourth root of the ratio of
    /// the lengths in shorter runs, which end before convergence at the published rates.
    pub fn factor(iterations: u32) -> f64 {
        let ratio = PUBLISHED_ITERATIONS as f64 / f64::from(iterations.max(1));
        ratio.powf(RATE_EXPONENT).clamp(1.0, RATE_FACTOR_MAX)
    }

    /// Rates of a run of so many iterations: the published ones times [`LearningRates::factor`], but that of opacities,
    /// which does not gain by it. At the end all but the means' fall below the published ones.
    pub fn for_iterations(iterations: u32) -> LearningRates {
        let mut rates = LearningRates::default();
        let factor = LearningRates::factor(iterations) as f32;
        rates.end_share = factor.powf(-END_EXPONENT);
        for rate in [
            &mut rates.mean_start,
            &mut rates.mean_end,
            &mut rates.quaternion,
            &mut rates.log_scale,
            &mut rates.sh_dc,
            &mut rates.sh_rest,
        ] {
            *rate *= factor;
        }
        rates
    }
}

constants! {
    /// Constants of Adam (Kingma and Ba 2014; epsilon after 3DGS).
    AdamConfig as "adam" {
        /// Decay of the first moment a step: 0.9.
        beta1: f32 = 0.9, 0.0..=BELOW_ONE;
        /// Decay of the second moment a step: 0.999.
        beta2: f32 = 0.999, 0.0..=BELOW_ONE;
        /// Summand beside the root of the second moment: 1e-15, because gradients of single splats are tiny.
        epsilon: f32 = 1e-15, f32::MIN_POSITIVE..=1.0;
        /// Iterations between updates of the harmonics, each by the gradients of all of them: 4.
        color_every: u32 = 4, 1..=COLOR_STEPS;
    }
}

constants! {
    /// Iterations that splats are added and removed at; defaults are those of 30,000 iterations.
    RefineTimes as "refine" {
        /// Last iteration before the first refinement can come: 500 of 30,000.
        from: u32 = 500, 0..=u32::MAX;
        /// First iteration without refinements: half of the run (ADC), 25,000 of 30,000 (MCMC).
        until: u32 = 15_000, 0..=u32::MAX;
        /// Iterations between refinements: 100.
        every: u32 = 100, 1..=u32::MAX;
    }
}

constants! {
    /// Adaptive density control (3DGS section 5.2 and its code).
    AdcConfig as "adc" {
        /// Mean norm of the loss gradient on a splat's screen position, per normalised device coordinate
        /// (pixel gradient × half the image size), from which it is cloned or split: 2e-4.
        grad_threshold: f32 = 2e-4, 0.0..=f32::MAX;
        /// Largest standard deviation that is cloned, in scene extents; larger splats are split: 0.01.
        dense_fraction: f32 = 0.01, 0.0..=f32::MAX;
        /// Divisor of the standard deviations of a split splat: 1.6 = 0.8 · 2 halves.
        split_factor: f32 = 1.6, 1.0..=100.0;
        /// Distance of the halves of a split splat from its mean, in standard deviations of its longest axis: 1.
        split_offset: f32 = 1.0, 0.0..=10.0;
        /// Opacity below which a splat is removed: 0.005.
        prune_opacity: f32 = 0.005, 1e-6..=BELOW_ONE;
        /// Standard deviation above which a splat is removed, in scene extents: 0.1.
        prune_scale: f32 = 0.1, 0.0..=f32::MAX;
        /// Radius on the screen since the last refinement above which a splat is removed, pixels; 0: any. 3DGS names
        /// 20, but its code forgets the radii before the test, so its results are those of 0.
        prune_radius_px: f32 = 0.0, 0.0..=f32::MAX;
        /// Iteration after which `prune_scale` and `prune_radius_px` act: 3,000, the first opacity reset.
        prune_big_from: u32 = 3_000, 0..=u32::MAX;
        /// Iterations between opacity resets while refining: 3,000; 0: none.
        opacity_reset_every: u32 = 3_000, 0..=u32::MAX;
        /// Opacity after a reset: 0.05. The published 0.01 leaves no gradient to splats of which only a rim shows:
        /// there they lie below the least alpha that is drawn.
        opacity_reset_value: f32 = 0.05, 1e-6..=BELOW_ONE;
    }
}

constants! {
    /// Markov chain Monte Carlo (MCMC and its code).
    McmcConfig as "mcmc" {
        /// Splat limit where [`TrainConfig::max_splats`](super::TrainConfig::max_splats) is not given: 1,000,000.
        default_cap: u32 = 1_000_000, 0..=u32::MAX;
        /// Noise on the means in units of their learning rate, at the reference extent: 5e5.
        noise_rate: f32 = 5e5, 0.0..=f32::MAX;
        /// Weight of the mean opacity in the loss: 0.01.
        opacity_regularization: f32 = 0.01, 0.0..=f32::MAX;
        /// Weight of the mean standard deviation in the loss, at the reference extent: 0.01.
        scale_regularization: f32 = 0.01, 0.0..=f32::MAX;
        /// Scene extent in world units for which the published noise and scale weights were chosen: 5, that of the
        /// Mip-NeRF 360 scenes. At other extents both follow the unit, so that a scene and its scaled copy train alike.
        reference_extent: f32 = 5.0, f32::MIN_POSITIVE..=1e6;
        /// Factor of the splat count at a refinement, up to the limit: 1.05, more in short runs.
        growth: f32 = 1.05, 1.0..=8.0;
        /// Opacity up to which a splat is dead and is relocated: 0.005.
        min_opacity: f32 = 0.005, 1e-6..=BELOW_ONE;
    }
}

constants! {
    /// First splats of a run.
    InitConfig as "init" {
        /// Opacity: 0.3, and 0.5 with MCMC; 3DGS has 0.1.
        opacity: f32 = 0.3, 1e-6..=BELOW_ONE;
        /// Standard deviation in mean distances to the three nearest points: 1 (3DGS), 0.1 (MCMC in runs of 15,000 or
        /// more).
        scale_factor: f32 = 1.0, 1e-6..=1e6;
        /// Least standard deviation across the plane of a point's neighbours, in that along it: 0.1; 1 makes splats
        /// round (3DGS). Above it, splats are as flat as the neighbours of their points.
        thickness: f32 = 0.1, 1e-3..=1.0;
        /// Smallest and largest standard deviation in scene extents: points in one place have no spacing, and a lone
        /// point far outside would cover every picture.
        scale_range: [f64; 2] = [1e-5, 0.1], 1e-9..=1e3;
        /// Standard deviation of a splat without a neighbour, in scene extents.
        lone_scale: f64 = 0.01, 1e-9..=1e3;
        /// Rays that look for points where the data set has none, or points placed in the cameras' frusta.
        random_count: u32 = 30_000, 1..=u32::MAX;
        /// Nearest and farthest such point, in distances from its camera to the point that the cameras look at.
        random_depths: [f64; 2] = [0.2, 2.0], 1e-6..=1e6;
        /// Positions drawn for such a point, of which the one that most cameras see is taken.
        random_candidates: u32 = 4, 1..=1_000;
        /// Depths that are compared along the ray of such a point, for the one at which the photographs agree best: 24;
        /// 0: none, and the points are grey.
        random_sweep: u32 = 24, 0..=10_000;
        /// Cameras, at most, that a position is tested with.
        random_cameras: u32 = 32, 1..=u32::MAX;
        /// Smallest number of training views that see a point; others are left out: 0, and 2 against floaters.
        cull_views: u32 = 0, 0..=u32::MAX;
        /// Distance outside the interval between the quartiles of all points, in its lengths and axis by axis, from
        /// which a point is left out: 0 for none, and 3 against floaters (Tukey's outer fence).
        cull_fence: f32 = 0.0, 0.0..=f32::MAX;
    }
}

constants! {
    /// Splats of the sky ([`sky`](crate::train::sky)).
    SkyConfig as "shell" {
        /// Places on the whole shell, of which those without points before them, and those around, are taken: 10,000,
        /// two degrees apart.
        count: u32 = 10_000, 1..=10_000_000;
        /// Radius in scene extents: 20.
        distance: f64 = 20.0, 2.0..=1e6;
        /// Angle about a place within which no point may lie, degrees: 3.
        gap_degrees: f64 = 3.0, 0.0..=45.0;
        /// Angle about a place without points within which all places are taken, degrees: 10.
        margin_degrees: f64 = 10.0, 0.0..=180.0;
    }
}

constants! {
    /// Refinement of the photographs' poses ([`poses`](crate::train::poses)).
    PoseConfig as "poses" {
        /// Share of the run before the first round: 0.1, until the splats show the scene.
        from: f32 = 0.1, 0.0..=1.0;
        /// Share of the run after which poses stay: 0.8.
        until: f32 = 0.8, 0.0..=1.0;
        /// Rounds of bundle adjustment, evenly from the first to the last: 6.
        rounds: u32 = 6, 1..=1000;
    }
}

constants! {
    /// Terms of the loss that make surfaces: docs/surfaces.md. Each is a mean over the pixels of a frame.
    GeometryConfig as "geometry" {
        /// Weight of the consistency of normals and depths, coverage · (1 − cosine): 0, for surfels 0.05 (2DGS), and
        /// more where few photographs show each place ([`for_few_views`](super::TrainConfig::for_few_views)).
        normal: f32 = 0.0, 0.0..=0.5;
        /// Share of the run before that term: 7/30 (2DGS: 7,000 of 30,000 iterations).
        normal_from: f32 = 7.0 / 30.0, 0.0..=1.0;
        /// Weight of the distortion, coverage · variance of ln z in a pixel: 0; some tenths to 4, by its strength in
        /// 2DGS (100 to 1,000 in its own unit).
        distortion: f32 = 0.0, 0.0..=40.0;
        /// Share of the run before that term: 0.1 (2DGS: 3,000 of 30,000 iterations).
        distortion_from: f32 = 0.1, 0.0..=1.0;
        /// Share of the run in which a term grows from 0 to its weight: 0.1.
        ramp: f32 = 0.1, 0.0..=1.0;
    }
}

constants! {
    /// Patches of photographs that training leaves out, see [`transients`](crate::train::transients).
    TransientConfig as "transients" {
        /// Share of the run before patches are first ignored: 0.2; at most 1,000 iterations, at least three epochs.
        from: f32 = 0.2, 0.0..=1.0;
        /// Share of a photograph's patches whose score stays below the photograph's level: 0.99.
        quantile: f32 = 0.99, 0.0..=1.0;
        /// Score from which a patch begins a region, in levels of the typical photograph: 6.
        factor: f32 = 6.0, 0.0..=1e3;
        /// The same, at least, 0 to 1: 0.03, eight levels of a photograph.
        least_score: f32 = 0.03, 0.0..=1.0;
        /// Score at which a region ends, relative to that which begins it: a third.
        edge: f32 = 1.0 / 3.0, 0.0..=1.0;
        /// Least share of a photograph that a region has: 0.002, and two patches.
        least_share: f32 = 0.002, 0.0..=1.0;
        /// Most of a photograph that is ignored: 0.4.
        most_share: f32 = 0.4, 0.0..=1.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_runs_have_larger_rates_but_that_of_opacities() {
        assert_eq!(
            [1, 117, 30_000, 100_000].map(LearningRates::factor),
            [4.0, 4.0, 1.0, 1.0]
        );
        assert!((LearningRates::factor(30_000 / 16) - 2.0).abs() < 1e-12);
        let usual = LearningRates::default();
        let twice = LearningRates::for_iterations(30_000 / 16);
        let expected = LearningRates {
            mean_start: 2.0 * usual.mean_start,
            mean_end: 2.0 * usual.mean_end,
            quaternion: 2.0 * usual.quaternion,
            log_scale: 2.0 * usual.log_scale,
            sh_dc: 2.0 * usual.sh_dc,
            sh_rest: 2.0 * usual.sh_rest,
            end_share: twice.end_share,
            ..usual
        };
        assert_eq!(twice, expected);
        assert!((twice.end_share - 0.5f32.powf(1.5)).abs() < 1e-6);
        assert_eq!(LearningRates::for_iterations(30_000), usual);
    }
}
