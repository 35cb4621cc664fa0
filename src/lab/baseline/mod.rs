//! Baselines, timed in turns with the engine: the 16×16 tile design on the same device, and renderers and a sort on
//! the processor. Every result is compared with the reference before it is timed.
//!
//! The input is always 480×272 pixels and 50,000 splats of standard deviations log-uniform from 1 to
//! 3 px; sorts take 2^20 random pairs of 32 bits each.

mod compositing;
mod pairs;
mod ratio;
mod report;
pub mod scalar;
pub mod vector;

pub use ratio::Ratio;
pub use report::KernelReport;

use super::bench::session::Bench;
use crate::Result;
use crate::gpu::DeviceKind;

/// Measures the comparisons that the filter selects.
///
/// # Errors
/// A wrong result, before it is timed; errors of Vulkan.
pub fn run(bench: &mut Bench) -> Result<Vec<Ratio>> {
    let mut ratios = compositing::forward(bench)?;
    ratios.extend(compositing::backward(bench)?);
    ratios.extend(pairs::sort(bench)?);
    Ok(ratios)
}

/// True for a software device, measured by processor time.
fn on_processor(bench: &Bench) -> bool {
    bench.gpu().caps().kind == DeviceKind::Cpu
}

/// Vector instructions that the compiler was allowed to use.
pub const TARGET_FEATURES: &str = if cfg!(target_feature = "avx512f") {
    "avx512f"
} else if cfg!(all(target_feature = "avx2", target_feature = "fma")) {
    "avx2+fma"
} else if cfg!(target_feature = "avx") {
    "avx"
} else if cfg!(target_feature = "sse2") {
    "sse2"
} else if cfg!(target_feature = "neon") {
    "neon"
} else {
    "no vectors"
};
