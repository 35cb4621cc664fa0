//! Loss of quality by fewer splats: PSNR and SSIM, by view.

use crate::Result;
use crate::render::Evaluator;
use crate::scene::Splats;
use crate::stats::{mean, student_t_95};
use crate::train::config::AutoConfig;
use serde::{Deserialize, Serialize};

/// Mean over views with its two one-sided 95 % bounds (Student's t).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Mean over the views.
    pub mean: f64,
    /// Lower bound: the true mean is below it with probability 1/20.
    pub low: f64,
    /// Upper bound: the true mean is above it with probability 1/20.
    pub high: f64,
}

impl Estimate {
    /// Mean of some numbers and its bounds; the bounds of a single number are the number itself.
    pub fn of(numbers: &[f64]) -> Estimate {
        let mean = mean(numbers);
        let width = match numbers.len() {
            0 | 1 => 0.0,
            count => {
                let square: f64 = numbers.iter().map(|x| (x - mean).powi(2)).sum();
                let freedom = count - 1;
                student_t_95(freedom) * (square / (freedom * count) as f64).sqrt()
            }
        };
        Estimate {
            mean,
            low: mean - width,
            high: mean + width,
        }
    }
}

/// Scores of some views, or differences of scores.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ViewScores {
    /// PSNR by view, decibels.
    pub psnr_db: Vec<f64>,
    /// SSIM by view.
    pub ssim: Vec<f64>,
}

impl ViewScores {
    /// Scores of an evaluator's views, at most those of a view without visible error; 0 if a rendering is not finite.
    pub(super) fn of(evaluator: &mut Evaluator<'_>, splats: &Splats, config: &AutoConfig) -> Result<ViewScores> {
        let psnr = |error: f64| match error.is_finite() {
            true => (-10.0 * error.max(f64::MIN_POSITIVE).log10()).min(config.full_db),
            false => 0.0,
        };
        let ssim = |ssim: f64| {
            if ssim.is_finite() {
                ssim.min(config.full_ssim())
            } else {
                0.0
            }
        };
        let pairs = evaluator.map(splats, |view| Ok((psnr(view.mean_squared_error()), ssim(view.ssim()))))?;
        let (psnr_db, ssim) = pairs.into_iter().unzip();
        Ok(ViewScores { psnr_db, ssim })
    }

    /// Removes the views from index `at` on and returns them.
    pub(super) fn split_off(&mut self, at: usize) -> ViewScores {
        ViewScores {
            psnr_db: self.psnr_db.split_off(at),
            ssim: self.ssim.split_off(at),
        }
    }

    /// Whether every view is without visible error.
    pub(super) fn is_full(&self, config: &AutoConfig) -> bool {
        self.psnr_db.iter().all(|&psnr| psnr >= config.full_db)
    }

    /// Scores of these views that `without` lacks, added to `lost`, which is empty or of the same views.
    pub(super) fn lost(&self, without: &ViewScores, lost: &ViewScores) -> ViewScores {
        let sum = |with: &[f64], without: &[f64], lost: &[f64]| {
            let lost = lost.iter().chain(std::iter::repeat(&0.0));
            let pairs = with.iter().zip(without).zip(lost);
            pairs.map(|((with, without), lost)| lost + with - without).collect()
        };
        ViewScores {
            psnr_db: sum(&self.psnr_db, &without.psnr_db, &lost.psnr_db),
            ssim: sum(&self.ssim, &without.ssim, &lost.ssim),
        }
    }

    /// Sets losses with a negative mean to 0, so that further losses count from the best scores.
    pub(super) fn forget_gains(&mut self) {
        for lost in [&mut self.psnr_db, &mut self.ssim] {
            if mean(lost) < 0.0 {
                lost.fill(0.0);
            }
        }
    }
}

/// Losses of both sets of views, added to `before`.
pub(super) fn lost(with: &[ViewScores; 2], without: &[ViewScores; 2], before: &[ViewScores; 2]) -> [ViewScores; 2] {
    [0, 1].map(|set| with[set].lost(&without[set], &before[set]))
}

/// Measure of quality.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Measure {
    /// PSNR, decibels.
    Psnr,
    /// SSIM.
    Ssim,
}

/// Views that a loss is measured on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ViewSet {
    /// Views that no step was trained on.
    HeldOut,
    /// Views trained on.
    Trained,
}

/// Estimates of a loss, by measure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Estimates {
    /// PSNR, decibels.
    pub psnr_db: Estimate,
    /// SSIM.
    pub ssim: Estimate,
}

impl Estimates {
    fn of(scores: &ViewScores) -> Estimates {
        Estimates {
            psnr_db: Estimate::of(&scores.psnr_db),
            ssim: Estimate::of(&scores.ssim),
        }
    }
}

/// Loss against the best scene since the end of growth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct QualityLoss {
    /// Loss of the held-out views.
    pub held_out: Estimates,
    /// Loss of the views trained on.
    pub trained: Estimates,
}

impl QualityLoss {
    /// Loss of these views.
    pub(super) fn of([held_out, trained]: &[ViewScores; 2]) -> QualityLoss {
        QualityLoss {
            held_out: Estimates::of(held_out),
            trained: Estimates::of(trained),
        }
    }

