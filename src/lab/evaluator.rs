//! Judging scenes by the views that training did not see, and timing them there.

use super::bench::CpuClock;
use crate::gpu::Gpu;
use crate::io::photo;
use crate::metrics::{MeanScore, Target};
use crate::render::{Model, RenderOptions, Renderer, ViewOptions};
use crate::scene::{Camera, Dataset, Splats, Split};
use crate::stats::Summary;
use crate::train::TrainConfig;
use crate::{Error, Result};

/// Behind all splats.
pub(super) const BACKGROUND: [f32; 3] = [0.0; 3];

/// Times that every view is timed, after once that does not count.
const ROUNDS: usize = 5;

/// The held-out views.
pub(super) struct Evaluator {
    gpu: Gpu,
    renderer: Renderer,
    views: Vec<(String, Camera, Target)>,
    near: f32,
}

/// Medians of a frame, milliseconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FrameTime {
    /// On the device, by its timestamps.
    pub(super) device_ms: f64,
    /// Of the whole process, where the system says.
    pub(super) cpu_ms: Option<f64>,
}

impl Evaluator {
    /// Of a data set that holds views out.
    pub(super) fn new(gpu: &Gpu, dataset: &Dataset) -> Result<Evaluator> {
        let held_out = dataset.split(Split::Test);
        if held_out.is_empty() {
            let what = "training is judged by held-out views, and the data set has none";
            return Err(Error::Config(what.into()));
        }
        let views = held_out.iter().map(|&index| {
            let view = &dataset.views[index];
            let photo = photo::load(view)?;
            let target = Target::new(&photo, dataset.alpha, BACKGROUND);
            Ok((view.name.clone(), view.camera, target))
        });
        Ok(Evaluator {
            gpu: gpu.clone(),
            renderer: Renderer::new(gpu, RenderOptions::default())?,
            views: views.collect::<Result<_>>()?,
            near: (dataset.extent() * f64::from(TrainConfig::default().near_factor)) as f32,
        })
    }

    fn view(&self, splats: &Splats) -> ViewOptions {
        ViewOptions {
            background: BACKGROUND,
            near: self.near,
            mode: splats.mode,
        }
    }

    pub(super) fn score(&mut self, splats: &Splats) -> Result<MeanScore> {
        let model = Model::upload(&self.gpu, splats)?;
        let view = self.view(splats);
        let mut scores = Vec::new();
        for (name, camera, target) in &self.views {
            let drawn = self.renderer.render(&model, camera, &view)?;
            scores.push(target.score(name, &drawn.rgb));
        }
        Ok(MeanScore::of(&scores))
    }

    /// Times frames of a scene on the device, drawn by a renderer for no more harmonics than it has.
    pub(super) fn time(&self, splats: &Splats, model: &Model) -> Result<FrameTime> {
        let options = RenderOptions {
            sh_degree: model.sh_degree,
            ..RenderOptions::default()
        };
        let mut renderer = Renderer::new(&self.gpu, options)?;
        let view = self.view(splats);
        let (mut device, mut cpu) = (Vec::new(), Vec::new());
        for round in 0..=ROUNDS {
            for (_, camera, _) in &self.views {
                let clock = CpuClock::now();
                renderer.render(model, camera, &view)?;
                let spent = clock.elapsed_ns();
                let stages = renderer.timings()?;
                if round > 0 {
                    device.push(1e-6 * stages.iter().map(|(_, ns)| ns).sum::<f64>());
                    cpu.extend(spent.map(|ns| 1e-6 * ns));
                }
            }
        }
        Ok(FrameTime {
            device_ms: Summary::of(&device).median,
            cpu_ms: (!cpu.is_empty()).then(|| Summary::of(&cpu).median),
        })
    }
}
