//! Baselines, timed in turns with the engine: the 16×16 tile design on the same device, and renderers and a sort on
//! the processor. Every result is compared with the reference before it is timed.
//!
//! The input is always 480×272 pixels and 50,000 splats of standard deviations log-uniform from 1 to
//! 3 px; sorts take 2^20 random pairs of 32 bits each.

mod compositing;
mod pairs;
mod ratio;
pub mod scalar;
pub mod vector;

pub use ratio::Ratio;

use super::bench::session::{Bench, Case};
use super::bench::trial::Subject;
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

/// Measures in turns and compares; a pair is the name of an engine's kernel and the prefix of a baseline's name.
fn compare(bench: &mut Bench, what: &str, mut subjects: Vec<Subject<'_>>, pairs: &[[&str; 2]]) -> Result<Vec<Ratio>> {
    let runs = bench.measure_in_turns(&mut subjects)?;
    // A software device is measured by processor time.
    let by_processor = bench.gpu().caps().kind == DeviceKind::Cpu;
    let named = |name: &str| {
        let mut all = subjects.iter().zip(&runs);
        all.find(|(subject, _)| subject.case.variant.starts_with(name))
            .map(|(subject, times)| (subject.case.variant.as_str(), times.as_slice()))
    };
    let ratio = |&[ours, baseline]: &[&str; 2]| Some(Ratio::of(what, [named(ours)?, named(baseline)?], by_processor));
    Ok(pairs.iter().filter_map(ratio).collect())
}

fn case(what: &str, variant: &str) -> Case {
    Case::of("baseline", what, variant, 0)
}

/// True if the filter selects one of the variants; then all subjects of the comparison are measured.
fn is_wanted(bench: &mut Bench, what: &str, variants: &[&str]) -> bool {
    variants.iter().any(|variant| bench.wants(&case(what, variant)))
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
