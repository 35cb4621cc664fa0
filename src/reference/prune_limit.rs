//! Prune limit of a pixel: highest rank up to which all splats fit into its budget.

/// Last rank.
pub const LAST: f64 = 255.0;

/// Prune limit of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PruneLimits {
    /// Largest rank from 0 to [`LAST`] such that all weights up to it sum to at most the budget.
    pub limit: f64,
    /// Sum of the weights of rank 0.
    pub spent: f64,
    /// Smallest distance of any such sum from the budget, relative to it: the margin of the limit against rounding.
    pub margin: f64,
}

/// Prune limit of a pixel with these (rank, weight) pairs. Weights of rank 0 are assumed within the budget.
pub fn prune_limit(weights: &[(f64, f64)], budget: f64) -> PruneLimits {
    let mut ranked = weights.to_vec();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut afforded = PruneLimits {
        limit: LAST,
        spent: 0.0,
        margin: f64::INFINITY,
    };
    let mut sum = 0.0;
    for group in ranked.chunk_by(|a, b| a.0 == b.0) {
        let rank = group[0].0;
        sum += group.iter().map(|&(_, weight)| weight).sum::<f64>();
        if rank == 0.0 {
            afforded.spent = sum;
            continue;
        }
        if rank > LAST {
            break;
        }
        afforded.margin = afforded.margin.min((sum / budget - 1.0).abs());
        if sum > budget {
            afforded.limit = (rank.ceil() - 1.0).min(afforded.limit);
        }
    }
    afforded
}
