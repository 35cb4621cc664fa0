//! Cases of compositing, and the input of all tile walkers: a scene, its lists and its pixels.

use super::{KernelCase, ScreenBuffers, counts, read};
use crate::Result;
use crate::gpu::{Buffer, Gpu, Groups};
use crate::kernels::rasterize::Outputs;
use crate::kernels::{baseline_16x16, rasterize, walker_bindings};
use crate::lab::bench::Work;
use crate::lab::bench::check::{Output, floats, words};
use crate::lab::bench::input::lists::{Lists, view, viewpoint};
use crate::lab::bench::input::scene::Scene;
use crate::layout::{BASELINE_TILE, NO_SPLAT, SPREAD_PLANES, View};
use crate::reference::frame::center;
use crate::reference::plane::{SurfacePixel, TangentPlane, surface};
use crate::reference::rasterize::{self as reference, blended, discontinuity_margin, median};
use crate::reference::tiles::Grid;
use crate::reference::{ScreenSplat, Splat, Thresholds};
use crate::render::{RenderOptions, tile_stride};
use rayon::prelude::*;
use std::rc::Rc;

/// Scene, its lists by tiles of some size, and its composited pixels.
pub struct Composite {
    /// The scene.
    pub scene: Scene,
    /// Its lists.
    pub lists: Lists,
    /// The splats in the order of depth, as the device sees them.
    pub splats: Vec<ScreenSplat<f64>>,
    /// Their planes.
    pub planes: Vec<TangentPlane>,
    /// By tile, nearest first: places in `splats`.
    pub ranks_from_tile: Vec<Vec<usize>>,
    /// Index in the scene of each of `splats`.
    pub splat_from_rank: Vec<usize>,
    /// By pixel.
    pub pixels: Vec<ExpectedPixel>,
}

/// Expected pixel.
#[derive(Clone, Copy, Debug)]
pub struct ExpectedPixel {
    /// Red, green, blue, transmittance.
    pub planes: [f64; 4],
    /// Σ weight · z of the means.
    pub depth: f64,
    /// Surface.
    pub surface: SurfacePixel,
    /// Splat at which the coverage reaches ½.
    pub median: Option<usize>,
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
    /// A scene by the engine's tiles.
    pub fn of(scene: Scene) -> Composite {
        let grid = Grid::new(scene.camera.width, scene.camera.height);
        Composite::over(scene, grid)
    }

    /// A scene by the square tiles of the 16 x 16 baseline.
    pub fn in_squares(scene: Scene) -> Composite {
        let grid = Grid {
            tile_width: BASELINE_TILE,
            tile_height: BASELINE_TILE,
            ..Grid::new(scene.camera.width, scene.camera.height)
        };
        Composite::over(scene, grid)
    }

