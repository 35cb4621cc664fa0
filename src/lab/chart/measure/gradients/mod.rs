//! Training steps of every setting: time, and errors of their gradients.
//!
//! Times are those of the usual step. Gradients are compared for another objective, the brightness of the image, for
//! which bounds can be proven. A step on a white photograph by the L1 loss alone has this gradient if no pixel reaches
//! white; pixels that may reach it are masked out.

mod compare;

use super::frames::{exact_options, rounding, times_ms};
use super::settings::{self, FrameSetting};
use super::{SceneInputs, reduced, training};
use crate::io::photo;
use crate::lab::bench::input::scene::one_view;
use crate::lab::chart::{GradientErrors, GradientPoint};
use crate::reference::Options;
use crate::reference::bound::{Approximations, GradientBounds, Rounding, TracedPixel, gradient_bounds, trace};
use crate::reference::gradient::{SplatGradients, backward};
use crate::reference::rasterize_backward::PixelGradient;
use crate::scene::{AlphaMode, Camera, Dataset, Photo, Splats, Split, View};
use crate::train::{Background, HostState, TrainConfig, Trainer};
use crate::{Error, Result};
use compare::{compare, percentile};

/// Iteration of the compared step: late in a long run, with all harmonics and without refinement.
const BEGUN: u32 = 20_000;

