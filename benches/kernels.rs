//! Every kernel, and the baselines: what `ashfall bench kernels` measures.

mod common;

use ashfall::bench::{baseline, kernels};

fn main() -> common::Outcome<()> {
    common::run("kernels", |bench| {
        kernels::run(bench)?;
        for ratio in baseline::run(bench)? {
            println!("{}", ratio.line());
        }
        Ok(())
    })
}
