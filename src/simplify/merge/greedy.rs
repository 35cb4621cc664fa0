//! Greedy merging, cheapest pair first; a merged splat gets new costs with its neighbours before the next merge.

use super::cost::{ColorProducts, cost};
use super::mass::MassGaussian;
use crate::scene::{SH_C0, ScreenFilter, Splats};
use crate::train::knn::neighbors;
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Number of neighbours with which each splat forms candidate pairs.
const NEIGHBORS: usize = 8;

/// Maximum number of partners of a merged splat: the cheapest of its parts' partners.
const PARTNERS: usize = 16;

/// Neighbours are searched again after 1/`ROUND` of the splats has gone: inherited partners are near, not nearest.
const ROUND: usize = 4;

/// Splats or merges between two calls of the progress callback.
const BATCH: usize = 1 << 12;

/// Candidate pair of splats.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct CandidatePair {
    /// Bits of the cost, in its order, since no cost is negative.
    cost_bits: u64,
    /// Indices, the lower first: it will hold the merged splat.
    splats: [u32; 2],
    /// Number of earlier merges of each at the time of the cost.
    ages: [u32; 2],
}

/// State of a scene during merging.
pub(super) struct MergeState {
    splats: Splats,
    filter: ScreenFilter,
    /// By splat; `None` if it takes no part.
    bodies: Vec<Option<MassGaussian>>,
    /// By splat: product of its colour with itself, as in [`ColorProducts`].
    tones: Vec<f64>,
    ages: Vec<u32>,
    /// By splat: the splat that it was merged into, or itself.
    holders: Vec<u32>,
    partners: Vec<Vec<u32>>,
    pairs: BinaryHeap<Reverse<CandidatePair>>,
}

impl MergeState {
    /// `rates`: pixels per world unit at each splat.
    pub(super) fn new(splats: &Splats, rates: &[f64]) -> MergeState {
        let filter = splats.filter;
        let stride = splats.sh_stride();
        let body = |i: usize| {
            let finite = splats.sh[i * stride..][..stride].iter().all(|v| v.is_finite());
            MassGaussian::new(splats, i, rates[i], filter).filter(|_| finite)
        };
        let count = splats.len();
        let tone = |i: usize| tone(splats, i, i);
        MergeState {
            filter,
            bodies: (0..count).into_par_iter().map(body).collect(),
            tones: (0..count).into_par_iter().map(tone).collect(),
            splats: splats.clone(),
            ages: vec![0; count],
            holders: (0..count as u32).collect(),
            partners: vec![Vec::new(); count],
            pairs: BinaryHeap::new(),
        }
    }

    /// Merges pairs until `count` splats are gone or no pair is left; returns how many went. `each` is called with the
    /// number gone so far; `None` if it returns false.
    pub(super) fn run(&mut self, count: usize, each: &mut dyn FnMut(usize) -> bool) -> Option<usize> {
        let mut gone = 0;
        loop {
            let before = gone;
            let round = (self.splats.len() - gone).div_ceil(ROUND);
            self.look_around();
            self.price(&mut || each(before))?;
            gone += self.round(round.min(count - gone), &mut |more| each(before + more))?;
            if gone == count || gone == before {
                return each(gone).then_some(gone);
            }
        }
    }

    /// Searches the partners of all splats anew.
    fn look_around(&mut self) {
        let bodies = self.bodies.iter().enumerate();
        let there = bodies.filter_map(|(i, body)| body.as_ref().map(|body| (i as u32, body.mean)));
        let (names, points): (Vec<u32>, Vec<[f32; 3]>) = there.map(|(i, mean)| (i, mean.as_vec3().to_array())).unzip();
        self.partners.iter_mut().for_each(Vec::clear);
        for (found, &of) in neighbors(&points, NEIGHBORS).into_iter().zip(&names) {
            for other in found.into_iter().map(|i| names[i as usize]) {
                self.partners[of as usize].push(other);
                self.partners[other as usize].push(of);
            }
        }
        for list in &mut self.partners {
            list.sort_unstable();
            list.dedup();
        }
    }

    /// Computes the costs of all pairs; `None` if `go_on` returns false.
    fn price(&mut self, go_on: &mut dyn FnMut() -> bool) -> Option<()> {
        let mut pairs = Vec::new();
        for start in (0..self.splats.len()).step_by(BATCH) {
            if !go_on() {
                return None;
            }
            let batch = start..(start + BATCH).min(self.splats.len());
            let priced = batch.into_par_iter().map(|i| self.later_pairs(i as u32));
            pairs.extend(priced.collect::<Vec<_>>().into_iter().flatten());
        }
        self.pairs = pairs.into_iter().map(Reverse).collect();
        Some(())
    }

