//! `ashfall bench train`: whole training steps by number of splats, on the photographs of a data set.
//!
//! Steps are those of a run: loss with D-SSIM, Adam, all harmonics, two steps in flight, no waiting but at the end
//! of each part into which they are divided for the median; refinement is left out, so that the number of splats stays what it is. Processor time is that of
//! the whole process, user and system, over these steps.

use super::CpuClock;
use super::frame::{Growth, Point, case, exponents, note_memory, point};
use super::input::volume;
use super::row::Row;
use super::session::{Bench, Times};
use crate::Result;
use crate::scene::{Dataset, Splats, Split};
use crate::train::{HostState, TrainConfig, Trainer, initial_splats};
use serde::Serialize;
use std::time::Instant;

/// Numbers of splats by default: those that bars are set for.
pub const SPLATS: [usize; 2] = [50_000, 200_000];

/// What is measured.
#[derive(Clone, Debug)]
pub struct TrainPlan {
    /// Numbers of splats.
    pub splats: Vec<usize>,
    /// Steps that count, in as many parts as there are runs.
    pub steps: u32,
    /// Steps before them: shaders are compiled, opacities settle.
    pub warm_up: u32,
    /// Degree of the harmonics.
    pub sh_degree: u32,
    /// A scene to begin with in place of the data set's points; sampled to each number of splats.
    pub scene: Option<Splats>,
}

/// Steps whose stages are looked at, one at a time.
const STAGED: usize = 5;

/// What one number of splats came to, beside its times.
#[derive(Clone, Debug, Serialize)]
pub struct Memory {
    /// Splats.
    pub splats: usize,
    /// Most bytes that buffers held at one time.
    pub peak_bytes: u64,
    /// What the formula says.
    pub predicted_bytes: u64,
    /// Parameters, moments, photographs and lists alone.
    pub essential_bytes: u64,
}

/// What is demanded of steps at 270×480 with harmonics of degree 3, CPU-seconds by splats; of wall time 0.6 of it.
const BARS: [(usize, f64); 2] = [(50_000, 0.20), (200_000, 0.45)];

/// CPU-seconds that a step may take, where that is demanded of such a step.
pub fn bar(point: &Point, sh_degree: u32) -> Option<f64> {
    let pixels = point.size[0] * point.size[1];
    let bar = BARS.iter().find(|(splats, _)| *splats == point.splats);
    bar.filter(|_| pixels == 270 * 480 && sh_degree == 3)
        .map(|(_, seconds)| *seconds)
}

/// Measures.
///
/// # Errors
/// What the data set or Vulkan report, but for scenes that the device cannot hold: those are points with a fault.
pub fn run(
    bench: &mut Bench,
    dataset: &Dataset,
    plan: &TrainPlan,
) -> Result<(Growth, Vec<Memory>)> {
    let (mut growth, mut memories) = (Growth::default(), Vec::new());
    let views = dataset.split(Split::Train);
    let sizes = views.iter().map(|&view| {
        let camera = &dataset.views[view].camera;
        [camera.width, camera.height]
    });
    let size = sizes.max_by_key(|s| s[0] * s[1]).unwrap_or([1, 1]);
    let config = config(plan);
    let first = match &plan.scene {
        Some(scene) => scene.clone(),
        None => initial_splats(dataset, dataset.extent(), &config)?,
    };
    for &count in &plan.splats {
        if !bench.wants(&case("step", count, size)) {
            continue;
        }
        let splats = volume::exactly(&first, count, 1);
        let measured = steps(bench, dataset, (&config, plan), (&splats, size));
        let measured = measured.map(|(row, memory, by_name)| {
            memories.push(memory);
            (row, by_name)
        });
        growth.points.push(point(count, size, measured)?);
    }
    growth.exponents = exponents(&growth.points);
    Ok((growth, memories))
}

/// A long run's constants without refinement.
fn config(plan: &TrainPlan) -> TrainConfig {
    let mut config = TrainConfig::for_iterations(30_000);
    config.sh_degree = plan.sh_degree;
    config.sh_degree_from = [0; 3];
    config.refine.from = config.iterations;
    config.refine.until = config.iterations;
    config.adc.opacity_reset_every = 0;
    config
}

type Measured = (Row, Memory, Vec<(String, u64)>);

fn steps(
    bench: &mut Bench,
    dataset: &Dataset,
    (config, plan): (&TrainConfig, &TrainPlan),
    (splats, size): (&Splats, [u32; 2]),
) -> Result<Measured> {
    let gpu = bench.gpu().clone();
    gpu.reset_memory_peak();
    let state = HostState::from_splats(splats, plan.sh_degree);
    let mut trainer = Trainer::from_state(&gpu, dataset, config.clone(), &state, 0)?;
    train_to(&mut trainer, plan.warm_up)?;
    let mut runs = Vec::new();
    let parts = (bench.options().runs as u32).clamp(1, plan.steps.max(1));
    let part = plan.steps.max(1).div_ceil(parts);
    for _ in 0..parts {
        let (clock, start) = (CpuClock::now(), Instant::now());
        let until = trainer.iteration() + part;
        train_to(&mut trainer, until)?;
        let each = 1.0 / f64::from(part);
        runs.push(Times {
            stages: vec![("step", start.elapsed().as_nanos() as f64 * each)],
            cpu_ns: clock.elapsed_ns().map(|ns| ns * each),
        });
    }
    let case = case("step", splats.len(), size);
    let row = bench.keep(&case, &runs);
    let mut staged = Vec::new();
    for _ in 0..STAGED {
        trainer.step()?;
        staged.push(Times::from(trainer.timings()?));
    }
    // What a run ends with, and the prediction counts.
    drop(trainer.splats()?);
    let mut one_by_one = case;
    one_by_one.variant = "alone".into();
    bench.keep(&one_by_one, &staged);
    let formula = trainer.size();
    let memory = Memory {
        splats: splats.len(),
        peak_bytes: gpu.memory_peak(),
        predicted_bytes: formula.bytes(),
        essential_bytes: formula.essential_bytes(),
    };
    let by_name = note_memory(bench, &row);
    Ok((row, memory, by_name))
}

/// Trains until so many steps are done, those that did not fit at first included, and waits for all.
fn train_to(trainer: &mut Trainer<'_>, iteration: u32) -> Result<()> {
    while trainer.iteration() < iteration {
        trainer.step()?;
    }
    trainer.finish().map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_are_for_what_they_were_set_for() {
        let point = |splats, size| Point {
            splats,
            size,
            wall_s: None,
            processor_s: None,
            memory: Vec::new(),
            fault: None,
        };
        assert_eq!(bar(&point(50_000, [270, 480]), 3), Some(0.2));
        assert_eq!(bar(&point(200_000, [480, 270]), 3), Some(0.45));
        assert_eq!(bar(&point(50_000, [480, 480]), 3), None);
        assert_eq!(bar(&point(50_001, [270, 480]), 3), None);
        assert_eq!(bar(&point(50_000, [270, 480]), 1), None);
    }
}
