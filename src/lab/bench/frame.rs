//! `ashfall bench frame`: whole frames by splat count and image size, stage by stage, with the memory of every
//! buffer, and the exponents of their scaling.
//!
//! A frame is [`Renderer::render`]: recorded, submitted, waited for and read back. Its stages are the device's by
//! timestamps, and `host` is the rest of the wall time: recording, submitting, copying the image.

use super::CpuClock;
use super::growth::Exponent;
use super::input::volume;
use super::row::{BenchRow, Work};
use super::session::{Bench, Case, Times};
use super::trial::{Subject, ratio_by_round};
use crate::gpu::Gpu;
use crate::render::{Model, RenderOptions, Renderer, ViewOptions};
use crate::scene::{Camera, Splats};
use crate::{Error, Result};
use serde::Serialize;
use std::collections::BTreeSet;
use std::time::Instant;

/// Default splat counts, neighbours at most 2.5 times apart.
pub const SPLATS: [usize; 9] = [
    10_000, 20_000, 50_000, 100_000, 200_000, 500_000, 1_000_000, 2_000_000, 4_000_000,
];
/// Default image sizes, four times the pixels from one to the next.
pub const SIZES: [[u32; 2]; 4] = [[480, 270], [960, 540], [1920, 1080], [3840, 2160]];

/// Near plane of made scenes, world units.
pub const NEAR: f32 = 0.01;

/// Sizes to measure.
#[derive(Clone, Debug)]
pub struct FramePlan {
    /// Splat counts.
    pub splats: Vec<usize>,
    /// Image sizes.
    pub sizes: Vec<[u32; 2]>,
    /// SH degree of the made scene.
    pub sh_degree: u32,
    /// Scene in place of the made one, sampled to each splat count, with its camera and near plane in world units.
    /// Without it, a comparison with one splat that covers the whole image is added, among the most splats measured.
    pub scene: Option<(Splats, Camera, f32)>,
}

impl FramePlan {
    fn splats_for(&self, count: usize, aspect: f64) -> Splats {
        match &self.scene {
            Some((scene, ..)) => volume::exactly(scene, count, 1),
            None => volume::splats(count, self.sh_degree, aspect, 1),
        }
    }

    fn camera_for(&self, [width, height]: [u32; 2]) -> Camera {
        match &self.scene {
            Some((_, camera, _)) => camera.resized(width, height),
            None => volume::camera([width, height]),
        }
    }
}

/// Times and memory at one splat count and image size.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ScalingPoint {
    /// Splat count.
    pub splats: usize,
    /// Width and height of the image, pixels.
    pub size: [u32; 2],
    /// Median wall time of a frame or a step, s; `None`: the device cannot hold the scene.
    pub wall_s: Option<f64>,
    /// Median processor time of the process in user and system mode, s.
    pub processor_s: Option<f64>,
    /// Bytes of each buffer at the peak of their sum, by name.
    pub memory: Vec<(String, u64)>,
    /// Error of a scene that the device cannot hold.
    pub fault: Option<String>,
}

/// Cost of one splat that covers the whole image among many others.
#[derive(Clone, Debug, Serialize)]
pub struct GiantSplat {
    /// Count of the others.
    pub splats: usize,
    /// Width and height of the image, pixels.
    pub size: [u32; 2],
    /// Wall time of a frame with it over that of one without: the median of the ratios by round.
    pub ratio: f64,
    /// Its 95 % interval.
    pub interval: [f64; 2],
}

/// Times and memory by size.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Scaling {
    /// All points of the plan, including those that the device cannot hold.
    pub points: Vec<ScalingPoint>,
    /// Times as powers of splat and pixel counts.
    pub exponents: Vec<Exponent>,
    /// Cost of one splat that covers the whole image.
    pub giant: Option<GiantSplat>,
}

/// Most splats beside the giant one.
const GIANT_SPLATS: usize = 1_000_000;

