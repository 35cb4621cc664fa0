//! Statistics: means, medians and their intervals, Student's t, and straight lines by least squares.

mod interval;
mod line;
mod student;
mod summary;

pub use interval::{Interval, mean};
pub use line::Line;
pub use student::{student_t_95, student_t_975};
pub use summary::{Summary, median_ranks};
