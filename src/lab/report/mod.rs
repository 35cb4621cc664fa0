//! Report of a training run: `report.json`, comparison pictures, and the page of a run that chose its splat count.

pub mod curve;
mod figures;
pub mod needs;
pub mod page;
mod pictures;

pub use figures::{HistoryEntry, MemoryFigures, Report, Timings};
pub use pictures::{DIFFERENCE_GAIN, comparison, side_by_side};
