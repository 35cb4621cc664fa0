//! Splat count and SH degrees that a run chose for its scene, as part of `report.json`.

use crate::lab::page::grouped;
use crate::scene::sh_coefficient_count;
use crate::simplify::{Decision, LossPoint, loss_at};
use serde::{Deserialize, Serialize};

/// Splat count, SH degrees and the decisions behind them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Needs {
    /// Summary in one sentence.
    pub sentence: String,
    /// PSNR that the held-out views may lose in total, decibels.
    pub loss_db: f64,
    /// SSIM that they may lose.
    pub loss_ssim: f64,
    /// Final splat count.
    pub splat_count: usize,
    /// Largest smaller count that lost more even by the lower bound; `None` if no round tried such a count.
    pub too_few: Option<usize>,
    /// Splats of degree 0, 1, 2 and 3.
    pub splats_by_degree: [usize; 4],
    /// Their bytes, each stored at its own degree in 32-bit floats.
    pub bytes_by_degree: [u64; 4],
    /// Iteration from which the count was fixed and all training views were used.
    pub settled_from: Option<u32>,
    /// Names of the views held out until then.
    pub validation_views: Vec<String>,
    /// Losses by count: none at the end of growth, and those of the rounds.
    pub points: Vec<LossPoint>,
    /// Decisions in order.
    pub steps: Vec<Decision>,
    /// Comparison with a run of fixed rules.
    pub against: Option<RunComparison>,
}

/// Comparison with another run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunComparison {
    /// Its splats.
    pub splat_count: usize,
    /// PSNR of its test views minus that of this run's, decibels.
    pub better_db: f64,
}

impl Needs {
    /// Adds the comparison with another run.
    pub fn beside(mut self, against: Option<RunComparison>) -> Needs {
        self.against = against;
        self.sentence = self.sentence();
        self
    }

    /// Summary in one sentence.
    fn sentence(&self) -> String {
        let count = grouped(self.splat_count);
        let range = match self.too_few {
            Some(too_few) => format!("{} to {count}", grouped(too_few)),
            None => format!("at most {count}"),
        };
        let share = 100.0 * self.splats_by_degree[0] as f64 / self.splat_count.max(1) as f64;
        let mut text = format!("this scene needs {range} splats, {share:.0} % at degree 0");
        if let Some(RunComparison { splat_count, better_db }) = &self.against {
            let word = if *better_db < 0.0 { "less" } else { "more" };
            let (other, db) = (grouped(*splat_count), better_db.abs());
            text += &format!("; the fixed recipe used {other} for {db:.2} dB {word}");
            text += &third(&self.points, self.splat_count, *splat_count).unwrap_or_default();
        }
        text
    }
}

/// Cost of a third of another run's splats, where `splats` are more than that and rounds measured that few.
fn third(points: &[LossPoint], splats: usize, other: usize) -> Option<String> {
    let third = other as f64 / 3.0;
    let points: Vec<_> = points.iter().map(LossPoint::means).collect();
    let [db, ssim] = loss_at(&points, third).filter(|_| splats as f64 > third)?;
    let count = grouped(third as usize);
    Some(format!(
        ", a third of which ({count}) would cost held-out views {db:.2} dB and {ssim:.4} SSIM"
    ))
}

/// Floats of a splat besides its harmonics: position, rotation, scales, opacity.
const FLOATS: usize = 3 + 4 + 3 + 1;

/// Bytes of splats by degree, each stored at its own degree.
pub fn bytes_by_degree(splats: [usize; 4]) -> [u64; 4] {
    [0, 1, 2, 3].map(|degree| {
        let floats = FLOATS + 3 * sh_coefficient_count(degree as u32);
        (4 * floats * splats[degree]) as u64
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simplify::{Estimate, Estimates, QualityLoss};

    fn needs() -> Needs {
        let point = |splats, mean| LossPoint {
            splats,
            loss: QualityLoss {
                held_out: Estimates {
                    psnr_db: Estimate {
                        mean,
                        ..Estimate::default()
                    },
                    ..Estimates::default()
                },
                ..QualityLoss::default()
            },
            ..LossPoint::default()
        };
        Needs {
            sentence: String::new(),
            loss_db: 0.1,
            loss_ssim: 0.005,
            splat_count: 41_000,
            too_few: None,
            splats_by_degree: [31_980, 4_000, 3_000, 2_020],
            bytes_by_degree: [0; 4],
            settled_from: None,
            validation_views: Vec::new(),
            points: vec![point(80_000, 0.0), point(41_000, 0.05), point(20_000, 0.5)],
            steps: Vec::new(),
            against: None,
        }
    }

    #[test]
    fn the_sentence_has_a_range_and_a_comparison_if_there_is_one() {
        assert_eq!(
            needs().sentence(),
            "this scene needs at most 41,000 splats, 78 % at degree 0"
        );
        let needs = Needs {
            too_few: Some(33_000),
            ..needs()
        };
        let alone = "this scene needs 33,000 to 41,000 splats, 78 % at degree 0";
        assert_eq!(needs.sentence(), alone);
        let against = |splat_count, better_db| {
            let other = RunComparison { splat_count, better_db };
            needs.clone().beside(Some(other)).sentence
        };
        let more = format!("{alone}; the fixed recipe used 180,000 for 0.04 dB more");
        assert_eq!(against(180_000, 0.04), more);
        let less = format!("{alone}; the fixed recipe used 60,000 for 0.10 dB less");
        let third = ", a third of which (20,000) would cost held-out views 0.50 dB and 0.0000 SSIM";
        assert_eq!(against(60_000, -0.1), less + third);
    }

    #[test]
    fn splats_of_a_lower_degree_take_fewer_bytes() {
        assert_eq!(bytes_by_degree([1; 4]), [56, 92, 152, 236]);
    }
}
