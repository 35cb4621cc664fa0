//! MCMC: dead splats move onto live ones, chosen in proportion to opacity, and the count grows to its cap by the same
//! rule; each group shares its opacity and size so that the picture stays the same.

use super::relocation::relocated;
use super::{RefineContext, RefineReport, Row, RowChange, RowOrigin, gather};
use crate::scene::logit;
use crate::train::rng::{self, Stream};
use crate::train::state::HostState;

/// Relocation and growth; noise and regularisation act every step, on the device.
pub(super) fn refine(state: &mut HostState, context: RefineContext<'_>) -> (RefineReport, Vec<RowOrigin>) {
    let least = f64::from(context.config.mcmc.min_opacity);
    let drawn = |row: usize| state.opacity(row) * state.smoothing_factor(row);
    let is_live = |row: usize| drawn(row) > least && state.is_finite(row);
    let live: Vec<bool> = (0..state.len()).map(is_live).collect();
    let weights = Weights::new((0..state.len()).map(|row| match live[row] {
        true => state.opacity(row),
        false => 0.0,
    }));
    let dead = live.iter().filter(|&&alive| !alive).count();
    // Without a live splat the state stays the same.
    let grown = match weights.total() {
        0 => 0,
        _ => growth(state.len(), context),
    };
    let relocated = if weights.total() == 0 { 0 } else { dead };
    let draws = [(relocated, Stream::Relocate), (grown, Stream::Grow)];
    let mut guests = vec![0; state.len()];
    for (count, stream) in draws {
        for ordinal in 0..count as u32 {
            let words = rng::bits(context.config.seed, context.iteration, ordinal, stream);
            guests[weights.find(rng::below(words, weights.total()))] += 1;
        }
    }
    let rows = share(state, &guests, &live, relocated > 0, least);
    let (refined, origins) = gather(state, &rows);
    *state = refined;
    let report = RefineReport {
        cloned: grown,
        relocated,
        count: state.len(),
        ..RefineReport::default()
    };
    (report, origins)
}

/// Number of splats to add to `count`.
fn growth(count: usize, context: RefineContext<'_>) -> usize {
    let wanted = (count as f64 * f64::from(context.config.mcmc.growth)).round() as usize;
    wanted.min(context.limit).saturating_sub(count)
}

/// Rows after so many `guests`, moved or added, have joined each host; a host and its guests get equal shares.
fn share(state: &HostState, guests: &[u32], live: &[bool], drop_dead: bool, least: f64) -> Vec<Row> {
    let mut rows = Vec::with_capacity(state.len());
    for (row, &joined) in guests.iter().enumerate() {
        if drop_dead && !live[row] {
            continue;
        }
        let copies = 1 + joined;
        let mut shared = Row {
            source: row as u32,
            mean: state.mean(row),
            change: RowChange::Kept,
        };
        if copies > 1 {
            let (opacity, factor) = relocated(state.opacity(row), copies);
            shared.change = RowChange::Renewed {
                logit: logit(opacity.max(least)) as f32,
                log_factors: [factor.ln() as f32; 3],
            };
        }
        rows.extend(std::iter::repeat_n(shared, copies as usize));
    }
    rows
}

/// Distribution over rows with integer weights, for exact sums of any number of rows: a splat of opacity 0.005 among
/// 2²⁴ opaque ones keeps its share, which running sums in `f32` would lose.
struct Weights {
    /// Sum of the weights up to and including each row.
    up_to: Vec<u64>,
}

impl Weights {
    /// Weights in 0..=1; others, NaN included, count as 0.
    fn new(weights: impl Iterator<Item = f64>) -> Weights {
        let mut total = 0;
        let up_to = weights.map(|weight| {
            let valid = (0.0..=1.0).contains(&weight);
            total += u64::from(valid) * (weight * f64::from(u32::MAX)) as u64;
            total
        });
        Weights { up_to: up_to.collect() }
    }

    fn total(&self) -> u64 {
        self.up_to.last().copied().unwrap_or(0)
    }

