//! Least times of a training step's stages on a device, by its published limits.
//!
//! A stage takes at least its bytes at the rate of the memory, and its operations at the rate of single precision,
//! whichever is longer. Bytes count every array of a kernel once per pass. Left out are caches (a scene that fits them
//! is faster), latency, gaps between dispatches, integer operations, and the transfer of photographs. Operations are
//! those of the stages with more than a few per byte: fused multiply-adds count as two, comparisons, exponentials and
//! quotients as one.

mod limits;
mod load;

pub use limits::{PUBLISHED, PublishedLimits};
pub use load::{StageLoad, StepLoad};

use super::session::Times;
use crate::stats::Summary;
use serde::Serialize;

/// Least time of a stage beside the measured one.
#[derive(Clone, Debug, Serialize)]
pub struct StageBudget {
    /// Work of the stage.
    #[serde(flatten)]
    pub load: StageLoad,
    /// Least time of the bytes, s.
    pub memory_s: f64,
    /// Least time of the operations, s.
    pub arithmetic_s: f64,
    /// Median time on the device of the run, s.
    pub measured_s: f64,
}

impl StageBudget {
    /// Least time, s.
    pub fn least_s(&self) -> f64 {
        self.memory_s.max(self.arithmetic_s)
    }
}

/// Least times of a step's stages.
#[derive(Clone, Debug, Serialize)]
pub struct StepBudget {
    /// The device.
    pub limits: PublishedLimits,
    /// Work of the step.
    pub step: StepLoad,
    /// Stages in order.
    pub stages: Vec<StageBudget>,
}

impl StepBudget {
    /// Budget of steps with this load on a device; `runs` are the times of single ones on the device of the run.
    pub fn new(limits: PublishedLimits, step: StepLoad, runs: &[Times]) -> StepBudget {
        let stages = step.stages().into_iter().map(|load| StageBudget {
            memory_s: load.bytes / limits.bytes_per_s,
            arithmetic_s: load.operations / limits.operations_per_s,
            measured_s: 1e-9 * median_ns(runs, load.stage),
            load,
        });
        StepBudget {
            limits,
            step,
            stages: stages.collect(),
        }
    }

    /// Sums of least and measured times, s.
    pub fn total_s(&self) -> [f64; 2] {
        let stages = &self.stages;
        [
            stages.iter().map(StageBudget::least_s).sum(),
            stages.iter().map(|stage| stage.measured_s).sum(),
        ]
    }
}

fn median_ns(runs: &[Times], stage: &str) -> f64 {
    let times = runs.iter().flat_map(|run| &run.stages);
    let times: Vec<f64> = times.filter(|(label, _)| *label == stage).map(|(_, ns)| *ns).collect();
    if times.is_empty() {
        0.0
    } else {
        Summary::of(&times).median
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_takes_the_longer_of_bytes_and_operations() {
        let step = StepLoad {
            splats: 1_000_000,
            visible: 700_000.0,
            isects: 6e6,
            size: [1600, 1000],
            sh_degree: 3,
            ssim_stride: 1,
        };
        let limits = PUBLISHED[0];
        let run = |ns: f64| Times {
            stages: vec![("adam", ns), ("upload", 5.0)],
            cpu_ns: None,
        };
        let budget = StepBudget::new(limits, step, &[run(3.0), run(1.0), run(2.0)]);
        let stage = |name: &str| budget.stages.iter().find(|stage| stage.load.stage == name).unwrap();
        let adam = stage("adam");
        // Each of 15 planes with both moments, read and written; five planes of gradients.
        assert_eq!(adam.load.bytes, 1e6 * (6.0 * 6.0 * 16.0 + 4.0 * 16.0 + 24.0));
        assert_eq!(adam.least_s(), adam.memory_s);
        assert_eq!(adam.measured_s, 2e-9);
        let forward = stage("rasterize");
        assert_eq!(forward.least_s(), forward.arithmetic_s);
        assert_eq!(forward.measured_s, 0.0);
        let [least, measured] = budget.total_s();
        assert!(least > adam.least_s() + forward.least_s());
        assert_eq!(measured, 2e-9);
    }
}
