//! Constants of the count controller ([`CountController`](crate::simplify::CountController)).
//!
//! A "round" is a comparison of the same steps with and without some splats.

use super::constants::constants;

constants! {
    /// Constants of a run that chooses its splat count.
    AutoConfig as "auto" {
        /// PSNR that held-out views may lose in total against the best scene since the end of growth, decibels.
        loss_db: f64 = 0.1, 1e-9..=100.0;
        /// SSIM that counts as much as a decibel.
        ssim_per_db: f64 = 0.05, 1e-6..=1.0;
        /// Loss of views trained on that counts as much as that of held-out views, relative to it.
        trained_loss: f64 = 4.0, 1.0..=1e6;
        /// PSNR without visible error, decibels: no view counts as better.
        full_db: f64 = 40.0, 1.0..=200.0;
        /// SSIM without visible error.
        full_ssim: f64 = 0.99, 0.0..=1.0;
        /// Held-out views: one of so many training views, at least three.
        held_out_every: u32 = 8, 2..=1_000;

        /// Iterations of a short run: below it, learning rates of means and SH are multiplied.
        short_iterations: u32 = 15_000, 0..=u32::MAX;
        /// Factor of these learning rates.
        short_rate_factor: f32 = 2.0, 0.01..=100.0;
        /// Training views from which the factor applies to SH.
        sh_rate_views: u32 = 24, 0..=u32::MAX;

        /// Steps on photographs of half their width and height, at the start, as a share of the run.
        half_size_share: f64 = 0.1, 0.0..=1.0;
        /// End of growth, as a share of the run.
        growth_share: f64 = 0.45, 0.01..=1.0;
        /// Last fit with all training views, as a share of the run.
        last_fit_share: f64 = 0.25, 0.01..=1.0;
        /// Steps of a round, as a share of the run.
        round_share: f64 = 0.05, 1e-3..=1.0;
        /// Smallest share of the splats that a round removes.
        share_min: f64 = 0.04, 1e-3..=0.5;
    }
}

impl AutoConfig {
    /// Iteration up to which photographs have half their width and height.
    pub fn half_size_until(&self, iterations: u32) -> u32 {
        share(self.half_size_share, iterations)
    }

    /// Iteration that growth ends at, at the latest.
    pub fn growth_until(&self, iterations: u32) -> u32 {
        share(self.growth_share, iterations)
    }

    /// Steps of the last fit, of a run of so many iterations.
    pub fn last_fit(&self, iterations: u32) -> u32 {
        share(self.last_fit_share, iterations)
    }

    /// Iteration from which the count is fixed, at the latest.
    pub fn settle_by(&self, iterations: u32) -> u32 {
        iterations - self.last_fit(iterations)
    }

    /// Steps of a round.
    pub fn round(&self, iterations: u32) -> u32 {
        share(self.round_share, iterations).max(1)
    }
}

fn share(share: f64, iterations: u32) -> u32 {
    (share * f64::from(iterations)).round() as u32
}
