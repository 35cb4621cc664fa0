//! Compositing, and what the oracle says it shows.

use super::{Records, counts, nothing, read, wanted};
use crate::Result;
use crate::gpu::{Buffer, Gpu, Groups};
use crate::kernels::{baseline_16x16, rasterize};
use crate::lab::bench::check::{Output, floats, words};
use crate::lab::bench::input::lists::{Lists, view};
use crate::lab::bench::input::scene::{Scene, scattered};
use crate::lab::bench::{Bench, Unit, Work};
use crate::layout::{BASELINE_TILE, View};
use crate::reference::frame::center;
use crate::reference::rasterize::{blended, discontinuity_margin, rasterize};
use crate::reference::tiles::Grid;
use crate::reference::{ScreenSplat, Thresholds};
use crate::render::tile_stride;
use rayon::prelude::*;

/// Splats, pixels, and the largest standard deviation, pixels: about 40 blended at a pixel.
pub(super) const INPUTS: [(&str, usize, [u32; 2], f64); 2] = [
    ("small", 50_000, [480, 272], 3.0),
    ("large", 50_000, [640, 480], 6.0),
];

/// Invocations that a tile's workgroup is tried with.
pub(super) const LANES: [u32; 3] = [8, 16, 32];

/// A scene, listed by tiles of some size, with what compositing it shows.
pub struct Composite {
    /// The scene.
    pub scene: Scene,
    /// Its lists.
    pub lists: Lists,
    /// The splats in the order of depth, as the device sees them.
    pub splats: Vec<ScreenSplat<f64>>,
    /// By tile, nearest first: places in `splats`.
    pub ranks_from_tile: Vec<Vec<usize>>,
    /// By pixel.
    pub pixels: Vec<Expected>,
}

/// What a pixel should be.
#[derive(Clone, Copy, Debug)]
pub struct Expected {
    /// Red, green, blue, transmittance.
    pub planes: [f64; 4],
    /// One past the last intersection that counts, 0 if none does.
    pub end: u32,
    /// Splats that are blended.
    pub blended: u32,
    /// Whether it is so near a threshold that rounding may carry it across.
    pub near: bool,
    /// Whether it is so near the cap of alphas that its gradient may jump.
    pub capped: bool,
}

impl Composite {
    /// By the engine's tiles.
    pub fn new(count: usize, size: [u32; 2], sigma_max: f64) -> Composite {
        Composite::over(count, Grid::new(size[0], size[1]), sigma_max)
    }

    /// By the square tiles of the baseline_16x16 design.
    pub fn baseline_16x16(count: usize, size: [u32; 2], sigma_max: f64) -> Composite {
        let grid = Grid {
            tile_width: BASELINE_TILE,
            tile_height: BASELINE_TILE,
            ..Grid::new(size[0], size[1])
        };
        Composite::over(count, grid, sigma_max)
    }

    fn over(count: usize, grid: Grid, sigma_max: f64) -> Composite {
        let scene = scattered(count, [grid.width, grid.height], sigma_max, 0);
        let lists = Lists::over(&scene, grid);
        let (splats, splat_from_rank) = crate::reference::frame::sorted(&lists.screen);
        let mut rank_from_splat = vec![0; lists.screen.len()];
        for (rank, &splat) in splat_from_rank.iter().enumerate() {
            rank_from_splat[splat] = rank;
        }
        let owners = lists.splat_from_isect();
        let ranks = |&[begin, end]: &[u32; 2]| {
            let slice = &owners[begin as usize..end as usize];
            slice
                .iter()
                .map(|&splat| rank_from_splat[splat as usize])
                .collect()
        };
        let ranks_from_tile: Vec<Vec<usize>> = lists.range_from_tile.iter().map(ranks).collect();
        let mut composite = Composite {
            scene,
            lists,
            splats,
            ranks_from_tile,
            pixels: Vec::new(),
        };
        let pixels = (grid.width * grid.height) as usize;
        let expected = |i| composite.expected_at(i);
        composite.pixels = (0..pixels).into_par_iter().map(expected).collect();
        composite
    }

    /// The tile and the centre of a pixel.
    pub fn place(&self, pixel: usize) -> (usize, [f64; 2]) {
        let at = center(pixel, self.lists.grid.width as usize);
        (self.lists.grid.tile_from_position(at) as usize, at)
    }

