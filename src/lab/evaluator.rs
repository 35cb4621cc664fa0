//! Evaluators of training runs, and frame times of held-out views.

use super::bench::CpuClock;
use crate::gpu::Gpu;
use crate::render::{Evaluator, Model, RenderOptions, Renderer, ViewOptions};
use crate::scene::{Dataset, ScreenFilter, Splats, Split};
use crate::stats::Summary;
use crate::train::TrainConfig;
use crate::{Error, Result};

/// Background of renderings, and of photographs with alpha.
pub(super) const BACKGROUND: [f32; 3] = [0.0; 3];

/// Timed frames of each view, after one that is not timed.
const ROUNDS: usize = 5;

fn view_options(dataset: &Dataset, filter: ScreenFilter) -> ViewOptions {
    ViewOptions {
        background: BACKGROUND,
        near: TrainConfig::default().near(dataset.extent()),
        filter,
    }
}

/// Evaluator of the held-out views, with their photographs in memory.
///
/// # Errors
/// A data set without held-out views, or a photograph that cannot be read.
pub(super) fn held_out<'d>(gpu: &Gpu, dataset: &'d Dataset) -> Result<Evaluator<'d>> {
    if dataset.split(Split::Test).is_empty() {
        let text = "training is evaluated on held-out views, and the data set has none";
        return Err(Error::Config(text.into()));
    }
    evaluator(gpu, dataset, Split::Test).with_photos()
}

/// Evaluator of the views of a split.
pub(super) fn evaluator<'d>(gpu: &Gpu, dataset: &'d Dataset, split: Split) -> Evaluator<'d> {
    let options = view_options(dataset, ScreenFilter::Classic);
    Evaluator::new(gpu, dataset, &dataset.split(split), options)
}

/// Median times of a frame of the held-out views in milliseconds, by a renderer of the model's own SH degree: on the
/// device by its timestamps, and of the process, `None` if the system does not report it.
pub(super) fn frame_ms(gpu: &Gpu, dataset: &Dataset, splats: &Splats, model: &Model) -> Result<(f64, Option<f64>)> {
    let options = RenderOptions {
        sh_degree: model.sh_degree,
        primitive: model.primitive,
        ..RenderOptions::default()
    };
    let mut renderer = Renderer::new(gpu, options)?;
    let view = view_options(dataset, splats.filter);
    let (mut device, mut cpu) = (Vec::new(), Vec::new());
    for round in 0..=ROUNDS {
        for index in dataset.split(Split::Test) {
            let clock = CpuClock::now();
            renderer.render(model, &dataset.views[index].camera, &view)?;
            let spent = clock.elapsed_ns();
            let stages = renderer.timings()?;
            if round > 0 {
                device.push(1e-6 * stages.iter().map(|(_, ns)| ns).sum::<f64>());
                cpu.extend(spent.map(|ns| 1e-6 * ns));
            }
        }
    }
    let cpu_ms = (!cpu.is_empty()).then(|| Summary::of(&cpu).median);
    Ok((Summary::of(&device).median, cpu_ms))
}
