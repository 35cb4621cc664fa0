//! Command line and record file of the benches; the measurements are in `ashfall::lab::bench`.

use ashfall::gpu::{Gpu, GpuOptions};
use ashfall::lab::bench::{Bench, BenchOptions, record};
use clap::Parser;
use std::error::Error;
use std::path::Path;

pub(crate) type Outcome<T> = Result<T, Box<dyn Error>>;

/// Measures the engine on one device.
#[derive(Parser)]
struct Arguments {
    /// Only cases with this text in their name
    filter: Option<String>,
    /// Counted runs of each case
    #[arg(long, default_value_t = BenchOptions::default().runs)]
    runs: usize,
    /// Index or part of the name of the device
    #[arg(long)]
    device: Option<String>,
    /// Write benches/record/<device>/<date>.csv, keeping the rows of other benches
    #[arg(long)]
    record: bool,
    /// Flag that `cargo bench` passes to every bench; ignored
    #[arg(long, hide = true)]
    bench: bool,
}

/// Reads the command line, opens the device, runs the measurements, and writes the record if requested.
pub(crate) fn run(name: &'static str, measure: impl FnOnce(&mut Bench) -> Outcome<()>) -> Outcome<()> {
    let arguments = Arguments::parse();
    let gpu = Gpu::create(&GpuOptions {
        device: arguments.device,
        ..GpuOptions::default()
    })?;
    println!("{}, {}", gpu.caps().name, gpu.caps().driver);
    let options = BenchOptions {
        filter: arguments.filter,
        runs: arguments.runs,
        ..BenchOptions::default()
    };
    let mut bench = Bench::new(name, &gpu, options, |row| println!("{}", row.line()))?;
    measure(&mut bench)?;
    if arguments.record {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/record");
        let path = record::write(&folder, &gpu.caps().name, &bench.rows)?;
        println!("{}", path.display());
    }
    Ok(())
}