/// Measures.
///
/// # Errors
/// Those of Vulkan; a scene too large for the device is a point with a fault.
pub fn run(bench: &mut Bench, plan: &FramePlan) -> Result<Scaling> {
    let mut scaling = Scaling::default();
    for &count in &plan.splats {
        // The synthetic scene depends on the image's aspect alone.
        let mut made: Option<(f64, Splats)> = None;
        for &size in &plan.sizes {
            let case = case("frame", count, size);
            if !bench.wants(&case) {
                continue;
            }
            let aspect = f64::from(size[1]) / f64::from(size[0]);
            let (_, splats) = match made.take_if(|made| made.0 == aspect) {
                Some(known) => made.insert(known),
                None => made.insert((aspect, plan.splats_for(count, aspect))),
            };
            let near = plan.scene.as_ref().map_or(NEAR, |(.., near)| *near);
            let measured = frames(bench, &case, (splats, near), &plan.camera_for(size));
            scaling
                .points
                .push(point(count, size, measured, |row| note_memory(bench, row))?);
        }
    }
    if plan.scene.is_none() {
        scaling.giant = giant(bench, plan, &scaling)?;
    }
    scaling.exponents = exponents(&scaling.points);
    Ok(scaling)
}

/// Case of a point, named by its sizes.
pub(super) fn case(task: &str, splats: usize, [width, height]: [u32; 2]) -> Case {
    let case = Case::of(task, format!("{splats}/{width}x{height}"), "", 0);
    case.doing(Work::of(splats, "splats"))
}

/// ScalingPoint of a row with its `memory`, or of the error if the device cannot hold the scene.
pub(super) fn point(
    splats: usize,
    size: [u32; 2],
    measured: Result<BenchRow>,
    memory: impl FnOnce(&BenchRow) -> Vec<(String, u64)>,
) -> Result<ScalingPoint> {
    let nothing = ScalingPoint {
        splats,
        size,
        ..ScalingPoint::default()
    };
    match measured {
        Ok(row) => Ok(ScalingPoint {
            wall_s: Some(1e-9 * row.median_ns),
            processor_s: Some(1e-9 * row.cpu_ns),
            memory: memory(&row),
            ..nothing
        }),
        Err(fault @ (Error::OutOfMemory { .. } | Error::Unsupported { .. })) => Ok(ScalingPoint {
            fault: Some(fault.to_string()),
            ..nothing
        }),
        Err(error) => Err(error),
    }
}

/// Bytes of each buffer at the peak, also as rows of the bench, `memory/<name>`.
pub(super) fn note_memory(bench: &mut Bench, total: &BenchRow) -> Vec<(String, u64)> {
    let by_name = bench.gpu().memory_by_name().into_iter();
    let peaks = by_name.map(|(name, memory)| (name, memory.peak_bytes));
    let memory: Vec<(String, u64)> = peaks.filter(|(_, bytes)| *bytes > 0).collect();
    bench.rows.extend(memory.iter().map(|(name, bytes)| BenchRow {
        bench: total.bench.clone(),
        input: total.input.clone(),
        stage: format!("memory/{name}"),
        bytes: *bytes,
        ..BenchRow::default()
    }));
    memory
}

fn frames(bench: &mut Bench, case: &Case, (splats, near): (&Splats, f32), camera: &Camera) -> Result<BenchRow> {
    let gpu = bench.gpu().clone();
    let mut frame_bench = FrameBench::new(&gpu, splats, near)?;
    // The peak of frames excludes the staging memory of the upload.
    gpu.reset_memory_peak();
    bench.measure(case, || frame_bench.draw(camera))
}

/// Scene on the device with its renderer.
struct FrameBench {
    renderer: Renderer,
    model: Model,
    view: ViewOptions,
}

impl FrameBench {
    fn new(gpu: &Gpu, splats: &Splats, near: f32) -> Result<FrameBench> {
        let options = RenderOptions {
            sh_degree: splats.sh_degree,
            primitive: splats.primitive,
            ..RenderOptions::default()
        };
        Ok(FrameBench {
            renderer: Renderer::new(gpu, options)?,
            model: Model::upload(gpu, splats)?,
            view: ViewOptions {
                background: [0.0; 3],
                near,
                filter: splats.filter,
            },
        })
    }

    fn draw(&mut self, camera: &Camera) -> Result<Times> {
        let (clock, start) = (CpuClock::now(), Instant::now());
        self.renderer.render(&self.model, camera, &self.view)?;
        let wall = start.elapsed().as_nanos() as f64;
        let mut stages = self.renderer.timings()?;
        let device: f64 = stages.iter().map(|(_, ns)| ns).sum();
        stages.push(("host", (wall - device).max(0.0)));
        Ok(Times {
            stages,
            cpu_ns: clock.elapsed_ns(),
        })
    }
}

