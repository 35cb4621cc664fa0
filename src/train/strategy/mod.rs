//! Density control: addition, relocation and removal of splats, as a pure function of the optimiser state, the
//! statistics since the last refinement, and (seed, iteration).
//!
//! **Invariant:** ties are broken by row, random numbers are keyed by row, sums are in a fixed order: the same input
//! gives the same rows in the same order on every machine.

mod adc;
mod mcmc;
mod relocation;
#[cfg(test)]
mod tracking;

use super::config::{StrategyKind, TrainConfig};
use super::sky::SkyShell;
use super::state::HostState;
use crate::scene::morton_order;
use serde::{Deserialize, Serialize};

pub use adc::reset_opacity;
pub use relocation::relocated;

/// Statistics of a splat since the last refinement: sum of the norms of the loss gradient on its screen position (per
/// normalised device coordinate: pixel gradient × half the image size), number of steps that saw it, its largest radius
/// in pixels, and 0.
pub type SplatStats = [f32; 4];

/// Circumstances of a refinement.
#[derive(Clone, Copy, Debug)]
pub struct RefineContext<'a> {
    /// The iteration just finished.
    pub iteration: u32,
    /// Constants of the run.
    pub config: &'a TrainConfig,
    /// Scene extent in world units.
    pub extent: f64,
    /// Splat limit.
    pub limit: usize,
    /// Shell of the sky, whose splats may be large, if the run has one.
    pub sky: Option<SkyShell>,
}

/// Counts of a refinement's actions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RefineReport {
    /// Splats copied.
    pub cloned: usize,
    /// Splats replaced by two smaller ones.
    pub split: usize,
    /// Splats removed.
    pub pruned: usize,
    /// Dead splats moved to live ones.
    pub relocated: usize,
    /// Splats after the refinement.
    pub count: usize,
}

/// Origin of a row of a refined state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct RowOrigin {
    /// Row before the refinement.
    pub(crate) row: u32,
    /// Whether the moments are 0, as of a new or moved splat.
    pub(crate) is_new: bool,
}

/// Refines the state by the configured strategy. `stats` has an entry per row.
///
/// Afterwards rows are in Morton order, untouched rows keep their moments, and new or moved ones have none.
///
/// Panics if `stats` and the state differ in length.
pub fn refine(state: &mut HostState, stats: &[SplatStats], context: RefineContext<'_>) -> RefineReport {
    refine_rows(state, stats, context).0
}

/// [`refine`] of a state of which harmonics and moments may be elsewhere: with the origin of every row.
pub(crate) fn refine_rows(
    state: &mut HostState,
    stats: &[SplatStats],
    context: RefineContext<'_>,
) -> (RefineReport, Vec<RowOrigin>) {
    assert_eq!(state.len(), stats.len(), "one statistic per splat");
    match context.config.strategy {
        StrategyKind::Adc => adc::refine(state, stats, context),
        StrategyKind::Mcmc => mcmc::refine(state, context),
    }
}

/// Row of the refined state before it is gathered.
#[derive(Clone, Copy, Debug)]
struct Row {
    /// Source row.
    source: u32,
    /// Mean.
    mean: [f32; 3],
    /// Change from the source.
    change: RowChange,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum RowChange {
    /// No change.
    Kept,
    /// Opacity logit set, moments as they are.
    Faded(f32),
    /// Opacity logit set, log-scales changed, no moments.
    Renewed {
        /// New opacity logit.
        logit: f32,
        /// Summand of each log-scale.
        log_factors: [f32; 3],
    },
}

/// Gathers rows in Morton order, each with its source's parameters and moments and its change.
fn gather(state: &HostState, rows: &[Row]) -> (HostState, Vec<RowOrigin>) {
    let means: Vec<[f32; 3]> = rows.iter().map(|row| row.mean).collect();
    let order = morton_order(&means);
    let sources: Vec<u32> = order.iter().map(|&i| rows[i as usize].source).collect();
    let mut refined = state.select(&sources);
    for (to, &from) in order.iter().enumerate() {
        let row = &rows[from as usize];
        match row.change {
            RowChange::Kept => {}
            RowChange::Faded(logit) => refined.params[0][to][3] = logit,
            RowChange::Renewed { logit, log_factors } => {
                refined.clear_moments(to);
                let [x, y, z] = row.mean;
                refined.params[0][to] = [x, y, z, logit];
                let log_scales = &mut refined.params[2][to][..3];
                log_scales
                    .iter_mut()
                    .zip(log_factors)
                    .for_each(|(scale, add)| *scale += add);
            }
        }
    }
    let origin = |&i: &u32| RowOrigin {
        row: rows[i as usize].source,
        is_new: matches!(rows[i as usize].change, RowChange::Renewed { .. }),
    };
    (refined, order.iter().map(origin).collect())
}