    fn over(scene: Scene, grid: Grid) -> Composite {
        let lists = Lists::over(&scene, grid);
        let (splats, splat_from_rank) = crate::reference::frame::sorted(&lists.screen);
        let mut rank_from_splat = vec![0; lists.screen.len()];
        for (rank, &splat) in splat_from_rank.iter().enumerate() {
            rank_from_splat[splat] = rank;
        }
        let owners = lists.splat_from_isect();
        let ranks = |&[begin, end]: &[u32; 2]| {
            let slice = &owners[begin as usize..end as usize];
            slice.iter().map(|&splat| rank_from_splat[splat as usize]).collect()
        };
        let ranks_from_tile: Vec<Vec<usize>> = lists.range_from_tile.iter().map(ranks).collect();
        let at = viewpoint(&scene);
        let plane = |&splat: &usize| TangentPlane::of(&Splat::of(&scene.splats, splat), &at);
        let planes = splat_from_rank.iter().map(plane).collect();
        let mut composite = Composite {
            scene,
            lists,
            splats,
            planes,
            ranks_from_tile,
            splat_from_rank,
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

    /// Outputs of a frame in colour alone, by the kind of the splats.
    pub fn kernel_outputs(&self) -> Outputs {
        let options = RenderOptions {
            primitive: self.scene.splats.primitive,
            ..RenderOptions::default()
        };
        options.outputs()
    }

    /// The background as the device has it.
    pub fn background(&self) -> [f64; 3] {
        self.scene.options.background.map(|c| f64::from(c as f32))
    }

    fn expected_at(&self, pixel: usize) -> ExpectedPixel {
        let thresholds = Thresholds::ENGINE;
        let (tile, at) = self.place(pixel);
        let ranks = &self.ranks_from_tile[tile];
        let shown = reference::rasterize(&self.splats, ranks, at, self.background(), &thresholds);
        let margin = discontinuity_margin(&self.splats, ranks, at, &thresholds);
        let taken = blended(&self.splats, ranks, at, &thresholds);
        let place = taken.last().and_then(|last| ranks.binary_search(last).ok());
        let begin = self.lists.range_from_tile[tile][0];
        let [red, green, blue] = shown.color;
        ExpectedPixel {
            planes: [red, green, blue, shown.transmittance],
            depth: shown.depth,
            surface: surface(
                &self.splats,
                &self.planes,
                ranks,
                at,
                &thresholds,
                &viewpoint(&self.scene),
            ),
            median: median(&self.splats, ranks, at, &thresholds).map(|rank| self.splat_from_rank[rank]),
            end: place.map_or(0, |place| begin + place as u32 + 1),
            blended: taken.len() as u32,
            near: margin.nearest() <= 1e-4,
            capped: margin.alpha_max <= 2e-6,
        }
    }

    /// By source: whether a pixel of its tile is near a threshold.
    pub fn near_sources(&self) -> Vec<bool> {
        let mut near = vec![false; self.lists.range_from_tile.len()];
        for (pixel, expected) in self.pixels.iter().enumerate() {
            near[self.place(pixel).0] |= expected.near;
        }
        let isects = self.lists.isects.iter();
        isects.map(|isect| near[isect.tile as usize]).collect()
    }

    /// Sums terms of pixels by source: `of` maps a pixel, the ranks of its tile and its centre to terms with the rank
    /// of their splat, and `add` takes a source, a pixel and a term, pixel by pixel.
    pub fn fold_sources<T: Send>(
        &self,
        of: impl Fn(usize, &[usize], [f64; 2]) -> Vec<(usize, T)> + Sync,
        mut add: impl FnMut(usize, usize, &T),
    ) {
        let terms = |pixel| {
            let (tile, at) = self.place(pixel);
            of(pixel, &self.ranks_from_tile[tile], at)
        };
        let terms: Vec<_> = (0..self.pixels.len()).into_par_iter().map(terms).collect();
        for (pixel, terms) in terms.iter().enumerate() {
            let (tile, _) = self.place(pixel);
            let begin = self.lists.range_from_tile[tile][0] as usize;
            for (rank, term) in terms {
                let ranks = &self.ranks_from_tile[tile];
                let isect = begin + ranks.partition_point(|r| r < rank);
                add(self.lists.emitted_from_isect[isect] as usize, pixel, term);
            }
        }
    }

    /// Pixel–splat pairs that are blended: the work of a frame.
    pub fn work(&self) -> Work {
        let pairs = self.pixels.iter().map(|pixel| pixel.blended as usize);
        Work::of(pairs.sum(), "blended pairs")
    }

    /// Expected image, one plane after the other.
    pub fn planes(&self) -> Vec<f64> {
        let plane = |i: usize| self.pixels.iter().map(move |pixel| pixel.planes[i]);
        (0..4).flat_map(plane).collect()
    }

    /// An image beside the expected one, and the ends of the pixels' lists where there are some.
    ///
    /// An error of the exponent is a relative error of alpha, and compositing never amplifies that: at positions up to
    /// 16 px from the tile's corner, standard deviations from 0.55 px and residuals up to 3.3, it is
    /// 2 · 3.3 · ulp(16) / 0.55 = 1.2e-5, times the range of colours. Where an alpha or a transmittance meets its
    /// threshold, one splat of 1/255 or the last 1e-4 may flip.
    pub fn outputs(&self, planes: &[f32], ends: Option<&[u32]>) -> Vec<Output> {
        let near: Vec<bool> = self.pixels.iter().map(|pixel| pixel.near).collect();
        let four = [near.as_slice(), &near, &near, &near].concat();
        let image = Output::relative("image", floats(planes), self.planes(), 2e-5, 1.0);
        let mut outputs = vec![image.near(four, 1.0 / 255.0, 0.01)];
        if let Some(ends) = ends {
            let expected = self.pixels.iter().map(|pixel| f64::from(pixel.end)).collect();
            let output = Output::exact("ends", words(ends), expected);
            outputs.push(output.near(near, f64::INFINITY, 0.02));
        }
        outputs
    }
}

impl Composite {
    /// Splats at which the coverage reaches ½, beside the expected ones. Where the coverage before or behind a splat is
    /// near ½, its neighbour may be found.
    fn ids_output(&self, found: &[u32]) -> Output {
        let expected = |pixel: &ExpectedPixel| pixel.median.map_or(f64::from(NO_SPLAT), |splat| splat as f64);
        let near = |pixel: &ExpectedPixel| pixel.near || pixel.surface.margin < 2e-5;
        let output = Output::exact("ids", words(found), self.pixels.iter().map(expected).collect());
        output.near(self.pixels.iter().map(near).collect(), f64::INFINITY, 0.02)
    }
}

/// The lists on the device, and room for the image.
pub struct CompositeBuffers {
    pub(super) view: Buffer<View>,
    pub(super) range_from_tile: Buffer<[u32; 2]>,
    pub(super) emitted_from_isect: Buffer<u32>,
    pub(super) splat_from_emitted: Buffer<u32>,
    pub(super) splat_from_isect: Buffer<u32>,
    pub(super) ellipse_from_splat: Buffer<[f32; 4]>,
    pub(super) whiten_rg_from_splat: Buffer<[f32; 4]>,
    pub(super) blue_depth_from_splat: Buffer<[f32; 2]>,
    pub(super) image: Buffer<f32>,
    pub(super) depth: Buffer<f32>,
    pub(super) isect_end_from_pixel: Buffer<u32>,
    pub(super) plane_from_splat: Buffer<[f32; 3]>,
    surface: Buffer<f32>,
    limit_from_pixel: Buffer<f32>,
    counts: Buffer<u32>,
    pub(super) tiles: usize,
}

impl CompositeBuffers {
    /// Uploads the inputs of compositing.
    pub fn new(gpu: &Gpu, composite: &Composite) -> Result<CompositeBuffers> {
        let (lists, scene) = (&composite.lists, &composite.scene);
        let pixels = composite.pixels.len();
        let records = ScreenBuffers::new(gpu, &lists.records)?;
        Ok(CompositeBuffers {
            view: gpu.buffer_from("view", &[view(scene)])?,
            range_from_tile: gpu.buffer_from("range_from_tile", &lists.range_from_tile)?,
            emitted_from_isect: gpu.buffer_from("emitted_from_isect", &lists.emitted_from_isect)?,
            splat_from_emitted: gpu.buffer_from("splat_from_emitted", &lists.splat_from_emitted())?,
            splat_from_isect: gpu.buffer_from("splat_from_isect", &lists.splat_from_isect())?,
            ellipse_from_splat: records.shape,
            whiten_rg_from_splat: records.tone,
            blue_depth_from_splat: records.rest,
            image: gpu.buffer("image", 4 * pixels)?,
            depth: gpu.buffer("depth", pixels)?,
            isect_end_from_pixel: gpu.buffer("isect_end_from_pixel", pixels)?,
            plane_from_splat: gpu.buffer_from("plane_from_splat", &composite.packed_planes())?,
            surface: gpu.buffer("surface", SPREAD_PLANES as usize * pixels)?,
            limit_from_pixel: gpu.buffer("limit_from_pixel", 1)?,
            tiles: lists.grid.len() as usize,
            counts: counts(gpu, &[])?,
        })
    }

    /// Bindings of the engine's kernel.
    pub fn rasterize(&self) -> rasterize::Bindings<'_> {
        walker_bindings! {
            rasterize, self, &self.emitted_from_isect;
            counts: &self.counts,
            blue_depth_from_splat: &self.blue_depth_from_splat,
            image: &self.image,
            depth: &self.depth,
            isect_end_from_pixel: &self.isect_end_from_pixel,
            plane_from_splat: &self.plane_from_splat,
            surface: &self.surface,
            limit_from_pixel: &self.limit_from_pixel,
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
}

/// The engine's compositing with these outputs.
pub fn rasterize<'a>(
    gpu: &Gpu,
    composite: &'a Composite,
    outputs: Outputs,
) -> Result<KernelCase<'a, rasterize::Rasterize>> {
    let input = Rc::new(CompositeBuffers::new(gpu, composite)?);
    let found = input.clone();
    let mut case = KernelCase::new(composite.work());
    if outputs.has_planes() {
        case = case.without("blocks");
    }
    let case = case
        .tune(move |choice: &mut rasterize::Choice| *choice = choice.of_outputs(outputs))
        .erase(&input.image)
        .erase(&input.isect_end_from_pixel)
        .judge(move |gpu| {
            let (image, ends) = (read(gpu, &found.image)?, read(gpu, &found.isect_end_from_pixel)?);
            let mut all = composite.outputs(&image, outputs.ends.then_some(&ends));
            if outputs.ids {
                all.push(composite.ids_output(&ends));
            } else if !outputs.ends {
                all.push(Output::exact("ends", words(&ends), vec![f64::NAN; ends.len()]));
            }
            Ok(all)
        });
    let case = case.compare(&input.depth, move |found| {
        let depths = composite.pixels.iter().map(|pixel| pixel.depth);
        let expected = depths
            .map(|depth| if outputs.depth { depth } else { f64::NAN })
            .collect();
        let range = composite.splats.iter().map(|splat| splat.depth).fold(1.0, f64::max);
        let depth = Output::relative("depth", floats(&found), expected, 2e-5, range);
        let near = composite.pixels.iter().map(|pixel| pixel.near).collect();
        vec![depth.near(near, range / 255.0, 0.01)]
    });
    let case = case.compare(&input.surface, move |found| composite.surface_outputs(&found, outputs));
    Ok(case.commands(move |rec, kernel: &rasterize::Rasterize, _| {
        kernel.record(rec, input.rasterize(), input.params(), input.groups());
    }))
}

/// The baseline's compositing, of a scene in its square tiles.
pub fn baseline_16x16<'a>(
    gpu: &Gpu,
    composite: &'a Composite,
) -> Result<KernelCase<'a, baseline_16x16::Baseline16x16>> {
    let input = Rc::new(CompositeBuffers::new(gpu, composite)?);
    let found = input.clone();
    let case = KernelCase::new(composite.work())
        .erase(&input.image)
        .erase(&input.isect_end_from_pixel)
        .judge(move |gpu| {
            let (image, ends) = (read(gpu, &found.image)?, read(gpu, &found.isect_end_from_pixel)?);
            Ok(composite.outputs(&image, Some(&ends)))
        });
    Ok(case.commands(move |rec, kernel: &baseline_16x16::Baseline16x16, _| {
        let io = baseline_16x16::Bindings {
            view: &input.view,
            range_from_tile: &input.range_from_tile,
            splat_from_isect: &input.splat_from_isect,
            ellipse_from_splat: &input.ellipse_from_splat,
            whiten_rg_from_splat: &input.whiten_rg_from_splat,
            blue_depth_from_splat: &input.blue_depth_from_splat,
            image: &input.image,
            isect_end_from_pixel: &input.isect_end_from_pixel,
        };
        kernel.record(rec, io, input.groups());
    }))
}
