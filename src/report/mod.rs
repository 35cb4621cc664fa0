//! What a run did, for machines (`report.json`) and for eyes (comparison pictures).

pub mod chart;
mod figures;
pub mod needs;
mod pictures;
mod score;
pub mod stress;

pub use figures::{HistoryEntry, MemoryFigures, Report, Timings};
pub use pictures::{DIFFERENCE_GAIN, comparison};
pub use score::{MeanScore, Target, ViewScore};
