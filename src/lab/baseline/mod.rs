//! What the engine is measured against, in one run and in turns: the baseline_16x16 design on the same device, and
//! renderers on the processor. All of them are held against the oracle before anything is timed.
//!
//! The input is always 480×272 pixels and 50,000 splats whose standard deviations are log-uniform from 1 to
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

/// Measures the contests that are asked for.
///
/// # Errors
/// Whoever is wrong, before anything is timed; anything that Vulkan reports.
pub fn run(bench: &mut Bench) -> Result<Vec<Ratio>> {
    let mut ratios = compositing::forward(bench)?;
    ratios.extend(compositing::backward(bench)?);
    ratios.extend(pairs::sort(bench)?);
    Ok(ratios)
}

/// Whether a device's work is the processor's, so that processor time measures it.
fn on_processor(bench: &Bench) -> bool {
    bench.gpu().caps().kind == DeviceKind::Cpu
}

/// What the compiler was allowed to use of the processor's vector units, as far as it matters here.
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

/// Whether that is what a build for the processor at hand would have: the vectorised renderer is a bar only then.
pub const NATIVE: bool = cfg!(any(target_feature = "avx2", target_feature = "neon"));
