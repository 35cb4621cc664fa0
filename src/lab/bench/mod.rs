//! Measurement: what `ashfall bench` and `cargo bench` share.
//!
//! Times are the device's own timestamps; beside them stands the processor time that the process spent,
//! which on a software device is the work itself and does not grow when the machine has other things to
//! do. A measurement is warmed up, run several times and summed up by its median and the median absolute
//! deviation from it, which a stray interruption does not move ([`stats`](crate::stats)). Each becomes a [`Row`]; rows
//! are printed, written as CSV or JSON ([`row`]), or filed under a device and a date ([`record`]).
//!
//! **Invariant:** nothing here reads the environment or a fixed path: the caller says where to write.

pub mod check;
pub mod clock;
pub mod frame;
pub mod growth;
pub mod input;
pub mod kernels;
pub mod record;
pub mod row;
pub mod session;
pub mod train;
pub mod trial;

pub use clock::CpuClock;
pub use row::{Row, Unit, Work};
pub use session::{Bench, Case, Options, Times};
pub use trial::Subject;