    /// Row of the cumulative share that holds `target`, which must be below the total.
    fn find(&self, target: u64) -> usize {
        self.up_to.partition_point(|&sum| sum <= target)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tracking::{context, state_of};
    use super::*;
    use crate::train::{StrategyKind, TrainConfig};

    fn refine(state: &mut HostState, config: &TrainConfig) -> RefineReport {
        super::refine(state, context(config, 100)).0
    }

    fn config(max_splats: u32) -> TrainConfig {
        let mut config = TrainConfig::for_iterations(1_000).with_strategy(StrategyKind::Mcmc);
        config.max_splats = Some(max_splats);
        config.mcmc.growth = 1.05;
        config
    }

    /// −ln of the transmittance through all splats, as if coincident.
    fn depth(state: &HostState) -> f64 {
        (0..state.len()).map(|row| -(-state.opacity(row)).ln_1p()).sum()
    }

    #[test]
    fn two_hundred_guests_keep_the_opacity_of_their_host() {
        let mut opacities = vec![(0.0001, 0.1); 200];
        opacities.push((0.95, 0.1));
        let mut state = state_of(&opacities);
        let report = refine(&mut state, &config(201));
        assert_eq!((report.relocated, report.count), (200, 201));
        let together = -(-depth(&state)).exp_m1();
        assert!((together - 0.95).abs() < 1e-4, "{together}");
        assert!((0..201).all(|row| state.params[3][row][0] == 200.0));
        assert!(state.m.iter().flatten().all(|m| *m == [0.0; 4]));
    }

    #[test]
    fn growth_keeps_opacity_and_stops_at_the_cap() {
        let mut state = state_of(&[(0.8, 0.1); 100]);
        let before = depth(&state);
        let counts: Vec<usize> = (0..4).map(|_| refine(&mut state, &config(112)).count).collect();
        assert_eq!(counts, [105, 110, 112, 112]);
        assert!((depth(&state) / before - 1.0).abs() < 1e-5);
    }

    #[test]
    fn hosts_are_chosen_in_proportion_to_opacity() {
        let mut opacities: Vec<(f64, f64)> = vec![(0.0, 0.1); 60_000];
        opacities.extend([(0.1, 0.1), (0.2, 0.1), (0.3, 0.1)]);
        let mut state = state_of(&opacities);
        refine(&mut state, &config(60_003));
        let mut copies = [0_u32; 3];
        for sh in &state.params[3] {
            copies[sh[0] as usize - 60_000] += 1;
        }
        // Standard deviations of the binomials are at most 123.
        for (found, wanted) in copies.iter().zip([10_001_u32, 20_001, 30_001]) {
            assert!(found.abs_diff(wanted) < 600, "{copies:?}");
        }
    }

    #[test]
    fn broken_splats_are_dead_and_without_a_live_one_nothing_moves() {
        let mut state = state_of(&[(0.5, 0.1); 3]);
        state.params[0][1][3] = f32::NAN;
        state.params[2][2][0] = f32::INFINITY;
        assert_eq!(refine(&mut state, &config(3)).relocated, 2);
        assert!((0..3).all(|row| state.is_finite(row)));
        let mut dead = state_of(&[(0.001, 0.1); 3]);
        let before = dead.clone();
        let report = refine(&mut dead, &config(10));
        assert_eq!((report.relocated, report.cloned, report.count), (0, 0, 3));
        assert_eq!(depth(&dead), depth(&before));
        assert_eq!(refine(&mut state_of(&[]), &config(10)).count, 0);
        assert_eq!(refine(&mut state_of(&[(0.5, 0.1)]), &config(1)).count, 1);
    }

    #[test]
    fn weights_of_any_kind_and_number_can_be_drawn_from() {
        assert_eq!(Weights::new([0.0; 5].into_iter()).total(), 0);
        let odd = Weights::new([f64::NAN, f64::INFINITY, -1.0, 0.5, 1e-320].into_iter());
        assert_eq!(odd.find(odd.total() - 1), 3);
        let many = Weights::new((0..(1 << 24) + 1).map(|_| 0.005));
        let share = (0.005 * f64::from(u32::MAX)) as u64;
        assert_eq!(many.total(), share * ((1 << 24) + 1));
        assert_eq!(many.find(many.total() - 1), 1 << 24);
        assert_eq!(many.find(share * 1_000), 1_000);
    }
}
