//! A frame's lists as the passes before compositing leave them: the library's own, for its benches.

#![allow(
    unused_imports,
    unreachable_pub,
    reason = "shared by test binaries, each of which uses its own part"
)]

pub use ashfall::lab::bench::input::lists::*;
