//! Splat count and SH degrees that a run chose for its scene, as part of `report.json`.

use crate::lab::page::grouped;
use crate::scene::sh_coefficient_count;
use crate::simplify::{Decision, HalfResolution, Law};
use serde::{Deserialize, Serialize};

/// Splat count, SH degrees and the decisions behind them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Needs {
    /// Summary in one sentence.
    pub sentence: String,
    /// The smallest gain worth 10 % more splats, decibels.
    pub preference_db: f64,
    /// Final splat count.
    pub splat_count: usize,
    /// Splats of degree 0, 1, 2 and 3.
    pub splats_by_degree: [usize; 4],
    /// Their bytes, each stored at its own degree in 32-bit floats.
    pub bytes_by_degree: [u64; 4],
    /// Loss of the held-out views by removed harmonics, before the last fit, decibels; `None` if none were removed.
    pub sh_lost_db: Option<f64>,
    /// Iteration from which the count was fixed and all training views were used.
    pub settled_from: Option<u32>,
    /// Half-resolution training.
    #[serde(default)]
    pub half_size: Option<HalfResolution>,
    /// Names of the views held out until then.
    pub validation_views: Vec<String>,
    /// Splats and decibels of the rounds, without the gain of training time.
    pub points: Vec<[f64; 2]>,
    /// The law through them.
    pub law: Option<Law>,
    /// Count at which 10 % more splats gain the preference, by that law.
    pub knee: Option<f64>,
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
        self.sentence = sentence(self.splats_by_degree, self.against.as_ref());
        self
    }
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

/// Summary in one sentence.
pub fn sentence(splats_by_degree: [usize; 4], against: Option<&RunComparison>) -> String {
    let count: usize = splats_by_degree.iter().sum();
    let share = 100.0 * splats_by_degree[0] as f64 / count.max(1) as f64;
    let mut text = format!("this scene needs {} splats, {share:.0} % at degree 0", grouped(count));
    if let Some(RunComparison { splat_count, better_db }) = against {
        let word = if *better_db < 0.0 { "less" } else { "more" };
        text += &format!(
            "; the fixed recipe used {} for {:.2} dB {word}",
            grouped(*splat_count),
            better_db.abs()
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sentence_has_a_comparison_if_there_is_one() {
        let degrees = [31_980, 4_000, 3_000, 2_020];
        let alone = "this scene needs 41,000 splats, 78 % at degree 0";
        assert_eq!(sentence(degrees, None), alone);
        let against = |better_db| RunComparison {
            splat_count: 180_000,
            better_db,
        };
        let more = format!("{alone}; the fixed recipe used 180,000 for 0.04 dB more");
        assert_eq!(sentence(degrees, Some(&against(0.04))), more);
        let less = format!("{alone}; the fixed recipe used 180,000 for 0.10 dB less");
        assert_eq!(sentence(degrees, Some(&against(-0.1))), less);
        assert!(sentence([0; 4], None).contains("0 splats, 0 %"));
    }

    #[test]
    fn splats_of_a_lower_degree_take_fewer_bytes() {
        assert_eq!(bytes_by_degree([1; 4]), [56, 92, 152, 236]);
    }
}
