//! Medians with their intervals.

/// Summary of repeated measurements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summary {
    /// Number of runs.
    pub runs: usize,
    /// The median.
    pub median: f64,
    /// Median of the absolute deviations from it.
    pub mad: f64,
    /// An interval that holds the true median with a probability of 95 % for any distribution: see [`median_ranks`].
    /// Below six runs no such interval exists; then it is their range.
    pub interval: [f64; 2],
}

impl Summary {
    /// Summary of `values`; all zero if empty.
    pub fn of(values: &[f64]) -> Summary {
        if values.is_empty() {
            return Summary {
                runs: 0,
                median: 0.0,
                mad: 0.0,
                interval: [0.0; 2],
            };
        }
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let middle = median(&sorted);
        let [low, high] = median_ranks(sorted.len()).unwrap_or([0, sorted.len() - 1]);
        let mut distances: Vec<f64> = sorted.iter().map(|v| (v - middle).abs()).collect();
        distances.sort_by(f64::total_cmp);
        Summary {
            runs: sorted.len(),
            median: middle,
            mad: median(&distances),
            interval: [sorted[low], sorted[high]],
        }
    }
}

/// Median of ascending values, at least one.
fn median(sorted: &[f64]) -> f64 {
    let middle = sorted.len() / 2;
    if sorted.len() % 2 == 1 {
        sorted[middle]
    } else {
        0.5 * (sorted[middle - 1] + sorted[middle])
    }
}

/// Ranks (from 0) of the order statistics between which the true median lies with a probability of at least 95 %; the
/// number of runs below the median is binomial with p = 1/2 (David and Nagaraja, Order Statistics, section 7.1). `None`
/// below six runs, for which even the extremes hold less.
pub fn median_ranks(runs: usize) -> Option<[usize; 2]> {
    if runs > 1000 {
        // Normal approximation, because 2^-runs underflows in f64.
        let k = (0.5 * runs as f64 - 0.98 * (runs as f64).sqrt()).floor() as usize;
        return Some([k, runs - 1 - k]);
    }
    // P(B <= k) term by term.
    let mut term = 0.5f64.powi(runs as i32);
    let mut below = 0.0;
    let mut rank = None;
    for k in 0..runs / 2 {
        below += term;
        if 2.0 * below > 0.05 {
            break;
        }
        rank = Some(k);
        term *= (runs - k) as f64 / (k + 1) as f64;
    }
    rank.map(|k| [k, runs - 1 - k])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_summary_is_not_moved_by_one_interruption() {
        let summary = Summary::of(&[4.0, 1.0, 3.0, 2.0, 900.0]);
        assert_eq!((summary.runs, summary.median, summary.mad), (5, 3.0, 1.0));
        assert_eq!(summary.interval, [1.0, 900.0]);
        assert_eq!(Summary::of(&[1.0, 2.0]).median, 1.5);
        assert_eq!(Summary::of(&[7.0]).interval, [7.0, 7.0]);
        assert_eq!(Summary::of(&[]).runs, 0);
    }

    #[test]
    fn intervals_of_the_median_are_those_of_the_tables() {
        // Conover, Practical Nonparametric Statistics, table A3: ranks counted from 1 there.
        assert_eq!(median_ranks(5), None);
        assert_eq!(median_ranks(6), Some([0, 5]));
        assert_eq!(median_ranks(9), Some([1, 7]));
        assert_eq!(median_ranks(21), Some([5, 15]));
        assert_eq!(median_ranks(100), Some([39, 60]));
        let exact = median_ranks(1000).unwrap_or_default();
        let limit = median_ranks(1001).unwrap_or_default();
        assert!(exact[0].abs_diff(limit[0]) <= 2, "{exact:?} {limit:?}");
    }
}
