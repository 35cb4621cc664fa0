//! `ashfall bench train`: whole training steps by splat count, on the photographs of a data set.
//!
//! Steps are those of a run: loss with D-SSIM, Adam, all SH degrees, surfels with their term of normals, two steps in
//! flight, and a wait at the end of each part of the run; without refinement, so that the splat count is constant.
//! Processor time is that of the whole process, user and system, over these steps.

use super::CpuClock;
use super::budget::{PublishedLimits, StepBudget, StepLoad};
use super::frame::{Scaling, case, exponents, note_memory, point};
use super::input::volume;
use super::row::BenchRow;
use super::session::{Bench, Times};
use crate::layout::COLOR_STEPS;
use crate::scene::{Dataset, Primitive, Splats, Split};
use crate::stats::mean;
use crate::train::{HostState, StepReport, TrainConfig, Trainer, initial_splats, schedule};
use crate::{Error, Result};
use serde::Serialize;
use std::time::Instant;

/// Default splat counts.
pub const SPLATS: [usize; 2] = [50_000, 200_000];

/// Sizes and lengths to measure.
#[derive(Clone, Debug)]
pub struct TrainPlan {
    /// Splat counts.
    pub splats: Vec<usize>,
    /// Counted steps, in as many parts as there are runs.
    pub steps: u32,
    /// Warm-up steps, in which shaders are compiled and opacities settle.
    pub warm_up: u32,
    /// SH degree.
    pub sh_degree: u32,
    /// Kind of splats from the data set's points.
    pub kind: Primitive,
    /// Initial scene in place of the data set's points, of its own kind; sampled to each splat count.
    pub scene: Option<Splats>,
    /// Devices whose least times are computed.
    pub budgets: Vec<PublishedLimits>,
}

/// Groups of steps timed by stage, one step at a time.
const STAGED: usize = 3;

/// Device memory of one splat count.
#[derive(Clone, Debug, Serialize)]
pub struct TrainMemory {
    /// Splats.
    pub splats: usize,
    /// Peak of the buffers' bytes.
    pub peak_bytes: u64,
    /// Bytes by the formula.
    pub predicted_bytes: u64,
    /// Parameters, moments, photographs and lists alone.
    pub essential_bytes: u64,
}

/// Measurements of training steps.
#[derive(Clone, Debug, Default)]
pub struct StepCosts {
    /// Times by splat count.
    pub scaling: Scaling,
    /// Device memory by splat count.
    pub memory: Vec<TrainMemory>,
    /// Least times of the stages, by splat count and device.
    pub budgets: Vec<StepBudget>,
}

/// Measures.
///
/// # Errors
/// Those of the data set and of Vulkan, and budgets of surfels; a scene too large for the device is a point with a
/// fault.
pub fn run(bench: &mut Bench, dataset: &Dataset, plan: &TrainPlan) -> Result<StepCosts> {
    let mut costs = StepCosts::default();
    let views = dataset.split(Split::Train);
    let sizes = views.iter().map(|&view| {
        let camera = &dataset.views[view].camera;
        [camera.width, camera.height]
    });
    let size = sizes.max_by_key(|s| s[0] * s[1]).unwrap_or([1, 1]);
    let config = config(plan);
    if config.kind == Primitive::Surfel && !plan.budgets.is_empty() {
        return Err(Error::Config("--budget knows steps of 3D Gaussians alone".into()));
    }
    let first = match &plan.scene {
        Some(scene) => scene.clone(),
        None => initial_splats(dataset, dataset.extent(), &config)?,
    };
    for &count in &plan.splats {
        if !bench.wants(&case(task(config.kind), count, size)) {
            continue;
        }
        let splats = volume::exactly(&first, count, 1);
        let measured = steps(bench, dataset, (&config, plan), (&splats, size));
        let measured = measured.map(|(row, memory, budgets)| {
            costs.memory.push(memory);
            costs.budgets.extend(budgets);
            row
        });
        let point = point(count, size, measured, |row| note_memory(bench, row))?;
        costs.scaling.points.push(point);
    }
    costs.scaling.exponents = exponents(&costs.scaling.points);
    Ok(costs)
}

