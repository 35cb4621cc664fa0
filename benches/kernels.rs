//! Every kernel, and the baselines: the measurements of `ashfall bench kernels`.

mod common;

use ashfall::lab::baseline;
use ashfall::lab::bench::kernels;

fn main() -> common::Outcome<()> {
    common::run("kernels", |bench| {
        kernels::run(bench)?;
        for ratio in baseline::run(bench)? {
            println!("{}", ratio.line());
        }
        Ok(())
    })
}