    /// Merges up to `count` pairs, the cheapest first; returns how many.
    fn round(&mut self, count: usize, each: &mut dyn FnMut(usize) -> bool) -> Option<usize> {
        let mut gone = 0;
        while gone < count {
            let Some(Reverse(pair)) = self.pairs.pop() else {
                break;
            };
            let [i, j] = pair.splats.map(|i| i as usize);
            let there = [self.holders[i], self.holders[j]] == pair.splats;
            if !there || [self.ages[i], self.ages[j]] != pair.ages {
                continue;
            }
            if gone % BATCH == 0 && !each(gone) {
                return None;
            }
            self.merge(i, j);
            gone += 1;
        }
        Some(gone)
    }

    /// Pairs of a splat with its partners of higher index.
    fn later_pairs(&self, i: u32) -> Vec<CandidatePair> {
        let later = self.partners[i as usize].iter().filter(|&&j| j > i);
        later.filter_map(|&j| self.pair(i, j)).collect()
    }

    /// Candidate pair with its cost; `None` if the two cannot merge.
    fn pair(&self, i: u32, j: u32) -> Option<CandidatePair> {
        let splats = [i.min(j), i.max(j)];
        let [i, j] = splats.map(|i| i as usize);
        let (a, b) = (self.bodies[i].as_ref()?, self.bodies[j].as_ref()?);
        let (merged, joint) = a.merged(b, self.filter)?;
        let tones = ColorProducts {
            first: self.tones[i],
            second: self.tones[j],
            across: tone(&self.splats, i, j),
        };
        let cost = cost((a, b), (&merged, &joint), &tones, self.filter);
        cost.is_finite().then_some(CandidatePair {
            cost_bits: cost.to_bits(),
            splats,
            ages: [self.ages[i], self.ages[j]],
        })
    }

    /// Merges `j` into `i`.
    fn merge(&mut self, i: usize, j: usize) {
        let (Some(a), Some(b)) = (self.bodies[i], self.bodies[j].take()) else {
            return;
        };
        let Some((merged, joint)) = a.merged(&b, self.filter) else {
            return;
        };
        let stride = self.splats.sh_stride();
        let (before, after) = self.splats.sh.split_at_mut(j * stride);
        for (mine, other) in before[i * stride..][..stride].iter_mut().zip(&after[..stride]) {
            let (a, b) = (f64::from(*mine), f64::from(*other));
            *mine = (a + joint.share * (b - a)) as f32;
        }
        self.bodies[i] = Some(merged);
        self.tones[i] = tone(&self.splats, i, i);
        self.ages[i] += 1;
        self.holders[j] = i as u32;
        let mut known = std::mem::take(&mut self.partners[i]);
        known.append(&mut self.partners[j]);
        for partner in &mut known {
            *partner = self.holder(*partner);
        }
        known.sort_unstable();
        known.dedup();
        let mut pairs: Vec<CandidatePair> = known
            .iter()
            .filter(|&&partner| partner != i as u32)
            .filter_map(|&partner| self.pair(i as u32, partner))
            .collect();
        pairs.sort_unstable();
        pairs.truncate(PARTNERS);
        let partner = |pair: &CandidatePair| pair.splats[usize::from(pair.splats[0] == i as u32)];
        self.partners[i] = pairs.iter().map(partner).collect();
        self.pairs.extend(pairs.into_iter().map(Reverse));
    }

    /// The splat that `i` has been merged into, with path compression.
    fn holder(&mut self, mut i: u32) -> u32 {
        while self.holders[i as usize] != i {
            let next = self.holders[self.holders[i as usize] as usize];
            self.holders[i as usize] = next;
            i = next;
        }
        i
    }

    /// Remaining splats in their order; unmerged ones are bit-identical.
    pub(super) fn splats(mut self) -> Splats {
        for (i, body) in self.bodies.iter().enumerate() {
            if let Some(body) = body.as_ref().filter(|_| self.ages[i] > 0) {
                body.store(&mut self.splats, i);
            }
        }
        let there: Vec<usize> = (0..self.splats.len())
            .filter(|&i| self.holders[i] == i as u32)
            .collect();
        self.splats.picked(&there)
    }
}

/// Mean over all directions of the product of two splats' colours, plus 1 for their covers. SH functions are
/// orthogonal, each with the same mean square.
fn tone(splats: &Splats, i: usize, j: usize) -> f64 {
    let stride = splats.sh_stride();
    let c0 = f64::from(SH_C0);
    let row = |i: usize| splats.sh[i * stride..][..stride].iter().map(|&v| f64::from(v));
    let constants = |i: usize| row(i).take(3).sum::<f64>();
    let product: f64 = row(i).zip(row(j)).map(|(a, b)| a * b).sum();
    1.0 + 3.0 * 0.25 + 0.5 * c0 * (constants(i) + constants(j)) + c0 * c0 * product
}