/// Frames with and without the giant splat in turns, at the plan's first image size.
fn giant(bench: &mut Bench, plan: &FramePlan, scaling: &Scaling) -> Result<Option<GiantSplat>> {
    let measured = scaling.points.iter().filter(|point| point.fault.is_none());
    let most = measured.map(|point| point.splats.min(GIANT_SPLATS)).max();
    let (Some(splats), Some(&size)) = (most, plan.sizes.first()) else {
        return Ok(None);
    };
    if !bench.wants(&case("giant", splats, size)) {
        return Ok(None);
    }
    let aspect = f64::from(size[1]) / f64::from(size[0]);
    let (without, camera) = (volume::splats(splats, plan.sh_degree, aspect, 1), volume::camera(size));
    let gpu = bench.gpu().clone();
    let mut frame_benches = [
        FrameBench::new(&gpu, &without, NEAR)?,
        FrameBench::new(&gpu, &volume::with_giant(&without), NEAR)?,
    ];
    let mut subjects = Vec::new();
    for (name, frame_bench) in ["without", "with"].into_iter().zip(&mut frame_benches) {
        let mut case = case("giant", splats, size);
        case.variant = name.into();
        let run = Box::new(|| frame_bench.draw(&camera));
        subjects.push(Subject { case, run });
    }
    let runs = bench.measure_in_turns(&mut subjects)?;
    let summary = ratio_by_round(&runs[1], &runs[0]);
    Ok(Some(GiantSplat {
        splats,
        size,
        ratio: summary.median,
        interval: summary.interval,
    }))
}

/// Exponents over splats at every image size and over pixels at every splat count, by wall and by processor time.
pub(super) fn exponents(points: &[ScalingPoint]) -> Vec<Exponent> {
    let sizes: BTreeSet<[u32; 2]> = points.iter().map(|point| point.size).collect();
    let counts: BTreeSet<usize> = points.iter().map(|point| point.splats).collect();
    let mut found = Vec::new();
    for by in ["clock", "processor"] {
        let time = |point: &ScalingPoint| match by {
            "clock" => point.wall_s,
            _ => point.processor_s,
        };
        let splats = |point: &ScalingPoint| Some((point.splats as f64, time(point)?));
        for &size in &sizes {
            let at = points.iter().filter(|point| point.size == size);
            let pairs: Vec<(f64, f64)> = at.filter_map(splats).collect();
            let name = format!("{}x{}", size[0], size[1]);
            found.extend(Exponent::of(["splats", by], name, &pairs));
        }
        let pixels = |point: &ScalingPoint| {
            let [width, height] = point.size.map(f64::from);
            Some((width * height, time(point)?))
        };
        for &count in &counts {
            let at = points.iter().filter(|point| point.splats == count);
            let pairs: Vec<(f64, f64)> = at.filter_map(pixels).collect();
            found.extend(Exponent::of(["pixels", by], format!("{count} splats"), &pairs));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponents_are_taken_along_either_axis() {
        let mut points = Vec::new();
        for splats in [1_000, 2_000, 4_000] {
            for size in [[10, 10], [20, 20], [40, 40]] {
                let pixels = f64::from(size[0] * size[1]);
                let wall = 1e-3 * (splats as f64).powf(0.8) * pixels.powf(0.5);
                points.push(ScalingPoint {
                    splats,
                    size,
                    wall_s: Some(wall),
                    ..ScalingPoint::default()
                });
            }
        }
        points[8].wall_s = None;
        let found = exponents(&points);
        assert_eq!(found.len(), 6);
        for exponent in found {
            let wanted = if exponent.over == "splats" { 0.8 } else { 0.5 };
            assert!((exponent.slope - wanted).abs() < 1e-9, "{exponent:?}");
        }
    }

    #[test]
    fn a_scene_too_large_for_the_device_is_a_point() {
        let error = || Error::OutOfMemory {
            name: "image".into(),
            wanted: 2,
            available: 1,
        };
        let point_of = |error| point(5, [1, 1], Err(error), |_| Vec::new()).map(|point| point.fault.is_some());
        assert!(matches!(point_of(error()), Ok(true)));
        assert!(point_of(Error::Config("bad".into())).is_err());
    }
}
