//! Small scenes with known geometry, trained in seconds, and the PSNR of their pictures from any camera against
//! ray-cast truth.

use crate::stability::lab::Lab;
use ashfall::lab::synth::Scene;
use ashfall::metrics::{Image, mean_squared_error};
use ashfall::render::{Model, RenderOptions, Renderer, ViewOptions};
use ashfall::scene::{Camera, Dataset, Splats, Split};
use ashfall::train::{TrainConfig, Trainer};

/// Trains to the end.
pub(crate) fn train(lab: &Lab, dataset: &Dataset, config: &TrainConfig) -> Splats {
    let mut trainer = Trainer::new(lab.gpu(), dataset, config.clone()).unwrap();
    while !trainer.is_done() {
        trainer.step().unwrap();
    }
    trainer.splats().unwrap()
}

/// The cameras of a split.
pub(crate) fn cameras(dataset: &Dataset, split: Split) -> Vec<Camera> {
    let views = dataset.split(split).into_iter();
    views.map(|view| dataset.views[view].camera).collect()
}

/// Mean PSNR of each scene over the cameras against ray casting with `samples` × `samples` a pixel.
pub(crate) fn psnr_db<'s>(
    lab: &Lab,
    scenes: impl IntoIterator<Item = &'s Splats>,
    truth: &Scene,
    cameras: &[Camera],
    samples: u32,
) -> Vec<f64> {
    let wanted: Vec<_> = cameras.iter().map(|camera| truth.image(camera, samples)).collect();
    let mut renderer = Renderer::new(lab.gpu(), RenderOptions::default()).unwrap();
    let mut mean = |splats: &Splats| {
        let model = Model::upload(lab.gpu(), splats).unwrap();
        let options = ViewOptions {
            background: [0.0; 3],
            near: 0.01,
            filter: splats.filter,
        };
        let score = |(camera, wanted): (&Camera, &Vec<[f32; 3]>)| {
            let found = renderer.render(&model, camera, &options).unwrap();
            let image = |rgb| Image::new(camera.width, camera.height, rgb);
            -10.0 * mean_squared_error(image(&found.rgb), image(wanted), None).log10()
        };
        cameras.iter().zip(&wanted).map(score).sum::<f64>() / cameras.len() as f64
    };
    scenes.into_iter().map(&mut mean).collect()
}
