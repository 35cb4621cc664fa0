//! Every kernel, and the yardsticks: what `ashfall bench kernels` measures.

mod common;

use ashfall::bench::{kernels, yardstick};

fn main() -> common::Outcome<()> {
    common::run("kernels", |bench| {
        kernels::run(bench)?;
        for ratio in yardstick::run(bench)? {
            println!("{}", ratio.line());
        }
        Ok(())
    })
}
