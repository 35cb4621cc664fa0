//! Device of a command: opening, description, rendering.

mod describe;

use super::args::DeviceArgs;
use crate::gpu::{DeviceKind, Gpu, GpuOptions, Limits};
use crate::render::{Compatibility, Model, RenderOptions, RenderedImage, Renderer, ViewOptions};
use crate::scene::{Camera, ScreenFilter, Splats};
use crate::{Error, Result};

pub(super) use describe::devices;

/// An opened device.
pub(super) struct Engine {
    gpu: Gpu,
}

impl Engine {
    /// Opens the device that the options ask for.
    pub(crate) fn open(args: &DeviceArgs) -> Result<Engine> {
        let options = GpuOptions {
            device: args.name(),
            validation: args.validate,
            memory_limit: args.memory_limit,
            faults: None,
            limits: Limits {
                binding: args.limit_binding,
                workgroup: args.limit_workgroup,
                without_subgroups: args.without_subgroups,
            },
        };
        let gpu = Gpu::create(&options)?;
        Ok(Engine { gpu })
    }

    /// Device for measurements.
    pub(crate) fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// The device's name.
    pub(crate) fn name(&self) -> &str {
        &self.gpu.caps().name
    }

    /// True for a CPU device.
    pub(crate) fn is_software(&self) -> bool {
        self.gpu.caps().kind == DeviceKind::Cpu
    }

    /// Limit of buffer memory in bytes.
    pub(crate) fn memory_limit(&self) -> u64 {
        self.gpu.memory_limit()
    }

    /// Peak of allocated device memory in bytes.
    pub(crate) fn memory_peak_bytes(&self) -> u64 {
        self.gpu.memory_peak()
    }

    /// Error with the first validation message, if there is one.
    pub(crate) fn check(&self) -> Result<()> {
        self.gpu.wait_idle()?;
        let messages = self.gpu.validation_messages();
        match messages.as_slice() {
            [] => Ok(()),
            [first, ..] => Err(Error::Config(format!(
                "the validation layer has {} messages; the first: {first}",
                messages.len()
            ))),
        }
    }

    /// Device capabilities and chosen kernel variants as text and as JSON.
    pub(crate) fn describe(&self) -> (String, serde_json::Value) {
        describe::chosen(self.gpu.caps(), self.gpu.memory_limit())
    }

    /// Uploads a scene for rendering; `near` is the near plane in world units.
    pub(crate) fn scene_renderer(&self, splats: &Splats, near: f64, with_depth: bool) -> Result<SceneRenderer> {
        self.scene_renderer_with(splats, near, with_depth, Compatibility::Engine)
    }

    /// [`Engine::scene_renderer`] with the rasterization rules of `compatibility`.
    pub(crate) fn scene_renderer_with(
        &self,
        splats: &Splats,
        near: f64,
        with_depth: bool,
        compatibility: Compatibility,
    ) -> Result<SceneRenderer> {
        let options = RenderOptions {
            with_depth,
            compatibility,
            sh_degree: splats.sh_degree,
            ..RenderOptions::default()
        };
        Ok(SceneRenderer {
            renderer: Renderer::new(&self.gpu, options)?,
            model: Model::upload(&self.gpu, splats)?,
            near: near as f32,
            filter: splats.filter,
        })
    }
}

/// Scene on the device with its renderer.
pub(super) struct SceneRenderer {
    renderer: Renderer,
    model: Model,
    near: f32,
    filter: ScreenFilter,
}

impl SceneRenderer {
    /// Draws a view.
    pub(crate) fn draw(&mut self, camera: &Camera, background: [f32; 3]) -> Result<RenderedImage> {
        let view = ViewOptions {
            background,
            near: self.near,
            filter: self.filter,
        };
        self.renderer.render(&self.model, camera, &view)
    }
}