impl SceneInputs<'_> {
    /// Times a step of every setting and compares its gradient.
    pub(super) fn gradients(&self, progress: &mut dyn FnMut(&str)) -> Result<Vec<GradientPoint>> {
        let plan = self.plan;
        let settings = settings::of_gradients(self.splats.sh_degree, plan);
        // A training view, small enough for the reference.
        let camera = reduced(&self.view()?.camera, plan.gradient_pixels);
        let usual = self.dataset_of(camera, self.photo(&camera)?, AlphaMode::Composite);
        let mut timed = settings
            .iter()
            .map(|setting| self.trainer(&usual, config(setting, self.splats)))
            .collect::<Result<Vec<_>>>()?;
        progress("gradients: the exact ones");
        let options = exact_options(self.splats, timed[0].near());
        let approximations: Vec<Approximations> = settings.iter().map(|s| s.approximations(self.splats, &[])).collect();
        let traced = trace(self.splats, &camera, &options, &approximations);
        let white = white(&camera, &traced);
        let exact = self.exact(&camera, &options, &white, &approximations);
        let white = self.dataset_of(camera, white, AlphaMode::Mask);
        let mut points = Vec::new();
        for (index, setting) in settings.iter().enumerate() {
            let config = TrainConfig {
                lambda_dssim: 0.0,
                ..config(setting, self.splats)
            };
            let found = self.step(&white, config)?;
            let comparison = compare(&found, &exact.0, &exact.1, index);
            let errors = |sorted: &[f64]| GradientErrors {
                median: percentile(sorted, 0.5),
                p99: percentile(sorted, 0.99),
            };
            points.push(GradientPoint {
                knob: setting.knob.clone(),
                error: errors(&comparison.errors),
                bound: errors(&comparison.bounds),
                excess: comparison.excess,
                ..GradientPoint::default()
            });
        }
        // The first step compiles and grows buffers.
        timed.iter_mut().try_for_each(|t| t.step().map(|_| ()))?;
        let begun = |run| progress(&format!("gradients: run {run} of {}", plan.runs));
        let times = times_ms(&mut timed, plan.runs, 1, begun, |trainer| {
            trainer.step()?;
            Ok(trainer.timings()?.iter().map(|(_, ns)| ns).sum())
        })?;
        for (point, times) in points.iter_mut().zip(times) {
            (point.time_ms, point.cpu_ms) = times;
        }
        Ok(points)
    }

    fn view(&self) -> Result<&View> {
        let index = self.dataset.split(Split::Train).first().copied();
        let view = index.map(|i| &self.dataset.views[i]);
        view.ok_or_else(|| Error::Config("the data set has no training view".into()))
    }

    /// Photograph of the view, with alpha composited once.
    fn photo(&self, camera: &Camera) -> Result<Photo> {
        let (width, height) = (camera.width, camera.height);
        let photo = photo::reduce(photo::load(self.view()?)?, width, height);
        let target = crate::metrics::Target::new(&photo, AlphaMode::Composite, training::BACKGROUND);
        Ok(Photo::from_rgb(width, height, &target.rgb))
    }

    /// One view, in a data set of the same extent.
    fn dataset_of(&self, camera: Camera, photo: Photo, alpha: AlphaMode) -> Dataset {
        let mut dataset = one_view(camera, photo, self.dataset.extent() / 1.1);
        dataset.alpha = alpha;
        dataset
    }

    fn trainer<'d>(&self, dataset: &'d Dataset, config: TrainConfig) -> Result<Trainer<'d>> {
        let state = HostState::from_splats(self.splats, self.splats.sh_degree);
        Trainer::from_state(self.gpu, dataset, config, &state, BEGUN)
    }

    /// Gradient of one step.
    fn step(&self, dataset: &Dataset, config: TrainConfig) -> Result<Splats> {
        let mut trainer = self.trainer(dataset, config)?;
        trainer.keep_gradients()?;
        trainer.step()?;
        let planes = trainer.gradients()?;
        let found = HostState {
            primitive: self.splats.primitive,
            sh_degree: self.splats.sh_degree,
            degrees: vec![self.splats.sh_degree as u8; self.splats.len()],
            m: planes.clone(),
            v: planes.clone(),
            params: planes,
        };
        Ok(found.to_splats(self.splats.filter))
    }

    /// The exact gradient of the brightness, and the bounds of all settings.
    fn exact(
        &self,
        camera: &Camera,
        options: &Options,
        white: &Photo,
        approximations: &[Approximations],
    ) -> (SplatGradients, GradientBounds) {
        // The L1 loss is a mean over the channels of unmasked pixels.
        let counted = white.rgba.iter().filter(|pixel| pixel[3] != 0).count();
        let slope = -1.0 / (3.0 * counted.max(1) as f64);
        let slope = |pixel: &[u8; 4]| [if pixel[3] != 0 { slope } else { 0.0 }; 3];
        let upstream: Vec<[f64; 3]> = white.rgba.iter().map(slope).collect();
        let pixel = |&color: &[f64; 3]| PixelGradient {
            color,
            ..PixelGradient::default()
        };
        let pixels: Vec<PixelGradient> = upstream.iter().map(pixel).collect();
        let rounding = Rounding {
            share: rounding(camera),
            unit: f64::from(f32::EPSILON) / 2.0,
        };
        let bounds = gradient_bounds(self.splats, camera, options, &upstream, approximations, rounding);
        (backward(self.splats, camera, options, &pixels).1, bounds)
    }
}

/// A white photograph, with a mask of the pixels that stay below white in all settings.
fn white(camera: &Camera, traced: &[TracedPixel]) -> Photo {
    let share = rounding(camera);
    let pixel = |traced: &TracedPixel| {
        let most = traced.color.iter().copied().fold(0.0, f64::max);
        let off = traced.bounds.iter().copied().fold(0.0, f64::max);
        let is_below = most + off + share * traced.range + traced.order < 1.0;
        [255, 255, 255, if is_below { 255 } else { 0 }]
    };
    Photo {
        width: camera.width,
        height: camera.height,
        rgba: traced.iter().map(pixel).collect(),
    }
}

fn config(setting: &FrameSetting, splats: &Splats) -> TrainConfig {
    TrainConfig {
        sh_degree: splats.sh_degree,
        accuracy: setting.accuracy,
        filter: splats.filter,
        background: Background::Fixed(training::BACKGROUND),
        ..TrainConfig::for_iterations(30_000)
    }
}
