//! Views that training does not see, to judge it by: never the test views, and only until the count is decided.

use crate::Result;
use crate::gpu::Gpu;
use crate::io;
use crate::metrics::Target;
use crate::metrics::{Image, mean_squared_error};
use crate::render::{Model, RenderOptions, Renderer, ViewOptions};
use crate::scene::{Camera, Dataset, Splats, Split};
use crate::stats::mean;

/// Held out at least, where there are enough views: a spread needs as many.
const VIEWS_MIN: usize = 3;

/// One of so many training views is held out, as many as are usually kept for tests.
const VIEWS_EACH: usize = 8;

/// No view's mean squared error counts as less than that of a hundredth of white, about the least contrast that an eye
/// tells (Weber): a plain wall would be given splats for decibels beyond 40 that nobody sees.
pub(super) const UNSEEN: f64 = 1e-4;

/// So many decibels at most: those of that error.
const FULL_DB: f64 = 40.0;

/// Whether nobody sees what is wrong in any view.
pub(super) fn is_full(psnr_db: &[f64]) -> bool {
    psnr_db.iter().all(|&psnr| psnr >= FULL_DB)
}

/// What the views lack, on average, of being as good as can be seen; decibels.
pub(super) fn short_of_full(psnr_db: &[f64]) -> f64 {
    let short: Vec<f64> = psnr_db.iter().map(|psnr| FULL_DB - psnr).collect();
    mean(&short)
}

/// Parts the training views into those that are trained on and those that are judged by, which lie evenly among them.
/// With fewer than eight views none can be spared: they are judged by what they were trained on.
pub fn part(dataset: &Dataset) -> (Vec<usize>, Vec<usize>) {
    let views = dataset.split(Split::Train);
    let count = (views.len().div_ceil(VIEWS_EACH)).max(VIEWS_MIN);
    if views.len() < 2 * VIEWS_MIN + 2 {
        return (views.clone(), views);
    }
    // The middles of as many stretches: neighbours on both sides have been trained on.
    let place = |k: usize| (2 * k + 1) * views.len() / (2 * count);
    let chosen: Vec<usize> = (0..count).map(|k| views[place(k)]).collect();
    let others = views.iter().copied().filter(|v| !chosen.contains(v));
    (others.collect(), chosen)
}

/// Judges scenes by some views.
pub struct Evaluator {
    gpu: Gpu,
    views: Vec<(Camera, Target)>,
    options: ViewOptions,
    renderer: Option<(u32, Renderer)>,
}

impl Evaluator {
    /// By these of the data set's views, drawn so.
    pub fn new(
        gpu: &Gpu,
        dataset: &Dataset,
        views: &[usize],
        options: ViewOptions,
    ) -> Result<Evaluator> {
        let view = |&index: &usize| {
            let view = &dataset.views[index];
            let photo = io::photo::load(view)?;
            let target = Target::new(&photo, dataset.alpha, options.background);
            Ok((view.camera, target))
        };
        Ok(Evaluator {
            gpu: gpu.clone(),
            views: views.iter().map(view).collect::<Result<_>>()?,
            options,
            renderer: None,
        })
    }

    /// The scores of a scene that nobody sees anything wrong with.
    pub(super) fn best(&self) -> Vec<f64> {
        vec![FULL_DB; self.views.len()]
    }

    /// The PSNR of each view, decibels; 40 at most, beyond which nobody sees what is wrong.
    pub fn score(&mut self, splats: &Splats) -> Result<Vec<f64>> {
        self.score_up_to(splats, FULL_DB)
    }

    /// The same, `most` decibels at most.
    pub(super) fn score_up_to(&mut self, splats: &Splats, most: f64) -> Result<Vec<f64>> {
        let degree = splats.sh_degree;
        let mut renderer = match self.renderer.take() {
            Some((of, renderer)) if of == degree => renderer,
            _ => {
                let options = RenderOptions {
                    sh_degree: degree,
                    ..RenderOptions::default()
                };
                Renderer::new(&self.gpu, options)?
            }
        };
        let model = Model::upload(&self.gpu, splats)?;
        let score = |(camera, target): &(Camera, Target)| {
            let drawn = renderer.render(&model, camera, &self.options)?;
            let drawn = Image::new(target.width, target.height, &drawn.rgb);
            let photo = Image::new(target.width, target.height, &target.rgb);
            let error = mean_squared_error(drawn, photo, target.weights.as_deref());
            // Broken numbers are as bad as it gets, not as good.
            Ok(match error.is_finite() {
                true => (-10.0 * error.max(f64::MIN_POSITIVE).log10()).min(most),
                false => 0.0,
            })
        };
        let scores = self.views.iter().map(score).collect();
        self.renderer = Some((degree, renderer));
        scores
    }
}
