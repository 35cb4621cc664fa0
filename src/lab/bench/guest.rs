//! `ashfall bench guest`: pictures recorded into a host's commands, each kind relative to a plain picture.

use super::CpuClock;
use super::frame::case;
use super::session::{Bench, Times};
use super::trial::{Subject, ratio_by_round};
use crate::gpu::{Frames, Gpu, HostImage, Image};
use crate::render::{Blend, DepthCode, HostDepth, HostTarget, Instance, Model, RenderOptions, Renderer, ViewOptions};
use crate::scene::{Camera, Splats};
use crate::stats::Summary;
use crate::{Error, Result};
use glam::DVec3;
use serde::Serialize;
use std::time::Instant;

/// A scene and the sizes to measure.
#[derive(Clone, Debug)]
pub struct GuestPlan {
    /// Splats of the plain picture.
    pub splats: Splats,
    /// Camera of the pictures.
    pub camera: Camera,
    /// Near plane, world units.
    pub near: f32,
    /// Instances that the splats are divided among.
    pub instances: usize,
}

/// Cost of a picture relative to a plain one.
#[derive(Clone, Debug, Serialize)]
pub struct GuestCost {
    /// Kind of the picture, the variant of its rows.
    pub variant: String,
    /// Wall time over that of the plain picture: the median of the ratios by round.
    pub ratio: f64,
    /// Its 95 % interval.
    pub interval: [f64; 2],
}

/// Content of a picture besides splats.
#[derive(Clone, Copy, Debug, Default)]
struct GuestKind {
    blend: Blend,
    /// Distance of a host's surface parallel to the image.
    surface: Option<f32>,
    instances: Option<usize>,
    eyes: usize,
}

/// Measures all kinds in turns.
///
/// # Errors
/// Those of Vulkan and memory.
pub fn run(bench: &mut Bench, plan: &GuestPlan) -> Result<Vec<GuestCost>> {
    let gpu = bench.gpu().clone();
    let plain = GuestKind {
        eyes: 1,
        ..GuestKind::default()
    };
    let behind = |surface: f32| GuestKind {
        surface: Some(surface),
        ..plain
    };
    let over_display = GuestKind {
        blend: Blend::OverDisplay,
        ..plain
    };
    let instances = GuestKind {
        instances: Some(plan.instances),
        ..plain
    };
    let kinds = [
        ("plain".to_owned(), plain),
        ("display".to_owned(), over_display),
        ("depth/none".to_owned(), behind(f32::INFINITY)),
        ("depth/half".to_owned(), behind(median_depth(plan))),
        (format!("instances/{}", plan.instances), instances),
        ("eyes/2".to_owned(), GuestKind { eyes: 2, ..plain }),
    ];
    let (splats, size) = (plan.splats.len(), [plan.camera.width, plan.camera.height]);
    let mut guests = Vec::new();
    for (name, kind) in kinds {
        let mut case = case("guest", splats, size);
        case.variant = name;
        if bench.wants(&case) || case.variant == "plain" {
            guests.push((case, Guest::new(&gpu, plan, kind)?));
        }
    }
    let mut subjects: Vec<Subject<'_>> = guests
        .iter_mut()
        .map(|(case, guest)| Subject {
            case: case.clone(),
            run: Box::new(|| guest.draw()),
        })
        .collect();
    let runs = bench.measure_in_turns(&mut subjects)?;
    let others = subjects.iter().zip(&runs).skip(1);
    let costs = others.map(|(subject, other)| {
        let summary = ratio_by_round(other, &runs[0]);
        GuestCost {
            variant: subject.case.variant.clone(),
            ratio: summary.median,
            interval: summary.interval,
        }
    });
    Ok(costs.collect())
}

/// Median depth of the splats whose means are in the image.
fn median_depth(plan: &GuestPlan) -> f32 {
    let depth = |mean: &[f32; 3]| {
        let mean = DVec3::from(mean.map(f64::from));
        let depth = plan.camera.view_from_world(mean).z;
        (depth > f64::from(plan.near) && plan.camera.sees(mean)).then_some(depth)
    };
    let seen = plan.splats.mean.iter().filter_map(depth);
    Summary::of(&seen.collect::<Vec<f64>>()).median as f32
}

