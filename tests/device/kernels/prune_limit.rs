//! Ranks down to which each pixel can do without the splats of a ranking.

use crate::common::check::*;
use crate::common::device;
use crate::common::scenes::Random;
use crate::kernels::LANES;
use crate::kernels::rasterize::composites_of_kinds;
use ashfall::lab::bench::kernels::prune_limit::prune_limit as case;
use ashfall::reference::prune_limit::{PruneLimits, prune_limit};

#[test]
fn pixels_find_how_far_they_can_go() {
    let gpu = device::gpu();
    let mut check = Check::new("prune_limit");
    let composites = composites_of_kinds();
    for budget in [0.003, 0.3] {
        let case = |of| case(&gpu, of, budget).unwrap();
        let named = composites
            .iter()
            .map(|(name, of)| (format!("{name}, {budget}"), case(of)));
        check.cases(&gpu, LANES, &named.collect::<Vec<_>>());
    }
    check.finish();
}

/// Pixels whose limit is raised never lose more than they may, by the very sums that a frame without the ranks up
/// to it takes: 5,000 rankings of one stack.
#[test]
fn what_a_limit_allows_is_within_the_budget() {
    let random = &mut Random::new(3);
    for round in 0..5000 {
        let count = 1 + random.below(12);
        let mut passing = 1.0;
        let weights: Vec<(f64, f64)> = (0..count)
            .map(|_| {
                let alpha = random.between(0.0, 0.4);
                let weight = passing * alpha;
                passing -= weight;
                ((1 + random.below(255)) as f64, weight)
            })
            .collect();
        let budget = random.between(0.001, 0.8);
        let PruneLimits { limit, .. } = prune_limit(&weights, budget);
        let sum = |limit: f64| -> f64 {
            let taken = weights.iter().filter(|(rank, _)| *rank <= limit);
            taken.map(|(_, weight)| weight).sum()
        };
        assert!(sum(limit) <= budget + 1e-12, "round {round}");
        assert!(limit == 255.0 || sum(limit + 1.0) > budget - 1e-12, "round {round}");
    }
}