    /// Largest share of the allowed loss, with the views and the measure that have it; above 1, it is not allowed.
    ///
    /// Upper bounds of the held-out views decide. Where these cannot tell the scenes apart, since zero lies between
    /// their bounds, upper bounds of views trained on do; their means decide everywhere, with a larger allowed loss.
    pub fn share(&self, config: &AutoConfig) -> (f64, ViewSet, Measure) {
        let (held_out, trained) = (&self.held_out, &self.trained);
        let ssim = config.loss_db * config.ssim_per_db;
        let measures = [
            (Measure::Psnr, config.loss_db, held_out.psnr_db, trained.psnr_db),
            (Measure::Ssim, ssim, held_out.ssim, trained.ssim),
        ];
        let shares = measures.map(|(measure, allowed, held_out, trained)| {
            let is_unclear = held_out.low <= 0.0 && held_out.high > allowed;
            let (share, views) = match is_unclear {
                true => (trained.high / allowed, ViewSet::Trained),
                false => (held_out.high / allowed, ViewSet::HeldOut),
            };
            let trained_share = trained.mean / (config.trained_loss * allowed);
            match trained_share > share {
                true => (trained_share, ViewSet::Trained, measure),
                false => (share, views, measure),
            }
        });
        if shares[1].0 > shares[0].0 {
            shares[1]
        } else {
            shares[0]
        }
    }

    /// Whether the held-out views lose more than allowed even by the lower bound.
    pub fn is_certain(&self, config: &AutoConfig) -> bool {
        let Estimates { psnr_db, ssim } = self.held_out;
        psnr_db.low > config.loss_db || ssim.low > config.loss_db * config.ssim_per_db
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scores(psnr_db: &[f64], ssim: &[f64]) -> ViewScores {
        ViewScores {
            psnr_db: psnr_db.to_vec(),
            ssim: ssim.to_vec(),
        }
    }

    #[test]
    fn bounds_are_those_of_students_t() {
        // Mean 2, standard deviation 1, three samples: 2.92 / √3.
        let found = Estimate::of(&[1.0, 2.0, 3.0]);
        assert!((found.mean - found.low - 2.920 / 3_f64.sqrt()).abs() < 1e-9);
        assert!((found.high - found.mean - 2.920 / 3_f64.sqrt()).abs() < 1e-9);
        assert_eq!(Estimate::of(&[0.5]).low, 0.5);
        assert_eq!(Estimate::of(&[]).mean, 0.0);
    }

    #[test]
    fn losses_add_up_view_by_view_and_gains_are_forgotten() {
        let with = scores(&[30.0, 31.0], &[0.9, 0.8]);
        let without = scores(&[29.5, 31.25], &[0.875, 0.75]);
        let once = with.lost(&without, &ViewScores::default());
        assert_eq!(once.psnr_db, [0.5, -0.25]);
        let mut twice = without.lost(&with, &with.lost(&without, &once));
        assert_eq!(twice.psnr_db, once.psnr_db);
        twice.ssim = vec![0.25, -0.5];
        twice.forget_gains();
        assert_eq!(twice, scores(&[0.5, -0.25], &[0.0, 0.0]));
    }

    #[test]
    fn the_measure_and_the_views_that_lose_most_decide() {
        let config = AutoConfig::default();
        let even = |lost: f64| vec![lost; 3];
        let loss = |held_out: [f64; 2], trained: [f64; 2]| {
            let views = |[psnr_db, ssim]: [f64; 2]| scores(&even(psnr_db), &even(ssim));
            let (share, views, measure) = QualityLoss::of(&[views(held_out), views(trained)]).share(&config);
            ((100.0 * share).round(), views, measure)
        };
        let (db, ssim) = (config.loss_db, config.loss_db * config.ssim_per_db);
        let found = loss([0.5 * db, 0.25 * ssim], [db, ssim]);
        assert_eq!(found, (50.0, ViewSet::HeldOut, Measure::Psnr));
        let found = loss([0.5 * db, 1.25 * ssim], [db, ssim]);
        assert_eq!(found, (125.0, ViewSet::HeldOut, Measure::Ssim));
        let found = loss([0.0; 2], [db, 1.5 * config.trained_loss * ssim]);
        assert_eq!(found, (150.0, ViewSet::Trained, Measure::Ssim));
    }

    #[test]
    fn views_trained_on_decide_between_counts_that_held_out_views_cannot_tell_apart() {
        let config = AutoConfig::default();
        let half = 0.5 * config.loss_db;
        let loss = |held_out: [f64; 3], trained: f64| {
            let [held_out, trained] = [held_out, [trained; 3]].map(|psnr_db| scores(&psnr_db, &[0.0; 3]));
            QualityLoss::of(&[held_out, trained])
        };
        assert!(loss([half; 3], 2.0 * half).share(&config).0 < 1.0);
        let scattered = [-half, half, 3.0 * half];
        assert!(!loss(scattered, 0.0).is_certain(&config));
        let (share, views, measure) = loss(scattered, half).share(&config);
        assert!((share - 0.5).abs() < 1e-9 && (views, measure) == (ViewSet::Trained, Measure::Psnr));
        assert!(loss(scattered, 3.0 * half).share(&config).0 > 1.0);
        // A loss that is certain, though not how large it is.
        let (share, views, _) = loss([1.5 * half, 2.0 * half, 2.5 * half], 0.0).share(&config);
        assert!(share > 1.0 && views == ViewSet::HeldOut);
        assert!(loss([2.5 * half; 3], 0.0).is_certain(&config));
    }
}
