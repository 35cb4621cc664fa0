//! Constants of the count controller ([`CountController`](crate::simplify::CountController)).
//!
//! "Preference" is [`AutoConfig::preference_db`]; "round" is a comparison of the same steps with and without some
//! splats or SH coefficients.

use super::constants::constants;

constants! {
    /// Constants of a run that chooses its splat count.
    AutoConfig as "auto" {
        /// Smallest gain worth a tenth more splats, mean PSNR of held-out views in decibels.
        preference_db: f64 = 0.08, 1e-9..=100.0;
        /// Held-out views: one of so many training views.
        held_out_every: u32 = 8, 2..=1_000;
        /// Smallest number of held-out views; with fewer than twice as many and two, none is held out.
        held_out_min: u32 = 3, 1..=1_000;
        /// PSNR without visible error, decibels: no view counts as better.
        full_db: f64 = 40.0, 1.0..=200.0;

        /// Iterations of a short run: below it, learning rates of means and SH are multiplied.
        short_iterations: u32 = 15_000, 0..=u32::MAX;
        /// Factor of these learning rates.
        short_rate_factor: f32 = 2.0, 0.01..=100.0;
        /// Training views from which the factor applies to SH.
        sh_rate_views: u32 = 24, 0..=u32::MAX;

        /// End of growth, in twentieths of the run.
        growth_twentieths: u32 = 9, 1..=20;
        /// End of pruning rounds, in tenths of the run; without SH they may go on until the last fit.
        prune_tenths: u32 = 7, 1..=10;
        /// Last fit with all training views: one of so many parts of the run.
        last_fit_parts: u32 = 4, 2..=100;
        /// Round: one of so many parts of the run, within `round_steps`.
        round_parts: u32 = 20, 1..=1_000;
        /// Smallest and largest number of steps of a round.
        round_steps: [u32; 2] = [25, 500], 1..=u32::MAX;
        /// Steps between tests for convergence: one of so many parts of the run, at most `convergence_steps_max`.
        convergence_parts: u32 = 8, 1..=1_000;
        /// Largest number of steps between tests for convergence.
        convergence_steps_max: u32 = 1_000, 1..=u32::MAX;

        /// Refinements over which the gain of growth is measured.
        growth_refinements: u32 = 3, 1..=1_000;
        /// Steps of ten percent that growth counts as having added, at least.
        growth_steps_min: f64 = 0.5, 1e-3..=100.0;
        /// Maximum number of views with pixel errors that guide a refinement.
        error_views: u32 = 16, 1..=u32::MAX;

        /// Error lost by half-resolution photographs that never matters, as a share of the error at `full_db`.
        half_size_hidden: f64 = 0.5, 0.0..=1e6;
        /// Error lost by half-resolution photographs from which full resolution is due, as a share of the scene's
        /// error.
        half_size_missed: f64 = 1.0 / 12.0, 0.0..=1e6;

        /// Share of the splats that the first round removes.
        share_first: f64 = 0.5, 1e-3..=0.99;
        /// Largest share of a round.
        share_max: f64 = 0.8, 1e-3..=0.99;
        /// Smallest share of a round while no knee is known.
        share_min: f64 = 0.1, 1e-3..=0.99;
        /// Largest share after a rejected round, relative to that round's.
        share_after_rejection: f64 = 0.9, 1e-3..=1.0;
        /// Weight of the views trained on: a round must not cost them more than the preference over this weight.
        train_view_weight: f64 = 0.5, 0.0..=1e6;
        /// Distance from the knee, relative to it, at which a count is at the knee.
        knee_tolerance: f64 = 0.05, 0.0..=0.99;
        /// Uncertainty of a round's cost, in preferences, at which its control run is skipped.
        cost_precision: f64 = 0.1, 0.0..=1e6;
        /// Cost of a rejected round, in preferences, below which it still removes some splats.
        partial_cost_max: f64 = 2.0, 0.0..=1e6;
        /// Loss by merging before any step, relative to the allowed cost of a round, up to which neighbours are merged.
        merge_cost: f64 = 0.25, 0.0..=1e6;

        /// Shares of the SH coefficients that may prove enough at once, in this order; the last is degree 0 everywhere.
        sh_shares: [f64; 5] = [0.5, 0.35, 0.2, 0.1, 1.0 / 16.0], 0.0..=1.0;
        /// Loss, in preferences, up to which SH coefficients go at once.
        sh_cost_at_once: f64 = 0.25, 0.0..=1e6;
        /// Shares of the SH coefficients that rounds remove: the first, and another if that is rejected.
        sh_round_shares: [f64; 2] = [0.5, 0.25], 1e-3..=1.0;
        /// Cost of all SH, in preferences, up to which a round without any is accepted.
        sh_all_cost: f64 = 2.0, 0.0..=1e6;
        /// Loss at once, in `sh_all_cost`, above which a round without SH is not tried.
        sh_all_cost_at_once: f64 = 4.0, 0.0..=1e6;
        /// Share of the last fit that is left when SH coefficients go. Half of them cost four scenes 0.02 to 0.03 dB
        /// less of test views then than in the round; later, the rest is not fitted to the end
        /// (`2026-11-23-harmonics.csv`).
        sh_fit_left: f64 = 0.6, 0.0..=1.0;
        /// Views, at most, that reduced colours are fitted to.
        sh_fit_views: u32 = 64, 1..=u32::MAX;
    }
}

impl AutoConfig {
    /// Mean squared error at [`AutoConfig::full_db`].
    pub fn invisible_error(&self) -> f64 {
        10_f64.powf(-self.full_db / 10.0)
    }

    /// Steps of the last fit, of a run of so many iterations.
    pub fn last_fit(&self, iterations: u32) -> u32 {
        iterations / self.last_fit_parts
    }

    /// Iteration that pruning rounds end at.
    pub fn prune_until(&self, iterations: u32) -> u32 {
        iterations / 10 * self.prune_tenths
    }

    /// Iteration that growth ends at, at the latest.
    pub fn growth_until(&self, iterations: u32) -> u32 {
        iterations / 20 * self.growth_twentieths
    }

    /// Iteration from which the count is fixed, at the latest.
    pub fn settle_by(&self, iterations: u32) -> u32 {
        iterations - self.last_fit(iterations)
    }

    /// Steps of a round.
    pub fn round(&self, iterations: u32) -> u32 {
        let [least, most] = self.round_steps;
        (iterations / self.round_parts).clamp(least, most)
    }

    /// Steps between tests for convergence.
    pub fn convergence_steps(&self, iterations: u32) -> u32 {
        (iterations / self.convergence_parts).clamp(1, self.convergence_steps_max)
    }
}
