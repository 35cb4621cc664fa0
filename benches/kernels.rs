//! Compositing, forward and backward, in every variant and width that the device can run, over lists that
//! the oracle has made; and the device's copying, to hold the figures against.

mod common;
#[path = "../tests/common/lists.rs"]
mod lists;
#[path = "../tests/common/pack.rs"]
mod pack;
#[path = "../tests/common/scenes.rs"]
mod scenes;

use ashfall::bench::{Bench, Case, Unit, Work};
use ashfall::gpu::{Buffer, Gpu};
use ashfall::kernels::{rasterize, rasterize_backward};
use ashfall::layout::{TILE_PIXELS, View};
use ashfall::reference::Options;
use ashfall::render::tile_stride;
use ashfall::scene::{Camera, RenderMode, Splats};
use common::Outcome;
use glam::{DMat3, DVec2, DVec3};
use lists::Lists;
use scenes::{Random, Scene, Sketch, push};

fn main() -> Outcome<()> {
    common::run("kernels", |bench| {
        bench.copy_rate()?;
        for (name, width, height, sigma_max) in [("small", 480, 272, 3.0), ("large", 640, 480, 6.0)]
        {
            composite(bench, name, width, height, sigma_max)?;
        }
        Ok(())
    })
}

fn case(kernel: &str, input: &str, variant: &str, workgroup: u32, work: Work) -> Case {
    Case {
        input: format!("{kernel}/{input}"),
        variant: format!("{variant}/{workgroup}"),
        work,
    }
}

/// 50,000 splats all over the picture, their standard deviations log-uniform from 1 px.
fn splats_over(width: u32, height: u32, sigma_max: f64) -> Scene {
    let random = &mut Random::new(7);
    let size = DVec2::new(width.into(), height.into());
    let camera = Camera {
        width,
        height,
        focal: DVec2::splat(size.x),
        center: 0.5 * size,
        rotation: DMat3::IDENTITY,
        position: DVec3::ZERO,
    };
    let mut splats = Splats {
        mode: RenderMode::Default,
        ..Splats::default()
    };
    for _ in 0..50_000 {
        let sketch = Sketch {
            pixel: DVec2::new(random.between(0.0, size.x), random.between(0.0, size.y)),
            depth: random.between(2.0, 20.0),
            sigma: [0; 3].map(|_| random.log_between(1.0, sigma_max)),
            opacity_logit: random.between(-3.0, 3.0),
            color: [0; 3].map(|_| random.between(0.0, 1.0)),
        };
        push(&mut splats, &camera, &sketch, random);
    }
    let options = Options {
        near: 0.1,
        sh_degree: 0,
        ..Options::default()
    };
    Scene {
        splats,
        camera,
        options,
    }
}

/// What both directions read.
struct Input {
    view: Buffer<View>,
    range_from_tile: Buffer<[u32; 2]>,
    source_from_isect: Buffer<u32>,
    splat_from_source: Buffer<u32>,
    shape_from_splat: Buffer<[f32; 4]>,
    tone_from_splat: Buffer<[f32; 4]>,
    rest_from_splat: Buffer<[f32; 2]>,
    image: Buffer<f32>,
    depth: Buffer<f32>,
    end_from_pixel: Buffer<u32>,
}

impl Input {
    fn new(gpu: &Gpu, scene: &Scene, lists: &Lists) -> ashfall::Result<Input> {
        let pixels = (scene.camera.width * scene.camera.height) as usize;
        let (shapes, tones, rests) = pack::arrays(&lists.records);
        Ok(Input {
            view: gpu.buffer_from("view", &[lists::view(scene)])?,
            range_from_tile: gpu.buffer_from("range_from_tile", &lists.range_from_tile)?,
            source_from_isect: gpu.buffer_from("source_from_isect", &lists.source_from_isect)?,
            splat_from_source: gpu.buffer_from("splat_from_source", &lists.splat_from_source())?,
            shape_from_splat: gpu.buffer_from("shape_from_splat", &shapes)?,
            tone_from_splat: gpu.buffer_from("tone_from_splat", &tones)?,
            rest_from_splat: gpu.buffer_from("rest_from_splat", &rests)?,
            image: gpu.buffer("image", 4 * pixels)?,
            depth: gpu.buffer("depth", pixels)?,
            end_from_pixel: gpu.buffer("end_from_pixel", pixels)?,
        })
    }

    fn forward(&self) -> rasterize::Bindings<'_> {
        rasterize::Bindings {
            view: &self.view,
            range_from_tile: &self.range_from_tile,
            source_from_isect: &self.source_from_isect,
            splat_from_source: &self.splat_from_source,
            shape_from_splat: &self.shape_from_splat,
            tone_from_splat: &self.tone_from_splat,
            rest_from_splat: &self.rest_from_splat,
            image: &self.image,
            depth: &self.depth,
            end_from_pixel: &self.end_from_pixel,
        }
    }
}