    /// The background as the device has it.
    pub fn background(&self) -> [f64; 3] {
        self.scene.options.background.map(|c| f64::from(c as f32))
    }

    fn expected_at(&self, pixel: usize) -> Expected {
        let thresholds = Thresholds::ENGINE;
        let (tile, at) = self.place(pixel);
        let ranks = &self.ranks_from_tile[tile];
        let shown = rasterize(&self.splats, ranks, at, self.background(), &thresholds);
        let margin = discontinuity_margin(&self.splats, ranks, at, &thresholds);
        let taken = blended(&self.splats, ranks, at, &thresholds);
        let place = taken.last().and_then(|last| ranks.binary_search(last).ok());
        let begin = self.lists.range_from_tile[tile][0];
        let [red, green, blue] = shown.color;
        Expected {
            planes: [red, green, blue, shown.transmittance],
            end: place.map_or(0, |place| begin + place as u32 + 1),
            blended: taken.len() as u32,
            near: margin.nearest() <= 1e-4,
            capped: margin.alpha_max <= 2e-6,
        }
    }

    /// Pixel–splat pairs that are blended: the work of a frame.
    pub fn work(&self) -> Work {
        let pairs = self.pixels.iter().map(|pixel| pixel.blended as usize);
        Work::of(pairs.sum(), Unit::Pairs)
    }

    /// One plane after the other of what should be seen.
    pub fn planes(&self) -> Vec<f64> {
        let plane = |i: usize| self.pixels.iter().map(move |pixel| pixel.planes[i]);
        (0..4).flat_map(plane).collect()
    }

    /// What was composited, held against it. Tolerances and shares are those of the kernel's test.
    pub fn outputs(&self, planes: &[f32], ends: Option<&[u32]>) -> Vec<Output> {
        let near: Vec<bool> = self.pixels.iter().map(|pixel| pixel.near).collect();
        let four = [near.as_slice(), &near, &near, &near].concat();
        let image = Output::relative("image", floats(planes), self.planes(), 2e-5, 1.0);
        let mut outputs = vec![image.near(four, 1.0 / 255.0, 0.01)];
        if let Some(ends) = ends {
            let expected = self
                .pixels
                .iter()
                .map(|pixel| f64::from(pixel.end))
                .collect();
            let output = Output::exact("ends", words(ends), expected);
            outputs.push(output.near(near, f64::INFINITY, 0.02));
        }
        outputs
    }
}

/// The lists on the device, and room for the image.
pub struct Input {
    pub(super) view: Buffer<View>,
    pub(super) range_from_tile: Buffer<[u32; 2]>,
    pub(super) emitted_from_isect: Buffer<u32>,
    pub(super) splat_from_emitted: Buffer<u32>,
    pub(super) splat_from_isect: Buffer<u32>,
    pub(super) records: Records,
    pub(super) image: Buffer<f32>,
    pub(super) depth: Buffer<f32>,
    pub(super) isect_end_from_pixel: Buffer<u32>,
    counts: Buffer<u32>,
    pub(super) tiles: usize,
}

impl Input {
    /// Uploads what compositing reads.
    pub fn new(gpu: &Gpu, composite: &Composite) -> Result<Input> {
        let (lists, scene) = (&composite.lists, &composite.scene);
        let pixels = composite.pixels.len();
        Ok(Input {
            view: gpu.buffer_from("view", &[view(scene)])?,
            range_from_tile: gpu.buffer_from("range_from_tile", &lists.range_from_tile)?,
            emitted_from_isect: gpu.buffer_from("emitted_from_isect", &lists.emitted_from_isect)?,
            splat_from_emitted: gpu
                .buffer_from("splat_from_emitted", &lists.splat_from_emitted())?,
            splat_from_isect: gpu.buffer_from("splat_from_isect", &lists.splat_from_isect())?,
            records: Records::new(gpu, &lists.records)?,
            image: gpu.buffer("image", 4 * pixels)?,
            depth: gpu.buffer("depth", pixels)?,
            isect_end_from_pixel: gpu.buffer("isect_end_from_pixel", pixels)?,
            tiles: lists.grid.len() as usize,
            counts: counts(gpu, &[])?,
        })
    }

