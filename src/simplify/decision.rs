//! Record of the count controller's decisions, as reports show them.

use super::loss::{Estimates, Measure, QualityLoss, ViewSet};
use serde::{Deserialize, Serialize};

/// Loss of a scene with fewer splats.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LossPoint {
    /// Number of splats.
    pub splats: usize,
    /// Whether the round that measured it removed the splats.
    pub is_removed: bool,
    /// Loss against the best scene since the end of growth.
    pub loss: QualityLoss,
}

impl LossPoint {
    /// Count, and mean loss of the held-out views in PSNR and SSIM.
    pub fn means(&self) -> (f64, [f64; 2]) {
        let Estimates { psnr_db, ssim } = self.loss.held_out;
        (self.splats as f64, [psnr_db.mean, ssim.mean])
    }
}

/// PSNR in decibels and SSIM that held-out views lose with `splats` splats, interpolated over the logarithm of the
/// count between `points`, (count, loss) of rounds in their order. `None` outside their counts.
pub fn loss_at(points: &[(f64, [f64; 2])], splats: f64) -> Option<[f64; 2]> {
    type Point = (f64, [f64; 2]);
    let order = |a: &&Point, b: &&Point| a.0.total_cmp(&b.0);
    // Of rounds at the same count, the last is nearest to convergence.
    let (low, less) = points.iter().filter(|point| point.0 <= splats).max_by(order)?;
    let (high, more) = points.iter().rev().filter(|point| point.0 >= splats).min_by(order)?;
    let share = if high > low {
        (splats / low).ln() / (high / low).ln()
    } else {
        0.0
    };
    Some([0, 1].map(|measure| less[measure] + share * (more[measure] - less[measure])))
}

/// Decision of the count controller, with the scene before it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Decision {
    /// Steps of training done.
    pub iteration: u32,
    /// Action in words.
    pub act: String,
    /// Splats before the action.
    pub splats: usize,
    /// Mean PSNR of the held-out views before the action, decibels.
    pub psnr_db: f64,
    /// Mean SSIM of the held-out views before the action.
    pub ssim: f64,
    /// Splats of the reduced scene.
    pub left: Option<usize>,
    /// Loss of the reduced scene.
    pub loss: Option<QualityLoss>,
    /// Views and measure with the largest share of the loss that is allowed.
    pub decided_by: Option<(ViewSet, Measure)>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn losses_between_two_counts_are_between_theirs() {
        let points = [(1600.0, 0.0), (400.0, 0.5), (800.0, 0.1), (400.0, 0.3)];
        let points = points.map(|(splats, lost): (f64, f64)| (splats, [lost, 0.1 * lost]));
        let near = |splats: f64, lost: f64| {
            let [psnr, ssim] = loss_at(&points, splats).unwrap_or_default();
            assert!(
                (psnr - lost).abs() < 1e-12 && (ssim - 0.1 * lost).abs() < 1e-12,
                "{psnr}"
            );
        };
        near(400.0, 0.3);
        near(800.0 / 2_f64.sqrt(), 0.2);
        near(1600.0, 0.0);
        assert_eq!(loss_at(&points, 399.0), None);
        assert_eq!(loss_at(&points, 1601.0), None);
    }
}
