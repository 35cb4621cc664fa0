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
        /// Held-out views: one of so many training views, at least three.
        held_out_every: u32 = 8, 2..=1_000;

        /// Training views of a point up to which measures against overfitting act in full, and SH keeps its published
        /// rate; beyond twice that number they do not act.
        few_views: f64 = 16.0, 0.0..=1e6;

        /// Steps on photographs of half their width and height, at the start, as a share of the run.
        half_size_share: f64 = 0.1, 0.0..=1.0;
        /// End of growth, as a share of the run.
        growth_share: f64 = 0.55, 0.01..=1.0;
        /// Last fit with all training views, as a share of the run.
        last_fit_share: f64 = 0.2, 0.01..=1.0;
        /// Steps of a round, as a share of the run.
        round_share: f64 = 0.05, 1e-3..=1.0;
        /// Smallest share of the splats that a round removes.
        share_min: f64 = 0.04, 1e-3..=0.5;
    }
}

impl AutoConfig {
    /// SSIM without visible error: 1 less the share of the colour range that the error of `full_db` is.
    pub fn full_ssim(&self) -> f64 {
        1.0 - 10_f64.powf(-self.full_db / 20.0)
    }

    /// Weight of the measures against overfitting, for points that so many training views see.
    pub fn overfitting_weight(&self, views_per_point: f64) -> f64 {
        match self.few_views > 0.0 {
            true => (2.0 - views_per_point / self.few_views).clamp(0.0, 1.0),
            false => 0.0,
        }
    }

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derived_constants_follow_views_and_length() {
        let auto = AutoConfig::default();
        assert!((auto.full_ssim() - 0.99).abs() < 1e-12);
        assert_eq!(
            [1.0, 16.0, 24.0, 32.0, 300.0].map(|views| auto.overfitting_weight(views)),
            [1.0, 1.0, 0.5, 0.0, 0.0]
        );
        let never = AutoConfig { few_views: 0.0, ..auto };
        assert_eq!(never.overfitting_weight(0.0), 0.0);
    }
}
