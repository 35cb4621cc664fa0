//! Device of a command: opening, checking, drawing.

use super::args::DeviceArgs;
use crate::gpu::{Gpu, GpuOptions, Limits};
use crate::render::{Compatibility, Evaluator, Model, Outputs, RenderOptions, RenderedImage, Renderer, ViewOptions};
use crate::scene::{Camera, Dataset, ScreenFilter, Splats};
use crate::train::TrainConfig;
use crate::{Error, Result};

/// Opens the device that the options ask for, or else the environment.
pub(super) fn open(args: &DeviceArgs) -> Result<Gpu> {
    let is_set = |name: &String| !name.is_empty();
    let by_environment = || std::env::var("ASHFALL_DEVICE").ok().filter(is_set);
    Gpu::create(&GpuOptions {
        device: args.device.clone().or_else(by_environment),
        validation: args.validate,
        memory_limit: args.memory_limit,
        pipeline_cache: Vec::new(),
        faults: None,
        limits: Limits {
            binding: args.limit_binding,
            workgroup: args.limit_workgroup,
            without_subgroups: args.without_subgroups,
        },
    })
}

/// Error with the first validation message, if there is one.
pub(super) fn check(gpu: &Gpu) -> Result<()> {
    gpu.wait_idle()?;
    let messages = gpu.validation_messages();
    match messages.as_slice() {
        [] => Ok(()),
        [first, ..] => Err(Error::Config(format!(
            "the validation layer has {} messages; the first: {first}",
            messages.len()
        ))),
    }
}

/// Uploads a scene; the function returned draws a view over a background. `near` is the near plane in world units.
pub(super) fn scene_renderer(
    gpu: &Gpu,
    splats: &Splats,
    near: f64,
    outputs: Outputs,
    compatibility: Compatibility,
) -> Result<impl FnMut(&Camera, [f32; 3]) -> Result<RenderedImage>> {
    let options = RenderOptions {
        with_depth: outputs.depth,
        with_surface: outputs.surface,
        compatibility,
        ..RenderOptions::default()
    };
    renderer_with(gpu, splats, near, options)
}

/// As [`scene_renderer`], with options; degree of the harmonics and kind are those of the scene.
pub(super) fn renderer_with(
    gpu: &Gpu,
    splats: &Splats,
    near: f64,
    options: RenderOptions,
) -> Result<impl FnMut(&Camera, [f32; 3]) -> Result<RenderedImage>> {
    let options = RenderOptions {
        sh_degree: splats.sh_degree,
        primitive: splats.primitive,
        ..options
    };
    let mut renderer = Renderer::new(gpu, options)?;
    let model = Model::upload(gpu, splats)?;
    let (near, filter) = (near as f32, splats.filter);
    Ok(move |camera: &Camera, background| {
        let view = ViewOptions {
            background,
            near,
            filter,
        };
        renderer.render(&model, camera, &view)
    })
}

/// Evaluator of some of a data set's views.
pub(super) fn evaluator<'d>(gpu: &Gpu, dataset: &'d Dataset, views: &[usize], background: [f32; 3]) -> Evaluator<'d> {
    Evaluator::new(
        gpu,
        dataset,
        views,
        view_options(dataset, background, ScreenFilter::Classic),
    )
}

/// Drawing of a data set's views as in training.
pub(super) fn view_options(dataset: &Dataset, background: [f32; 3], filter: ScreenFilter) -> ViewOptions {
    ViewOptions {
        background,
        near: near(dataset) as f32,
        filter,
    }
}

/// The near plane of a data set's views in world units, as in training.
pub(super) fn near(dataset: &Dataset) -> f64 {
    dataset.extent() * f64::from(TrainConfig::default().near_factor)
}
