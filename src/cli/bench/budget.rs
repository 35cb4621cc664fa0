//! Lines of least times by published limits.

use crate::cli::output::{bytes, grouped};
use crate::lab::bench::budget::{StageBudget, StepBudget};
use std::fmt::Display;

/// Lines of a budget: the device, a line per stage, and the sum.
pub(super) fn lines(budget: &StepBudget) -> Vec<String> {
    let (limits, step) = (&budget.limits, &budget.step);
    let head = format!(
        "least times on {} ({} GB/s, {} Tflop/s) with {} splats at {}x{}, {} of them visible, {} pairs with tiles:",
        limits.product,
        limits.bytes_per_s * 1e-9,
        limits.operations_per_s * 1e-12,
        grouped(step.splats),
        step.size[0],
        step.size[1],
        grouped(step.visible as usize),
        grouped(step.isects as usize),
    );
    let [least, measured] = budget.total_s();
    let sum = line("sum", [""; 2], (least, ""), measured);
    let stages = budget.stages.iter().map(stage_line);
    std::iter::once(head).chain(stages).chain([sum]).collect()
}

fn stage_line(stage: &StageBudget) -> String {
    let by = match stage.memory_s >= stage.arithmetic_s {
        true => "memory",
        false => "arithmetic",
    };
    let operations = match stage.load.operations > 0.0 {
        true => format!("{:.3} Gflop", 1e-9 * stage.load.operations),
        false => String::new(),
    };
    let work = [&bytes(stage.load.bytes as u64), &operations];
    line(stage.load.stage, work, (stage.least_s(), by), stage.measured_s)
}

/// A row of the table; times in seconds.
fn line<T: Display>(stage: &str, [bytes, operations]: [T; 2], (least, by): (f64, &str), measured: f64) -> String {
    let [least, measured] = [1e6 * least, 1e3 * measured];
    format!("  {stage:<18} {bytes:>10} {operations:>15} {least:>9.1} µs {by:<10} {measured:>9.3} ms here")
}
