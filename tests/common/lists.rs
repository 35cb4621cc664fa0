//! Re-export of the per-frame lists before compositing, from the library's benches.

#![allow(
    unused_imports,
    unreachable_pub,
    reason = "shared by test binaries, each of which uses its own part"
)]

pub use ashfall::lab::bench::input::lists::*;
