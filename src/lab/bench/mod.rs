//! Measurements shared by `ashfall bench` and `cargo bench`.
//!
//! Times are the device's own timestamps, with the processor time of the process, which on a software device is the
//! work itself and does not grow with the load of the machine. A measurement is warmed up, run several times and
//! summarised by its median and the median absolute deviation, which are robust against single interruptions
//! ([`stats`](crate::stats)). Each becomes a [`BenchRow`]; rows are printed, written as CSV or JSON ([`row`]), or filed
//! under a device and a date ([`record`]).
//!
//! **Invariant:** nothing here reads the environment or a fixed path; output paths are the caller's.

pub mod budget;
pub mod check;
pub mod clock;
pub mod frame;
pub mod growth;
pub mod guest;
pub mod input;
pub mod kernels;
pub mod record;
pub mod row;
pub mod session;
pub mod train;
pub mod trial;

pub use clock::CpuClock;
pub use row::{BenchRow, Work};
pub use session::{Bench, BenchOptions, Case, Times};
pub use trial::Subject;