/// The models in their own places.
fn instances_of<'a>(models: &'a [Model], view: &ViewOptions) -> Vec<Instance<'a>> {
    let instance = |model: &'a Model| Instance {
        filter: view.filter,
        ..Instance::new(model)
    };
    models.iter().map(instance).collect()
}

/// A renderer in a host's commands, with models and images.
struct Guest {
    renderer: Renderer,
    models: Vec<Model>,
    is_instanced: bool,
    cameras: Vec<Camera>,
    view: ViewOptions,
    blend: Blend,
    color: Image,
    depth: Option<Image>,
    frames: Frames,
}

impl Guest {
    fn new(gpu: &Gpu, plan: &GuestPlan, kind: GuestKind) -> Result<Guest> {
        let (splats, camera) = (&plan.splats, &plan.camera);
        let options = RenderOptions {
            sh_degree: splats.sh_degree,
            primitive: splats.primitive,
            with_host_depth: kind.surface.is_some(),
            with_host_color: kind.blend != Blend::Replace,
            frames_in_flight: 1,
            ..RenderOptions::default()
        };
        let size = [camera.width, camera.height];
        let (color, mut depth) = (gpu.image("color", size)?, None);
        gpu.run(|rec| rec.clear(&color, 0.5))?;
        if let Some(surface) = kind.surface {
            let image = depth.insert(gpu.image("depth", size)?);
            gpu.run(|rec| rec.clear(image, surface))?;
        }
        let count = splats.len();
        let parts = kind.instances.unwrap_or(1);
        let part = |at: usize| {
            let rows: Vec<usize> = (at * count / parts..(at + 1) * count / parts).collect();
            Model::upload(gpu, &splats.picked(&rows))
        };
        // A baseline of 1/50 of the image's width, in world units at distance 1.
        let baseline = 0.02 * f64::from(camera.width) / camera.focal.x;
        let eye = |at: usize| Camera {
            position: camera.position + at as f64 * baseline * camera.rotation.row(0),
            ..*camera
        };
        let mut guest = Guest {
            renderer: Renderer::new(gpu, options)?,
            models: (0..parts).map(part).collect::<Result<_>>()?,
            is_instanced: kind.instances.is_some(),
            cameras: (0..kind.eyes).map(eye).collect(),
            view: ViewOptions {
                background: [0.0; 3],
                near: plan.near,
                filter: splats.filter,
            },
            blend: kind.blend,
            color,
            depth,
            frames: Frames::new(gpu, 1, false)?,
        };
        guest.reserve()?;
        Ok(guest)
    }

    /// Grows the buffers until every picture fits.
    fn reserve(&mut self) -> Result<()> {
        let instances = instances_of(&self.models, &self.view);
        for camera in &self.cameras {
            match self.is_instanced {
                true => self.renderer.render_instances(&instances, camera, &self.view)?,
                false => self.renderer.render(&self.models[0], camera, &self.view)?,
            };
        }
        Ok(())
    }

    /// A frame of the host: recorded, submitted and waited for.
    fn draw(&mut self) -> Result<Times> {
        let (clock, start) = (CpuClock::now(), Instant::now());
        let color = HostImage::of_own(&self.color);
        let depth = self.depth.as_ref().map(HostImage::of_own);
        let target = HostTarget {
            blend: self.blend,
            depth: depth.as_ref().map(|image| HostDepth {
                image,
                code: DepthCode::DISTANCE,
            }),
            ..HostTarget::from(&color)
        };
        let instances = instances_of(&self.models, &self.view);
        let (renderer, view) = (&mut self.renderer, &self.view);
        let (ticket, stats) = self.frames.submit(|rec| {
            let mut commands = rec.as_host();
            let mut stats = None;
            for camera in &self.cameras {
                let finished = match self.is_instanced {
                    true => renderer.record_instances(&mut commands, &instances, camera, view, target)?,
                    false => renderer.record(&mut commands, &self.models[0], camera, view, target)?,
                };
                stats = stats.or(finished);
            }
            Ok(stats)
        })?;
        self.frames.wait(ticket)?;
        match stats.is_none_or(|stats| stats.fits() && stats.complete) {
            true => Ok(Times {
                stages: vec![("frame", start.elapsed().as_nanos() as f64)],
                cpu_ns: clock.elapsed_ns(),
            }),
            false => Err(Error::Config("a picture of the bench exceeds its buffers".into())),
        }
    }
}
