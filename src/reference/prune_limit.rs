//! How far down a ranking of splats a pixel can do without them.

/// Ranks end here.
pub const LAST: f64 = 255.0;

/// What a pixel can prune_limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PruneLimits {
    /// The largest rank from 0 to [`LAST`] such that all weights up to it sum to no more than the budget.
    pub limit: f64,
    /// The sum of the weights of rank 0.
    pub spent: f64,
    /// The smallest distance of any such sum from the budget, relative to it: how near the limit is to being another.
    pub margin: f64,
}

/// Of a pixel with these weights, each with its rank. Those of rank 0 are taken to be within the budget.
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
