//! Geometry of trained scenes: meshes, depths and normals against those of a made scene.

use super::ChartPlan;
use crate::Result;
use crate::gpu::Gpu;
use crate::lab::chart::{GeometryPoint, Knob};
use crate::lab::evaluator::{BACKGROUND, held_out};
use crate::lab::synth::{self, Kind, SynthOptions};
use crate::mesh::{
    ComparisonOptions, DepthMap, DepthMaps, FusionOptions, SurfaceImage, SurfaceScore, clean, compare, fuse,
};
use crate::metrics::MeanScore;
use crate::render::{Model, RenderOptions, RenderedImage, Renderer, ViewOptions};
use crate::scene::{Camera, Dataset, Mesh, Primitive, Splats, Split};
use crate::stats::Interval;
use crate::train::config::SURFEL_NORMAL_WEIGHT;
use crate::train::{TrainConfig, Trainer};
use glam::DVec3;
use std::time::Instant;

/// Kind of splats and weight of the normals' term, by name.
type GeometryRecipe = (&'static str, Primitive, f32);

const RECIPES: [GeometryRecipe; 4] = [
    ("3D", Primitive::Gaussian3d, 0.0),
    ("3D, normal term", Primitive::Gaussian3d, SURFEL_NORMAL_WEIGHT),
    ("surfels", Primitive::Surfel, 0.0),
    ("surfels, normal term", Primitive::Surfel, SURFEL_NORMAL_WEIGHT),
];

/// A made scene with its truth.
struct GeometrySubject {
    scene: synth::Scene,
    dataset: Dataset,
    mesh: Mesh,
    /// Points on each mesh.
    samples: usize,
}

/// Figures of a run by one kind of depth.
struct GeometryFigures {
    seconds: f64,
    splats: f64,
    psnr_db: f64,
    chamfer: f64,
    depth: f64,
    normal: f64,
}

/// Points of all recipes, each by the depths of the splats' planes, and plain 3D splats by those of means, too.
pub(super) fn measure(gpu: &Gpu, plan: &ChartPlan, progress: &mut dyn FnMut(&str)) -> Result<Vec<GeometryPoint>> {
    let made = GeometrySubject::new(plan.is_quick);
    let mut points = Vec::new();
    for (name, kind, normal) in RECIPES {
        let mut runs = Vec::new();
        for seed in 0..plan.seeds.max(1) {
            progress(&format!("geometry: {name}, run {} of {}", seed + 1, plan.seeds));
            let mut config = TrainConfig::for_iterations(plan.iterations).with_kind(kind);
            config.geometry.normal = normal;
            config.seed = seed;
            runs.push(made.figures(gpu, config)?);
        }
        let settings: &[&str] = match name {
            "3D" => &["median", "means"],
            _ => &["median"],
        };
        for (depths, setting) in settings.iter().enumerate() {
            points.push(point(name, setting, &runs, depths));
        }
    }
    Ok(points)
}

fn point(name: &str, setting: &str, runs: &[[GeometryFigures; 2]], depths: usize) -> GeometryPoint {
    let mean = |of: fn(&GeometryFigures) -> f64| {
        let values: Vec<f64> = runs.iter().map(|run| of(&run[depths])).collect();
        Interval::of_mean(&values)
    };
    GeometryPoint {
        knob: Knob {
            is_default: (name, depths) == ("3D", 0),
            ..Knob::new(name, setting)
        },
        seconds: mean(|f| f.seconds),
        splats: mean(|f| f.splats),
        psnr_db: mean(|f| f.psnr_db),
        chamfer: mean(|f| f.chamfer),
        depth: mean(|f| f.depth),
        normal: mean(|f| f.normal),
    }
}

impl GeometrySubject {
    fn new(is_quick: bool) -> GeometrySubject {
        let (views, width, height, samples) = match is_quick {
            true => (8, 44, 33, 1_000),
            false => (32, 160, 120, 20_000),
        };
        let options = SynthOptions {
            views,
            width,
            height,
            ..SynthOptions::default()
        };
        let scene = synth::scene(Kind::Solids);
        GeometrySubject {
            dataset: scene.dataset(&options),
            mesh: scene.mesh(),
            scene,
            samples,
        }
    }

    fn cameras(&self, split: Split) -> Vec<Camera> {
        let views = self.dataset.split(split).into_iter();
        views.map(|view| self.dataset.views[view].camera).collect()
    }

    /// Figures of a run: by median depths, and by those of means.
    fn figures(&self, gpu: &Gpu, config: TrainConfig) -> Result<[GeometryFigures; 2]> {
        let mut trainer = Trainer::new(gpu, &self.dataset, config)?;
        let start = Instant::now();
        while !trainer.is_done() {
            trainer.step()?;
        }
        trainer.finish()?;
        let seconds = start.elapsed().as_secs_f64();
        let (splats, near) = (trainer.splats()?, trainer.near());
        drop(trainer);
        let score = MeanScore::of(&held_out(gpu, &self.dataset)?.scores(&splats)?);
        let pictures = |split| SurfacePictures::new(gpu, &splats, near, self.cameras(split));
        let (trained, tested) = (pictures(Split::Train)?, pictures(Split::Test)?);
        let figures = |depths: Depths| -> Result<GeometryFigures> {
            let surface = self.surface(&tested, depths);
            Ok(GeometryFigures {
                seconds,
                splats: splats.len() as f64,
                psnr_db: score.psnr_db.unwrap_or(f64::NAN),
                chamfer: self.chamfer(&trained, depths)?,
                depth: surface.depth_median,
                normal: surface.normal_mean_deg,
            })
        };
        Ok([figures(median)?, figures(means)?])
    }

    /// Chamfer distance of the fused mesh, in pixels' footprints.
    fn chamfer(&self, trained: &SurfacePictures, depths: Depths) -> Result<f64> {
        let map = |view: usize| {
            let (camera, picture) = (&trained.cameras[view], &trained.images[view]);
            let alpha = picture.alpha();
            Ok(DepthMap::new(
                camera,
                &depths(picture),
                normals(picture),
                &picture.rgb,
                &alpha,
            ))
        };
        let mut maps = DepthMaps::new(trained.cameras.len(), map);
        let (mut mesh, _) = fuse(&FusionOptions::default(), &mut maps, |_, _| Ok(()))?;
        clean(&mut mesh, None);
        let options = ComparisonOptions {
            samples: self.samples,
            cameras: trained.cameras.clone(),
            ..ComparisonOptions::default()
        };
        let found = compare(&mesh, DVec3::ZERO, &self.mesh, &options)?;
        Ok(found.chamfer / found.footprint.unwrap_or(f64::NAN))
    }

    /// Mean errors of depths and normals in the held-out views.
    fn surface(&self, tested: &SurfacePictures, depths: Depths) -> SurfaceScore {
        let score = |(camera, picture): (&Camera, &RenderedImage)| {
            let (exact, true_normals) = (self.scene.depth(camera), self.scene.normals(camera));
            let image = |depth, normal| SurfaceImage {
                width: camera.width as usize,
                depth,
                normal,
            };
            SurfaceScore::of(
                &image(&depths(picture), normals(picture)),
                &image(&exact, &true_normals),
            )
        };
        let scores: Vec<SurfaceScore> = tested.cameras.iter().zip(&tested.images).map(score).collect();
        SurfaceScore::average(&scores)
    }
}

/// Pictures of a scene with surfaces.
struct SurfacePictures {
    cameras: Vec<Camera>,
    images: Vec<RenderedImage>,
}

impl SurfacePictures {
    fn new(gpu: &Gpu, splats: &Splats, near: f32, cameras: Vec<Camera>) -> Result<SurfacePictures> {
        let options = RenderOptions {
            with_depth: true,
            with_surface: true,
            sh_degree: splats.sh_degree,
            primitive: splats.primitive,
            ..RenderOptions::default()
        };
        let view = ViewOptions {
            background: BACKGROUND,
            near,
            filter: splats.filter,
        };
        let mut renderer = Renderer::new(gpu, options)?;
        let model = Model::upload(gpu, splats)?;
        let images = cameras.iter().map(|camera| renderer.render(&model, camera, &view));
        let images = images.collect::<Result<_>>()?;
        Ok(SurfacePictures { cameras, images })
    }
}

/// Depths of a picture, NaN without a surface.
type Depths = fn(&RenderedImage) -> Vec<f32>;

fn median(picture: &RenderedImage) -> Vec<f32> {
    let surface = picture.surface.as_ref();
    surface.map_or_else(Vec::new, |surface| surface.median_depth.clone())
}

fn means(picture: &RenderedImage) -> Vec<f32> {
    let pairs = picture.mean_depth().into_iter().zip(median(picture));
    pairs.map(|(mean, at)| if at.is_nan() { at } else { mean }).collect()
}

fn normals(picture: &RenderedImage) -> &[[f32; 3]] {
    let surface = picture.surface.as_ref();
    surface.map_or(&[], |surface| &surface.normal)
}
