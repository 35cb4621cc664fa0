//! Evaluation: views of a data set rendered and compared with their photographs.

use super::compatibility::Compatibility;
use super::model::Model;
use super::options::RenderOptions;
use super::rendered::RenderedImage;
use super::renderer::Renderer;
use super::view::ViewOptions;
use crate::Result;
use crate::gpu::Gpu;
use crate::io::photo;
use crate::metrics::{CorrectedScores, Target, ViewScore};
use crate::scene::{Dataset, Primitive, Splats, View};

/// Renders and scores views of a data set for one scene after the other.
pub struct Evaluator<'d> {
    gpu: Gpu,
    dataset: &'d Dataset,
    views: Vec<usize>,
    /// Background and near plane; the mode is the scene's.
    options: ViewOptions,
    compatibility: Compatibility,
    /// Photographs of all views; `None`: each is decoded when its turn comes.
    targets: Option<Vec<Target>>,
    /// Renderer of the last scene's kind and SH degree.
    renderer: Option<((Primitive, u32), Renderer)>,
}

/// A rendered view with its photograph.
#[derive(Clone, Copy, Debug)]
pub struct ViewEvaluation<'e> {
    /// The view.
    pub view: &'e View,
    /// Photograph over the background, or with its mask.
    pub target: &'e Target,
    /// Rendering of the scene.
    pub rendered: &'e RenderedImage,
}

impl ViewEvaluation<'_> {
    /// PSNR and SSIM of the rendering.
    pub fn score(&self) -> ViewScore {
        self.target.score(&self.view.name, &self.rendered.rgb)
    }

    /// PSNR and SSIM after corrections of the rendering's colours to the photograph.
    pub fn corrected(&self) -> CorrectedScores {
        self.target.corrected(&self.rendered.rgb)
    }

    /// SSIM of the rendering.
    pub fn ssim(&self) -> f64 {
        self.target.ssim(&self.rendered.rgb)
    }

    /// Mean squared error of the rendering over pixels and channels.
    pub fn mean_squared_error(&self) -> f64 {
        self.target.mean_squared_error(&self.rendered.rgb)
    }
}

impl<'d> Evaluator<'d> {
    /// Evaluator of the data set's views with these indices.
    pub fn new(gpu: &Gpu, dataset: &'d Dataset, views: &[usize], options: ViewOptions) -> Evaluator<'d> {
        Evaluator {
            gpu: gpu.clone(),
            dataset,
            views: views.to_vec(),
            options,
            compatibility: Compatibility::Engine,
            targets: None,
            renderer: None,
        }
    }

    /// The same evaluator with other drawing rules.
    pub fn drawing_as(mut self, compatibility: Compatibility) -> Evaluator<'d> {
        self.compatibility = compatibility;
        self
    }

    /// The same evaluator with all photographs decoded now and kept in memory.
    pub fn with_photos(mut self) -> Result<Evaluator<'d>> {
        let targets = self.views.iter().map(|&view| self.target(view));
        self.targets = Some(targets.collect::<Result<_>>()?);
        Ok(self)
    }

    /// Number of views.
    pub fn view_count(&self) -> usize {
        self.views.len()
    }

    /// Renders each view in order and collects the results of `each`; stops at the first error.
    pub fn map<T>(&mut self, splats: &Splats, mut each: impl FnMut(ViewEvaluation<'_>) -> Result<T>) -> Result<Vec<T>> {
        let mut results = Vec::with_capacity(self.views.len());
        if self.views.is_empty() {
            return Ok(results);
        }
        let kind = (splats.primitive, splats.sh_degree);
        let mut renderer = self.renderer(kind)?;
        let model = Model::upload(&self.gpu, splats)?;
        let options = ViewOptions {
            filter: splats.filter,
            ..self.options
        };
        for (i, &index) in self.views.iter().enumerate() {
            let view = &self.dataset.views[index];
            let decoded;
            let target = match &self.targets {
                Some(targets) => &targets[i],
                None => {
                    decoded = self.target(index)?;
                    &decoded
                }
            };
            let rendered = &renderer.render(&model, &view.camera, &options)?;
            results.push(each(ViewEvaluation { view, target, rendered })?);
        }
        renderer.release()?;
        self.renderer = Some((kind, renderer));
        Ok(results)
    }

    /// Scores of all views.
    pub fn scores(&mut self, splats: &Splats) -> Result<Vec<ViewScore>> {
        self.map(splats, |evaluated| Ok(evaluated.score()))
    }

    fn target(&self, view: usize) -> Result<Target> {
        let photo = photo::load(&self.dataset.views[view])?;
        Ok(Target::new(&photo, self.dataset.alpha, self.options.background))
    }

    fn renderer(&mut self, kind: (Primitive, u32)) -> Result<Renderer> {
        match self.renderer.take() {
            Some((known, renderer)) if known == kind => Ok(renderer),
            _ => {
                let (primitive, sh_degree) = kind;
                let options = RenderOptions {
                    primitive,
                    sh_degree,
                    compatibility: self.compatibility,
                    ..RenderOptions::default()
                };
                Renderer::new(&self.gpu, options)
            }
        }
    }
}
