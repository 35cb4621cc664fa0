//! The `ashfall` binary.

fn main() {}
