//! Meshes of trained scenes beside the true ones: by the depth of planes, by that of means, and from exact depth.

use crate::common::device;
use ashfall::gpu::Gpu;
use ashfall::lab::synth::{Kind, SynthOptions, scene};
use ashfall::mesh::{ComparisonOptions, DepthMap, FusionOptions, MeshComparison, clean, compare, fuse};
use ashfall::render::{Model, RenderOptions, RenderedImage, Renderer, ViewOptions};
use ashfall::scene::{Camera, Dataset, Mesh, Splats, Split};
use ashfall::{Run, TrainConfig};
use glam::DVec3;

/// Size of a measurement.
struct Size {
    views: usize,
    width: u32,
    height: u32,
    iterations: u32,
}

fn trained(gpu: &Gpu, dataset: &Dataset, iterations: u32) -> (Splats, ViewOptions) {
    let mut run = Run::new(gpu, dataset, TrainConfig::for_iterations(iterations)).unwrap();
    while !run.is_done() {
        run.step().unwrap();
    }
    run.finish().unwrap();
    let splats = run.splats().unwrap();
    let view = ViewOptions {
        background: [0.0; 3],
        near: run.config().near(dataset.extent()),
        filter: splats.filter,
    };
    (splats, view)
}

/// Depths of a picture, NaN without a surface.
type Depths = fn(&RenderedImage) -> Vec<f32>;

fn medians(picture: &RenderedImage) -> Vec<f32> {
    picture.surface.as_ref().unwrap().median_depth.clone()
}

fn expected(picture: &RenderedImage) -> Vec<f32> {
    picture.surface.as_ref().unwrap().expected_depth.clone()
}

fn means(picture: &RenderedImage) -> Vec<f32> {
    let surface = medians(picture);
    let pairs = picture.mean_depth().into_iter().zip(surface);
    pairs.map(|(mean, at)| if at.is_nan() { at } else { mean }).collect()
}

/// Scores of the meshes of a made scene: from exact depths, then from those of a trained scene.
fn measured(gpu: &Gpu, kind: Kind, size: &Size) -> [MeshComparison; 4] {
    let made = scene(kind);
    let options = SynthOptions {
        views: size.views,
        width: size.width,
        height: size.height,
        ..SynthOptions::default()
    };
    let dataset = made.dataset(&options);
    let train = dataset.split(Split::Train);
    let cameras: Vec<Camera> = train.iter().map(|&i| dataset.views[i].camera).collect();
    let truth = made.mesh();
    let scored = |mesh: &Mesh| {
        let options = ComparisonOptions {
            samples: 50_000,
            cameras: cameras.clone(),
            ..ComparisonOptions::default()
        };
        compare(mesh, DVec3::ZERO, &truth, &options).unwrap()
    };
    let exact = |view: usize| {
        let camera = &cameras[view];
        let depth: Vec<f32> = made
            .depth(camera)
            .iter()
            .map(|z| if z.is_finite() { *z } else { f32::NAN })
            .collect();
        let alpha: Vec<f32> = depth.iter().map(|z| if z.is_nan() { 0.0 } else { 1.0 }).collect();
        let rgb = vec![[0.5; 3]; alpha.len()];
        Ok(DepthMap::new(camera, &depth, &made.normals(camera), &rgb, &alpha))
    };
    let fusion = FusionOptions::default();
    let (floor, report) = fuse(&fusion, cameras.len(), exact, |_, _| Ok(())).unwrap();
    // The same voxels for all.
    let fusion = FusionOptions {
        voxel: Some(report.voxel),
        ..fusion
    };
    let (splats, view) = trained(gpu, &dataset, size.iterations);
    let options = RenderOptions {
        with_depth: true,
        with_surface: true,
        sh_degree: splats.sh_degree,
        ..RenderOptions::default()
    };
    let mut renderer = Renderer::new(gpu, options).unwrap();
    let model = Model::upload(gpu, &splats).unwrap();
    let pictures: Vec<RenderedImage> = cameras
        .iter()
        .map(|c| renderer.render(&model, c, &view).unwrap())
        .collect();
    let of = |depths: Depths| {
        let map = |view: usize| {
            let (camera, picture) = (&cameras[view], &pictures[view]);
            let normal = &picture.surface.as_ref().unwrap().normal;
            Ok(DepthMap::new(
                camera,
                &depths(picture),
                normal,
                &picture.rgb,
                &picture.alpha(),
            ))
        };
        let (mut mesh, _) = fuse(&fusion, cameras.len(), map, |_, _| Ok(())).unwrap();
        clean(&mut mesh, None);
        scored(&mesh)
    };
    [scored(&floor), of(medians), of(expected), of(means)]
}

fn table(kind: Kind, found: &[MeshComparison; 4]) {
    for (name, found) in ["exact", "median", "expected", "means"].iter().zip(found) {
        let pixel = found.footprint.unwrap();
        println!(
            "| {} | {name} | {:.3} | {:.3} | {:.3} | {:.3} | {:.1}° |",
            kind.name(),
            found.accuracy.mean / pixel,
            found.completeness.mean / pixel,
            found.chamfer / pixel,
            found.scores[2].f1,
            found.normal_deg.mean,
        );
    }
}

#[test]
fn planes_of_splats_are_nearer_to_the_truth_than_means() {
    let gpu = device::gpu();
    let size = Size {
        views: 16,
        width: 80,
        height: 60,
        iterations: 300,
    };
    let found = measured(&gpu, Kind::Sphere, &size);
    table(Kind::Sphere, &found);
    let [floor, median, _, means] = &found;
    let pixel = floor.footprint.unwrap();
    assert!(
        floor.chamfer < 0.1 * pixel,
        "the floor is {:.3} pixels",
        floor.chamfer / pixel
    );
    assert!(
        median.chamfer < means.chamfer,
        "{} and {}",
        median.chamfer,
        means.chamfer
    );
    assert!(median.scores[2].f1 > 0.5, "{median:?}");
}

/// The table of docs/surfaces.md.
#[test]
#[ignore = "minutes of training; `cargo test --release --test device -- --ignored tables_of_meshes --nocapture`"]
fn tables_of_meshes() {
    let gpu = device::gpu();
    let size = Size {
        views: 32,
        width: 160,
        height: 120,
        iterations: 1_000,
    };
    for kind in [Kind::Plane, Kind::Sphere, Kind::Solids] {
        table(kind, &measured(&gpu, kind, &size));
    }
}
