//! Laboratory: benchmarks, the speed-accuracy chart, the survey of splat counts, the stress suite, synthetic scenes and
//! the pages of their results.
//!
//! Only the command line, tests and benchmarks use it; the engine is built without it (feature `lab`).
//!
#![doc = include_str!("../../docs/measuring.md")]

pub mod baseline;
pub mod bench;
pub mod chart;
mod evaluator;
pub(crate) mod page;
pub mod report;
pub mod stress;
pub mod survey;
pub mod synth;
