//! Density control: which splats are added, moved and removed, as a pure function of the optimiser's
//! state, the statistics gathered since the last refinement, and (seed, iteration).
//!
//! **Invariant:** ties are broken by row, random numbers are keyed by row, sums are in a fixed order:
//! the same input gives the same rows in the same order on every machine.

mod adc;
mod mcmc;
mod relocation;
#[cfg(test)]
mod tracking;

use super::config::{StrategyKind, TrainConfig};
use super::morton::morton_order;
use super::state::HostState;
use serde::{Deserialize, Serialize};

pub use adc::{Adc, reset_opacity};
pub use mcmc::Mcmc;
pub use relocation::relocated;

/// What a splat did since the last refinement: sum of the norms of the loss gradient on its screen
/// position (per normalised device coordinate: pixel gradient × half the image size), how many steps saw
/// it, its largest radius in pixels, and 0.
pub type SplatStats = [f32; 4];

/// When and where a refinement takes place.
#[derive(Clone, Copy, Debug)]
pub struct RefineContext<'a> {
    /// The iteration just finished.
    pub iteration: u32,
    /// The run's constants.
    pub config: &'a TrainConfig,
    /// Scene extent in world units.
    pub extent: f64,
    /// Splats are added up to this count, and no further.
    pub limit: usize,
    /// By row, the splat's share in the pixels' errors, relatively to the mean splat's; empty where nobody has looked.
    pub errors: &'a [f32],
}

impl RefineContext<'_> {
    /// How much more than others a row should grow, by its share in errors: the root of it, for a splat whose pixels
    /// are wrong is worth more splats, but not all of them. 1 where nobody has looked.
    fn attraction(&self, row: usize) -> f32 {
        self.errors.get(row).map_or(1.0, |error| error.sqrt())
    }
}

/// What a refinement did.
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
    /// Splats afterwards.
    pub count: usize,
}

/// A way of adding and removing splats.
pub trait Strategy: Send + Sync {
    /// Refines the state. `stats` has an entry per row.
    ///
    /// Afterwards rows are in Morton order, every untouched row still has its moments, and every new or
    /// moved one has none.
    ///
    /// Panics if `stats` and the state differ in length.
    fn refine(
        &self,
        state: &mut HostState,
        stats: &[SplatStats],
        context: RefineContext<'_>,
    ) -> RefineReport;
}

/// The strategy of a kind.
pub fn strategy(kind: StrategyKind) -> Box<dyn Strategy> {
    match kind {
        StrategyKind::Adc => Box::new(Adc),
        StrategyKind::Mcmc => Box::new(Mcmc),
    }
}

/// A row of the refined state before it is gathered.
#[derive(Clone, Copy, Debug)]
struct Row {
    /// The row it comes from.
    source: u32,
    /// Where its centre lies.
    mean: [f32; 3],
    /// What differs from the source.
    change: Change,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Change {
    /// Nothing.
    Kept,
    /// A copy: parameters as they are, no moments.
    Copied,
    /// Log-scales lowered by this much, no moments.
    Shrunk(f32),
    /// Opacity logit set, log-scales raised by so much, no moments.
    Shared {
        /// The new opacity logit.
        logit: f32,
        /// Added to each log-scale.
        log_factor: f32,
    },
}

/// Gathers rows in Morton order, each with its source's parameters, moments and its change.
fn gather(state: &HostState, rows: &[Row]) -> HostState {
    let means: Vec<[f32; 3]> = rows.iter().map(|row| row.mean).collect();
    let order = morton_order(&means);
    let sources: Vec<u32> = order.iter().map(|&i| rows[i as usize].source).collect();
    let mut refined = state.select(&sources);
    for (to, &from) in order.iter().enumerate() {
        let row = &rows[from as usize];
        if row.change == Change::Kept {
            continue;
        }
        refined.clear_moments(to);
        let place = &mut refined.params[0][to];
        place[..3].copy_from_slice(&row.mean);
        let add = match row.change {
            Change::Shrunk(less) => -less,
            Change::Shared { logit, log_factor } => {
                place[3] = logit;
                log_factor
            }
            Change::Kept | Change::Copied => 0.0,
        };
        for log_scale in &mut refined.params[2][to][..3] {
            *log_scale += add;
        }
    }
    refined
}