/// Name of a step's rows.
fn task(kind: Primitive) -> &'static str {
    match kind {
        Primitive::Gaussian3d => "step",
        Primitive::Surfel => "surfel_step",
    }
}

/// Constants of a long run without refinement, and with its terms of geometry from the first step on.
fn config(plan: &TrainPlan) -> TrainConfig {
    let mut config = TrainConfig::for_iterations(30_000).with_kind(plan.kind);
    if let Some(scene) = &plan.scene {
        config = config.with_kind(scene.primitive);
        config.filter = scene.filter;
    }
    config.geometry.normal_from = 0.0;
    config.sh_degree = plan.sh_degree;
    config.sh_degree_from = [0; 3];
    config.refine.from = config.iterations;
    config.refine.until = config.iterations;
    config.adc.opacity_reset_every = 0;
    config
}

fn steps(
    bench: &mut Bench,
    dataset: &Dataset,
    (config, plan): (&TrainConfig, &TrainPlan),
    (splats, size): (&Splats, [u32; 2]),
) -> Result<(BenchRow, TrainMemory, Vec<StepBudget>)> {
    let gpu = bench.gpu().clone();
    gpu.reset_memory_peak();
    let state = HostState::from_splats(splats, plan.sh_degree);
    let mut trainer = Trainer::from_state(&gpu, dataset, config.clone(), &state, 0)?;
    train_to(&mut trainer, plan.warm_up)?;
    let mut runs = Vec::new();
    let parts = (bench.options.runs as u32).clamp(1, plan.steps.max(1));
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
    let case = case(task(config.kind), splats.len(), size);
    let row = bench.keep(&case, &runs);
    let (mut staged, mut reports) = (Vec::new(), Vec::new());
    for _ in 0..STAGED {
        staged.push(mean_step(&mut trainer, &mut reports)?);
    }
    reports.extend(trainer.finish()?);
    let load = load(&reports, config, (splats, size));
    let budget = |limits: &PublishedLimits| StepBudget::new(*limits, load, &staged);
    let budgets = plan.budgets.iter().map(budget).collect();
    // The splats read back at the end of a run are part of the formula.
    drop(trainer.splats()?);
    let mut one_by_one = case;
    one_by_one.variant = "alone".into();
    bench.keep(&one_by_one, &staged);
    let formula = trainer.size();
    let memory = TrainMemory {
        splats: splats.len(),
        peak_bytes: gpu.memory_peak(),
        predicted_bytes: formula.bytes(),
        essential_bytes: formula.essential_bytes(),
    };
    Ok((row, memory, budgets))
}

/// Mean times by stage of as many steps as one update of the harmonics serves.
fn mean_step(trainer: &mut Trainer<'_>, reports: &mut Vec<StepReport>) -> Result<Times> {
    let mut stages: Vec<(&'static str, f64)> = Vec::new();
    for _ in 0..COLOR_STEPS {
        reports.extend(trainer.step()?);
        for (i, (label, ns)) in trainer.timings()?.into_iter().enumerate() {
            let share = ns / f64::from(COLOR_STEPS);
            match stages.get_mut(i) {
                Some((_, sum)) => *sum += share,
                None => stages.push((label, share)),
            }
        }
    }
    Ok(Times { stages, cpu_ns: None })
}

/// Work of the steps of these reports.
fn load(reports: &[StepReport], config: &TrainConfig, (splats, size): (&Splats, [u32; 2])) -> StepLoad {
    let average = |count: fn(&StepReport) -> usize| {
        let counts: Vec<f64> = reports.iter().map(|report| count(report) as f64).collect();
        mean(&counts)
    };
    StepLoad {
        splats: splats.len(),
        visible: average(|report| report.visible_count),
        isects: average(|report| report.isect_count),
        size,
        sh_degree: config.sh_degree,
        ssim_stride: schedule::window_stride(config),
    }
}

/// Trains up to an iteration, including steps repeated with larger buffers, and waits for the device.
fn train_to(trainer: &mut Trainer<'_>, iteration: u32) -> Result<()> {
    while trainer.iteration() < iteration {
        trainer.step()?;
    }
    trainer.finish().map(drop)
}
