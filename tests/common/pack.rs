//! The oracle's numbers in the form that kernels keep them in: the library's own, for its benches.

#![allow(
    unused_imports,
    unreachable_pub,
    reason = "shared by test binaries, each of which uses its own part"
)]

pub use ashfall::lab::bench::input::pack::*;
