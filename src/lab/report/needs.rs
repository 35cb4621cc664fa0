//! What a scene needs, as a run that looked for it has found it: figures for `report.json`, and a page that shows why.

use super::Report;
use crate::scene::sh_coefficient_count;
use crate::simplify::{Decision, HalfResolution, Law};
use serde::{Deserialize, Serialize};

/// What was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Needs {
    /// The sentence to quote.
    pub sentence: String,
    /// The smallest gain worth paying for: decibels for a tenth more splats.
    pub preference_db: f64,
    /// Splats in the end.
    pub splat_count: usize,
    /// How many of them are of degree 0, 1, 2 and 3.
    pub splats_by_degree: [usize; 4],
    /// Their bytes, each stored at its own degree in 32-bit floats.
    pub bytes_by_degree: [u64; 4],
    /// What the held-out views lost, before the last fit, by the harmonics that went, decibels; `None` if none did.
    pub sh_lost_db: Option<f64>,
    /// The iteration from which the count was fixed and all training views were seen.
    pub settled_from: Option<u32>,
    /// For how long photographs of half the size were enough.
    #[serde(default)]
    pub half_size: Option<HalfResolution>,
    /// The views that were held out until then, by name.
    pub validation_views: Vec<String>,
    /// Splats and decibels as rounds have found them, time's share taken out.
    pub points: Vec<[f64; 2]>,
    /// The law through them.
    pub law: Option<Law>,
    /// Where a tenth more splats is worth the preference, by that law.
    pub knee: Option<f64>,
    /// What was done, one after the other.
    pub steps: Vec<Decision>,
    /// The run with fixed rules that this one is compared with.
    pub against: Option<Against>,
}

/// A run to compare with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Against {
    /// Its splats.
    pub splat_count: usize,
    /// By how much its test views were better; decibels.
    pub better_db: f64,
}

impl Against {
    /// A run beside one whose test views have so many decibels; `None` where either has no test view.
    pub fn of(report: &Report, psnr_db: Option<f64>) -> Option<Against> {
        Some(Against {
            splat_count: report.splat_count,
            better_db: report.test.psnr_db? - psnr_db?,
        })
    }
}

impl Needs {
    /// The same beside a run to compare with, where there is one; `psnr_db` is that of this run's test views.
    pub fn beside(mut self, other: Option<&Report>, psnr_db: Option<f64>) -> Needs {
        self.against = other.and_then(|report| Against::of(report, psnr_db));
        self.sentence = sentence(self.splats_by_degree, self.against.as_ref());
        self
    }
}

/// Floats of a splat that are no harmonics: position, rotation, scales, opacity.
const FLOATS: usize = 3 + 4 + 3 + 1;

/// Bytes of so many splats of each degree, each stored at its own.
pub fn bytes_by_degree(splats: [usize; 4]) -> [u64; 4] {
    [0, 1, 2, 3].map(|degree| {
        let floats = FLOATS + 3 * sh_coefficient_count(degree as u32);
        (4 * floats * splats[degree]) as u64
    })
}

/// The sentence to quote.
pub fn sentence(splats_by_degree: [usize; 4], against: Option<&Against>) -> String {
    let count: usize = splats_by_degree.iter().sum();
    let share = 100.0 * splats_by_degree[0] as f64 / count.max(1) as f64;
    let mut text = format!(
        "this scene needs {} splats, {share:.0} % at degree 0",
        grouped(count)
    );
    if let Some(Against {
        splat_count,
        better_db,
    }) = against
    {
        let word = if *better_db < 0.0 { "less" } else { "more" };
        text += &format!(
            "; the fixed recipe used {} for {:.2} dB {word}",
            grouped(*splat_count),
            better_db.abs()
        );
    }
    text
}

/// A number with its thousands apart.
pub(in crate::lab) fn grouped(number: usize) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sentence_compares_only_where_there_is_something_to_compare_with() {
        let degrees = [31_980, 4_000, 3_000, 2_020];
        let alone = "this scene needs 41,000 splats, 78 % at degree 0";
        assert_eq!(sentence(degrees, None), alone);
        let against = |better_db| Against {
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