    /// What the engine's kernel binds.
    pub fn rasterize(&self) -> rasterize::Bindings<'_> {
        rasterize::Bindings {
            view: &self.view,
            counts: &self.counts,
            range_from_tile: &self.range_from_tile,
            emitted_from_isect: &self.emitted_from_isect,
            splat_from_emitted: &self.splat_from_emitted,
            ellipse_from_splat: &self.records.shape,
            whiten_rg_from_splat: &self.records.tone,
            blue_depth_from_splat: &self.records.rest,
            image: &self.image,
            depth: &self.depth,
            isect_end_from_pixel: &self.isect_end_from_pixel,
        }
    }

    /// What the baseline binds.
    pub fn baseline_16x16(&self) -> baseline_16x16::Bindings<'_> {
        baseline_16x16::Bindings {
            view: &self.view,
            range_from_tile: &self.range_from_tile,
            splat_from_isect: &self.splat_from_isect,
            ellipse_from_splat: &self.records.shape,
            whiten_rg_from_splat: &self.records.tone,
            blue_depth_from_splat: &self.records.rest,
            image: &self.image,
            isect_end_from_pixel: &self.isect_end_from_pixel,
        }
    }

    /// One workgroup for each tile of the image.
    pub fn groups(&self) -> Groups<'static> {
        Groups::Count(self.tiles as u32)
    }

    /// Neighbouring tiles far apart, as the engine has them.
    pub fn params(&self) -> rasterize::Params {
        rasterize::Params {
            tile_stride: tile_stride(self.tiles),
            band: 0,
            band_count: 1,
        }
    }

    /// The image that the last run left, held against the oracle.
    pub fn image_outputs(&self, gpu: &Gpu, composite: &Composite) -> Result<Vec<Output>> {
        Ok(composite.outputs(&read(gpu, &self.image)?, None))
    }

    /// What the last run left, held against the oracle.
    pub fn outputs(&self, gpu: &Gpu, composite: &Composite) -> Result<Vec<Output>> {
        let (image, ends) = (
            read(gpu, &self.image)?,
            read(gpu, &self.isect_end_from_pixel)?,
        );
        Ok(composite.outputs(&image, Some(&ends)))
    }
}

pub(super) fn run(bench: &mut Bench) -> Result<()> {
    for (name, count, size, sigma) in INPUTS {
        engine(bench, name, count, size, sigma)?;
        baseline(bench, name, count, size, sigma)?;
    }
    Ok(())
}

fn engine(bench: &mut Bench, name: &str, count: usize, size: [u32; 2], sigma: f64) -> Result<()> {
    let gpu = bench.gpu().clone();
    if wanted!(bench, rasterize, name, LANES, Work::default()).is_empty() {
        return Ok(());
    }
    let composite = Composite::new(count, size, sigma);
    let input = Input::new(&gpu, &composite)?;
    let work = composite.work();
    for (variant, workgroup, case) in wanted!(bench, rasterize, name, LANES, work) {
        if !gpu.caps().lanes_fit(variant.info(), workgroup) {
            continue;
        }
        let spec = rasterize::Spec {
            workgroup,
            ..rasterize::Spec::default()
        };
        let kernel = rasterize::Rasterize::new(&gpu, rasterize::Choice { variant, spec })?;
        bench.trial(
            &case,
            nothing,
            |rec| kernel.record(rec, input.rasterize(), input.params(), input.groups()),
            || input.outputs(&gpu, &composite),
        )?;
    }
    Ok(())
}

fn baseline(bench: &mut Bench, name: &str, count: usize, size: [u32; 2], sigma: f64) -> Result<()> {
    let gpu = bench.gpu().clone();
    if wanted!(bench, baseline_16x16, name, [0], Work::default()).is_empty() {
        return Ok(());
    }
    let composite = Composite::baseline_16x16(count, size, sigma);
    let input = Input::new(&gpu, &composite)?;
    for (variant, _, case) in wanted!(bench, baseline_16x16, name, [0], composite.work()) {
        let choice = baseline_16x16::Choice {
            variant,
            ..baseline_16x16::Choice::default()
        };
        let kernel = baseline_16x16::Baseline16x16::new(&gpu, choice)?;
        bench.trial(
            &case,
            nothing,
            |rec| kernel.record(rec, input.baseline_16x16(), input.groups()),
            || input.outputs(&gpu, &composite),
        )?;
    }
    Ok(())
}
