//! Statistics: means, quantiles, medians and their intervals, Student's t, straight lines by least squares, conjugate
//! gradients, and random numbers.

#[cfg(feature = "train")]
pub(crate) mod conjugate_gradients;
mod interval;
mod line;
mod quantile;
#[cfg(feature = "train")]
mod random;
mod student;
mod summary;

pub use interval::{Interval, mean};
pub use line::Line;
pub use quantile::quantile;
#[cfg(feature = "train")]
pub(crate) use random::SplitMix64;
pub use student::{student_t_95, student_t_975};
pub use summary::{Summary, median_ranks};
