//! Re-export of the conversions from the oracle's numbers to kernel layouts, from the library's benches.

#![allow(
    unused_imports,
    unreachable_pub,
    reason = "shared by test binaries, each of which uses its own part"
)]

pub use ashfall::lab::bench::input::pack::*;