/// The numbers of lanes that a variant is tried with.
fn widths(gpu: &Gpu, in_subgroup: bool) -> impl Iterator<Item = u32> {
    let most = if in_subgroup {
        gpu.caps().subgroup_size
    } else {
        32
    };
    [8, 16, 32].into_iter().filter(move |&lanes| lanes <= most)
}

fn composite(
    bench: &mut Bench,
    name: &str,
    width: u32,
    height: u32,
    sigma_max: f64,
) -> Outcome<()> {
    let gpu = bench.gpu().clone();
    let scene = splats_over(width, height, sigma_max);
    let lists = Lists::new(&scene);
    let input = Input::new(&gpu, &scene, &lists)?;
    let (isects, tiles) = (lists.isects.len(), lists.grid.len() as usize);
    println!("{name}: {width}x{height}, {isects} intersections");
    // Every pixel of every tile is held against every splat on its list, as far as it is looked at.
    let work = Work::of(isects * TILE_PIXELS as usize, Unit::Pairs);
    // Neighbouring tiles far apart, as the engine has them.
    let tile_stride = tile_stride(tiles);
    for &variant in rasterize::Variant::ALL {
        for workgroup in widths(&gpu, variant == rasterize::Variant::Subgroup) {
            let case = case("rasterize", name, variant.name(), workgroup, work);
            if !bench.wants(&case) || gpu.caps().supports(variant.info()).is_err() {
                continue;
            }
            let spec = rasterize::Spec {
                workgroup,
                ..rasterize::Spec::default()
            };
            let kernel = rasterize::Rasterize::new(&gpu, rasterize::Choice { variant, spec })?;
            let params = rasterize::Params { tile_stride };
            bench.measure_commands(
                &case,
                |_| {},
                |rec| kernel.record(rec, input.forward(), params, tiles),
            )?;
        }
    }
    // What the backward pass reads of the forward one.
    let choice = rasterize::Rasterize::prefer(gpu.caps(), false);
    let forward = rasterize::Rasterize::new(&gpu, choice)?;
    let params = rasterize::Params { tile_stride };
    gpu.run(|rec| forward.record(rec, input.forward(), params, tiles))?;
    backward(bench, name, &input, &lists, work)
}

fn backward(
    bench: &mut Bench,
    name: &str,
    input: &Input,
    lists: &Lists,
    work: Work,
) -> Outcome<()> {
    let gpu = bench.gpu().clone();
    let (isects, tiles) = (lists.isects.len(), lists.grid.len() as usize);
    let random = &mut Random::new(8);
    let d_image: Vec<f32> = (0..3 * input.depth.len())
        .map(|_| random.normal() as f32)
        .collect();
    let d_image = gpu.buffer_from("d_image", &d_image)?;
    let d_shape = gpu.buffer("d_shape_from_source", isects)?;
    let d_tone = gpu.buffer("d_tone_from_source", isects)?;
    let d_rest = gpu.buffer("d_rest_from_source", isects)?;
    for &variant in rasterize_backward::Variant::ALL {
        for workgroup in widths(&gpu, variant == rasterize_backward::Variant::Subgroup) {
            let case = case("rasterize_backward", name, variant.name(), workgroup, work);
            if !bench.wants(&case) || gpu.caps().supports(variant.info()).is_err() {
                continue;
            }
            let spec = rasterize_backward::Spec {
                workgroup,
                ..rasterize_backward::Spec::default()
            };
            let choice = rasterize_backward::Choice { variant, spec };
            let kernel = rasterize_backward::RasterizeBackward::new(&gpu, choice)?;
            let params = rasterize_backward::Params {
                tile_stride: tile_stride(tiles),
            };
            let io = rasterize_backward::Bindings {
                view: &input.view,
                range_from_tile: &input.range_from_tile,
                source_from_isect: &input.source_from_isect,
                splat_from_source: &input.splat_from_source,
                shape_from_splat: &input.shape_from_splat,
                tone_from_splat: &input.tone_from_splat,
                rest_from_splat: &input.rest_from_splat,
                image: &input.image,
                d_image: &d_image,
                end_from_pixel: &input.end_from_pixel,
                d_shape_from_source: &d_shape,
                d_tone_from_source: &d_tone,
                d_rest_from_source: &d_rest,
            };
            bench.measure_commands(&case, |_| {}, |rec| kernel.record(rec, io, params, tiles))?;
        }
    }
    Ok(())
}
