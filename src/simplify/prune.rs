//! Pruning: a set of splats with summed weights within a budget at every pixel.

use super::contribution::{ContributionPass, RANKS, STAYS, SplatContribution};
use crate::Result;
use crate::scene::{Camera, Splats};

/// Relative rounding error of sums in `f32`: a pixel's n-th weight is a product of 2n rounded factors, and n of them
/// are summed, which comes to 3 n 2⁻²⁴; a thousandth is n = 5,600.
const ROUNDING: f64 = 1e-3;

/// Result of [`prune`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PruneResult {
    /// By splat: whether it can be removed.
    pub removed: Vec<bool>,
    /// Number of removed splats.
    pub count: usize,
    /// Removed splats without weight in any view.
    pub unseen: usize,
    /// Splats with no weight above the budget: an upper bound of `count`.
    pub light: usize,
    /// Number of passes over all views.
    pub rounds: usize,
}

/// Decision on a splat.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PruneDecision {
    Open,
    Goes,
    Stays,
}

/// Finds splats with weights that sum to at most `error` at every pixel of every view, such that none can be added: the
/// result of the greedy rule that takes, in ascending order of the sum of weights over all views, each splat that still
/// fits.
///
/// The rule is run in parallel rounds: each ranks the open splats, and every pixel finds the rank up to which it could
/// lose all of them. A splat within the limit of all its pixels goes, independently of later ones; one that some pixel
/// cannot lose even alone, beside those already removed, stays. `None` if `go_on` returns false.
///
/// # Errors
/// As [`ContributionPass::losses`].
pub fn prune(
    weigher: &mut ContributionPass,
    cameras: &[Camera],
    error: f64,
    go_on: &mut dyn FnMut() -> bool,
) -> Result<Option<PruneResult>> {
    let count = weigher.splat_count();
    let budget = (error * (1.0 - ROUNDING)) as f32;
    let Some(first) = weigher.losses(cameras, &vec![STAYS; count], budget, go_on)? else {
        return Ok(None);
    };
    let mut fates: Vec<PruneDecision> = first.iter().map(|loss| fate(loss, budget)).collect();
    let unseen = fates.iter().filter(|&&fate| fate == PruneDecision::Goes).count();
    let mut order: Vec<usize> = (0..count).filter(|&i| fates[i] == PruneDecision::Open).collect();
    let light = unseen + order.len();
    order.sort_by(|&a, &b| first[a].sum.total_cmp(&first[b].sum).then(a.cmp(&b)));
    let (mut rounds, mut fine) = (1, false);
    while !order.is_empty() {
        let ranks = ranks(&fates, &order, fine);
        let Some(losses) = weigher.losses(cameras, &ranks, budget, go_on)? else {
            return Ok(None);
        };
        rounds += 1;
        let open = order.len();
        for &i in &order {
            if ranks[i] <= RANKS as f32 && losses[i].limit >= ranks[i] {
                fates[i] = PruneDecision::Goes;
            } else if losses[i].most > budget {
                fates[i] = PruneDecision::Stays;
            }
        }
        order.retain(|&i| fates[i] == PruneDecision::Open);
        let stuck = order.len() == open;
        if stuck && fine {
            // Only if two orders of summation round to either side of the budget.
            fates[order.remove(0)] = PruneDecision::Stays;
        }
        // If even the first rank, of many splats, exceeds a budget, the first few splats get ranks of their own.
        fine = stuck;
    }
    let removed: Vec<bool> = fates.iter().map(|&fate| fate == PruneDecision::Goes).collect();
    Ok(Some(PruneResult {
        count: removed.iter().filter(|&&gone| gone).count(),
        removed,
        unseen,
        light,
        rounds,
    }))
}

/// Decision from a splat's own weights alone.
fn fate(loss: &SplatContribution, budget: f32) -> PruneDecision {
    match loss.most {
        most if most > budget => PruneDecision::Stays,
        0.0 => PruneDecision::Goes,
        _ => PruneDecision::Open,
    }
}

/// Rank of each splat: open splats by `order`, with the smallest equal number per rank that fits, or, if `fine`, the
/// first [`RANKS`] alone, one per rank.
fn ranks(fates: &[PruneDecision], order: &[usize], fine: bool) -> Vec<f32> {
    let rank = |fate: &PruneDecision| match fate {
        PruneDecision::Goes => 0.0,
        PruneDecision::Open | PruneDecision::Stays => STAYS,
    };
    let mut ranks: Vec<f32> = fates.iter().map(rank).collect();
    let each = match fine {
        true => 1,
        false => order.len().div_ceil(RANKS),
    };
    for (place, &i) in order.iter().enumerate().take(each * RANKS) {
        ranks[i] = (1 + place / each) as f32;
    }
    ranks
}

/// The splats that are not removed.
pub fn kept(splats: &Splats, removed: &[bool]) -> Splats {
    assert_eq!(splats.len(), removed.len(), "a word on every splat");
    let stays = |i: &usize| !removed[*i];
    let indices: Vec<usize> = (0..splats.len()).filter(stays).collect();
    splats.picked(&indices)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_follow_the_order_and_none_is_passed_over() {
        let fates = [
            vec![PruneDecision::Goes; 3],
            vec![PruneDecision::Open; 700],
            vec![PruneDecision::Stays; 2],
        ]
        .concat();
        let order: Vec<usize> = (3..703).rev().collect();
        let coarse = ranks(&fates, &order, false);
        assert_eq!((coarse[0], coarse[704]), (0.0, STAYS));
        assert_eq!((coarse[702], coarse[699], coarse[3]), (1.0, 2.0, 234.0));
        let fine = ranks(&fates, &order, true);
        assert_eq!((fine[702], fine[702 - 254]), (1.0, 255.0));
        assert_eq!(fine[702 - 255], STAYS);
    }

    #[test]
    fn what_is_left_keeps_its_order_and_its_numbers() {
        let splats = Splats {
            mean: (0..4).map(|i| [i as f32; 3]).collect(),
            quaternion: vec![[1.0; 4]; 4],
            log_scale: vec![[0.5; 3]; 4],
            opacity_logit: vec![1.0, 2.0, 3.0, 4.0],
            sh: (0..12).map(|i| i as f32).collect(),
            ..Splats::default()
        };
        let left = kept(&splats, &[true, false, true, false]);
        assert_eq!(left.mean, [[1.0; 3], [3.0; 3]]);
        assert_eq!(left.opacity_logit, [2.0, 4.0]);
        assert_eq!(left.sh, [3.0, 4.0, 5.0, 9.0, 10.0, 11.0]);
    }
}
