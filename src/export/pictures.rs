//! Views in which a rounded scene is compared with its original.

use crate::Result;
use crate::gpu::Gpu;
use crate::metrics::{Image, MeanScore, mean_squared_error, ssim};
use crate::render::{Evaluator, Model, RenderOptions, RenderedImage, Renderer, ViewOptions};
use crate::scene::{Camera, Splats};

/// Pictures of the original scene, and the photographs if there are any.
pub struct Pictures<'d> {
    gpu: Gpu,
    cameras: Vec<Camera>,
    options: ViewOptions,
    originals: Vec<RenderedImage>,
    /// Photographs of the views, and the original's mean PSNR and SSIM against them.
    photos: Option<(Evaluator<'d>, [f64; 2])>,
}

/// Error of a rounded scene's pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureError {
    /// Mean squared difference from the original's pictures over all pixels and channels.
    pub mean_squared: f64,
    /// Mean SSIM against the original's pictures.
    pub ssim: f64,
    /// Largest difference of a channel.
    pub largest: f64,
    /// Mean PSNR in decibels and SSIM against the photographs, minus the original's.
    pub against_photos: Option<[f64; 2]>,
}

impl PictureError {
    /// PSNR against the original's pictures in decibels, errors pooled over views.
    pub fn psnr_db(&self) -> f64 {
        -10.0 * self.mean_squared.log10()
    }

    /// Decibels lost against the photographs; without any, those that a scene of 30 dB would lose.
    pub fn loss_db(&self) -> f64 {
        match self.against_photos {
            Some([change_db, _]) => -change_db,
            None => 10.0 * (1.0 + self.mean_squared / ASSUMED_MEAN_SQUARED).log10(),
        }
    }
}

/// Mean squared error of 30 dB.
const ASSUMED_MEAN_SQUARED: f64 = 1e-3;

impl<'d> Pictures<'d> {
    /// Renders the original from `cameras`, and scores it by an evaluator's photographs.
    ///
    /// # Errors
    /// Those of the device and of the photographs.
    pub fn new(
        gpu: &Gpu,
        original: &Splats,
        cameras: Vec<Camera>,
        options: ViewOptions,
        photos: Option<Evaluator<'d>>,
    ) -> Result<Pictures<'d>> {
        let mut pictures = Pictures {
            gpu: gpu.clone(),
            cameras,
            options,
            originals: Vec::new(),
            photos: None,
        };
        pictures.originals = pictures.render(original)?;
        if let Some(mut evaluator) = photos {
            let scores = scores(&mut evaluator, original)?;
            pictures.photos = Some((evaluator, scores));
        }
        Ok(pictures)
    }

    /// Number of views that are rendered.
    pub fn view_count(&self) -> usize {
        self.cameras.len()
    }

    /// Mean PSNR in decibels and SSIM of the original against the photographs.
    pub fn original_scores(&self) -> Option<[f64; 2]> {
        self.photos.as_ref().map(|(_, scores)| *scores)
    }

    /// Error of a rounded scene.
    ///
    /// # Errors
    /// Those of the device and of the photographs.
    pub fn error(&mut self, rounded: &Splats) -> Result<PictureError> {
        let pictures = self.render(rounded)?;
        let (mut squares, mut pixels, mut similarity, mut largest) = (0.0, 0.0, 0.0, 0.0_f64);
        for (picture, original) in pictures.iter().zip(&self.originals) {
            let images = [picture, original].map(|i| Image::new(i.width, i.height, &i.rgb));
            let count = picture.rgb.len() as f64;
            squares += count * mean_squared_error(images[0], images[1], None);
            pixels += count;
            similarity += ssim(images[0], images[1], None);
            let channels = picture.rgb.iter().flatten().zip(original.rgb.iter().flatten());
            largest = channels.fold(largest, |most, (a, b)| most.max(f64::from((a - b).abs())));
        }
        let against_photos = match &mut self.photos {
            Some((evaluator, [psnr_db, similarity])) => {
                let found = scores(evaluator, rounded)?;
                Some([found[0] - *psnr_db, found[1] - *similarity])
            }
            None => None,
        };
        Ok(PictureError {
            mean_squared: squares / pixels,
            ssim: similarity / pictures.len() as f64,
            largest,
            against_photos,
        })
    }

    fn render(&self, splats: &Splats) -> Result<Vec<RenderedImage>> {
        let mut renderer = Renderer::new(
            &self.gpu,
            RenderOptions {
                sh_degree: splats.sh_degree,
                primitive: splats.primitive,
                ..RenderOptions::default()
            },
        )?;
        let model = Model::upload(&self.gpu, splats)?;
        let options = ViewOptions {
            filter: splats.filter,
            ..self.options
        };
        let render = |camera: &Camera| renderer.render(&model, camera, &options);
        self.cameras.iter().map(render).collect()
    }
}

/// Mean PSNR in decibels and SSIM.
fn scores(evaluator: &mut Evaluator<'_>, splats: &Splats) -> Result<[f64; 2]> {
    let scores = MeanScore::of(&evaluator.scores(splats)?);
    Ok([scores.psnr_db, scores.ssim].map(|score| score.unwrap_or(f64::NAN)))
}
