//! Kernel sequence of a frame, from splats to an image.

use super::accuracy::Accuracy;
use super::band_replay::BandReplay;
use super::compositor::Compositor;
use super::depth_bands::{DepthBands, list_limit};
use super::instances::{FrameContent, Portion};
use super::model::Model;
use super::options::{RenderOptions, SplatOrder};
use super::projections::Projections;
use super::scratch::{DEPTH_SORT, Scratch, tile_sort};
use super::view::view_on;
use crate::Result;
use crate::gpu::{Buffer, Gpu, Groups, Recorder};
use crate::kernels::rasterize::{Outputs, SurfelMode};
use crate::kernels::scan::{Io as ScanBuffers, Scan, What};
use crate::kernels::sort::{self, Layout, Sort};
use crate::kernels::{compact, expand, gather, plan, project, ranges, rasterize, rasterize_inria, walker_bindings};
use crate::layout::*;
use crate::scene::{Primitive, Projection};

/// The kernels of a frame, compiled for one device.
#[derive(Debug)]
pub struct Forward {
    project: Projections,
    scan: Scan,
    plan: plan::Plan,
    compact: compact::Compact,
    sort: Sort,
    gather: gather::Gather,
    expand: expand::Expand,
    ranges: ranges::Ranges,
    compositor: Compositor,
    with_planes: bool,
    primitive: Primitive,
    group_limit: u32,
    list_limit: u32,
}

/// Workgroup size of the elementwise kernels, the divisor in `plan`.
const ELEMENTWISE: u32 = 64;

impl Forward {
    /// Compiles the kernels for training scenes up to `sh_degree`, with these outputs.
    ///
    /// # Errors
    /// [`Error::Config`] for an accuracy out of range.
    #[cfg_attr(not(feature = "train"), allow(dead_code, reason = "for gradients"))]
    pub(crate) fn for_training(gpu: &Gpu, sh_degree: u32, accuracy: &Accuracy, outputs: Outputs) -> Result<Forward> {
        let options = RenderOptions {
            sh_degree,
            accuracy: *accuracy,
            primitive: match outputs.surfels {
                SurfelMode::Absent => Primitive::Gaussian3d,
                SurfelMode::Any | SurfelMode::Mip => Primitive::Surfel,
            },
            ..RenderOptions::default()
        };
        Forward::new(gpu, &options, outputs)
    }

    /// Compiles the kernels for a renderer with these options, for pictures without limits of depth.
    pub(crate) fn for_rendering(gpu: &Gpu, options: &RenderOptions) -> Result<Forward> {
        let outputs = Outputs {
            limit: false,
            ..options.outputs()
        };
        Forward::new(gpu, options, outputs)
    }

    /// Compiles the kernels for a renderer with these options, for pictures with limits of depth.
    pub(crate) fn for_limits(gpu: &Gpu, options: &RenderOptions) -> Result<Forward> {
        Forward::new(gpu, options, options.outputs())
    }

    fn new(gpu: &Gpu, options: &RenderOptions, outputs: Outputs) -> Result<Forward> {
        let accuracy = &options.accuracy;
        accuracy.validate()?;
        let caps = gpu.caps();
        let listing = |degree| {
            let mut project = project::Choice::of_degree(degree);
            project.spec.precision = options.precision.code();
            project.spec.with_planes = outputs.surface.into();
            project.spec.with_limit = outputs.limit.into();
            project.spec.surfel = outputs.surfels.into();
            project.spec.by_distance = (options.order == SplatOrder::Distance).into();
            project.spec.orthographic = (options.projection == Projection::Orthographic).into();
            let mut expand = expand::Choice::prefer(caps);
            expand.spec.with_limit = outputs.limit.into();
            expand.spec.surfel = outputs.surfels.into();
            options.compatibility.listing(accuracy, project, expand)
        };
        let choices = (0..=options.sh_degree).map(|degree| listing(degree).0);
        Ok(Forward {
            project: Projections::new(gpu, choices.collect())?,
            scan: Scan::new(gpu)?,
            plan: plan::Plan::new(gpu, plan::Choice::default())?,
            compact: compact::Compact::new(gpu, compact::Choice::default())?,
            sort: Sort::new(gpu)?,
            gather: gather::Gather::new(gpu, gather::Choice::default())?,
            expand: expand::Expand::new(gpu, listing(0).1)?,
            ranges: ranges::Ranges::new(gpu, ranges::Choice::default())?,
            compositor: Compositor::new(gpu, options, outputs)?,
            with_planes: outputs.has_planes(),
            primitive: options.primitive,
            group_limit: caps.max_groups[0],
            list_limit: list_limit(caps.kind),
        })
    }

    /// Compiles the kernels that frames of a model with SH up to `sh_degree` need besides those of earlier ones; to be
    /// called before the first of them.
    pub(crate) fn prepare(&mut self, gpu: &Gpu, model: &Model, sh_degree: u32) -> Result<()> {
        self.project.prepare(gpu, model, false, sh_degree)
    }

    /// As [`Forward::prepare`], for a model of an instance.
    pub(super) fn prepare_instance(&mut self, gpu: &Gpu, model: &Model, sh_degree: u32) -> Result<()> {
        self.project.prepare(gpu, model, true, sh_degree)
    }

    /// True if the kernels are compiled.
    pub(super) fn is_prepared(&self, content: FrameContent<'_>, sh_degree: u32) -> bool {
        let mut models = content.models();
        models.all(|model| self.project.has(model, content.has_instances(), sh_degree))
    }

    /// Records a frame with SH up to `sh_degree`, in `bands`. The failed flag in `scratch.counts` is honoured, never
    /// cleared.
    pub(crate) fn record<'a>(
        &self,
        rec: &mut Recorder<'_>,
        content: impl Into<FrameContent<'a>>,
        scratch: &Scratch,
        view: &View,
        sh_degree: u32,
        bands: DepthBands,
    ) {
        let tiles = (view.tiles[0] * view.tiles[1]) as usize;
        let content = content.into();
        let s = scratch;
        self.record_projection(rec, content, s, view, sh_degree);
        self.order_by_depth(rec, s, content.splat_count());
        rec.timestamp("sort_depth");
        for band in 0..bands.count {
            self.list_band(rec, s, tiles, 1, (band, bands));
            self.composite(rec, s, tiles, (band, bands));
            if let Some(replay) = &s.replay {
                replay.keep(rec, &s.counts, &s.isect_end_from_pixel, band as usize);
            }
        }
    }

    /// Records only the projection of the splats to the screen.
    pub(crate) fn record_projection<'a>(
        &self,
        rec: &mut Recorder<'_>,
        content: impl Into<FrameContent<'a>>,
        s: &Scratch,
        view: &View,
        sh_degree: u32,
    ) {
        let content = content.into();
        rec.update(&s.view, 0, &[view_on(view, self.primitive)]);
        rec.update(&s.counts, COUNT_SPLAT as usize, &[content.splat_count() as u32]);
        for portion in content.portions() {
            self.project(rec, &portion, s, sh_degree);
        }
        rec.timestamp("project");
    }

    /// Lists a band's intersections by tile. `stage` of `plan`: 1 for the next band, 2 for one listed before.
    fn list_band(
        &self,
        rec: &mut Recorder<'_>,
        s: &Scratch,
        tiles: usize,
        stage: u32,
        (band, bands): (u32, DepthBands),
    ) {
        let params = plan::Params {
            stage,
            tile_count: tiles as u32,
            band,
            band_count: bands.count,
            rank_limit: bands.ranks,
            ..self.plan_params(s, tile_sort(tiles))
        };
        self.plan(rec, s, params);
        self.list_intersections(rec, s);
        rec.timestamp("expand");
        self.order_by_tile(rec, s, tiles);
        rec.timestamp("sort_tile");
    }

    /// Lists the pairs of a band of the last frame again. In `emitted_from_splat`, splats of other bands are then
    /// `NOT_LISTED`.
    #[cfg_attr(not(feature = "train"), allow(dead_code, reason = "for gradients"))]
    pub(crate) fn relist(
        &self,
        rec: &mut Recorder<'_>,
        s: &Scratch,
        replay: &BandReplay,
        tiles: usize,
        (band, bands): (u32, DepthBands),
    ) {
        replay.restore(rec, &s.counts, band);
        rec.fill(&s.emitted_from_splat, NOT_LISTED);
        self.list_band(rec, s, tiles, 2, (band, bands));
    }

    /// Projects every splat of a model to the screen, block by block. Elements behind its last are of no splat.
    fn project(&self, rec: &mut Recorder<'_>, portion: &Portion<'_>, s: &Scratch, sh_degree: u32) {
        let Portion { model, first, .. } = *portion;
        let gap = first + model.splat_count..portion.end;
        rec.fill(&s.tile_count_from_splat.part(gap), 0);
        for block in model.blocks.of(model.counts) {
            let at = model.places(&block);
            let splats = first + at.splats.start..first + at.splats.end;
            let kernel = self.project.of(model, portion.is_instance, sh_degree.min(block.degree));
            let plane_from_splat = match self.with_planes {
                true => s.plane_from_splat.part(splats.clone()),
                false => s.plane_from_splat.clone(),
            };
            kernel.record(
                rec,
                project::Bindings {
                    view: &s.view,
                    params: &model.params[block.index],
                    ellipse_from_splat: &s.ellipse_from_splat.part(splats.clone()),
                    whiten_rg_from_splat: &s.whiten_rg_from_splat.part(splats.clone()),
                    blue_depth_from_splat: &s.blue_depth_from_splat.part(splats.clone()),
                    tile_count_from_splat: &s.tile_count_from_splat.part(splats),
                    splat_from_slot: &at.splat_from_slot,
                    plane_from_splat: &plane_from_splat,
                    limit_from_tile: &s.limit_from_tile,
                },
                project::Params {
                    splat_count: block.count as u32,
                    stride: block.stride as u32,
                    ..portion.params
                },
                kernel.groups(block.count),
            );
        }
    }

    /// Composites a band behind the nearer ones.
    fn composite(&self, rec: &mut Recorder<'_>, s: &Scratch, tiles: usize, (band, bands): (u32, DepthBands)) {
        let emitted_from_isect = &s.emitted_from_isect[Forward::sorted_index(tiles)];
        let tile_stride = tile_stride(tiles);
        match &self.compositor {
            Compositor::Engine(kernel) => {
                let io = walker_bindings! {
                    rasterize, s, emitted_from_isect;
                    counts: &s.counts,
                    blue_depth_from_splat: &s.blue_depth_from_splat,
                    image: &s.image,
                    depth: &s.depth,
                    isect_end_from_pixel: &s.isect_end_from_pixel,
                    plane_from_splat: &s.plane_from_splat,
                    surface: &s.surface,
                    limit_from_pixel: &s.limit_from_pixel,
                };
                let params = rasterize::Params {
                    tile_stride,
                    band,
                    band_count: bands.count,
                };
                let groups = match band {
                    // Draws the background even without splats.
                    0 => Groups::Count(tiles as u32),
                    _ => Groups::indirect(&s.args, ARGS_TILE as usize),
                };
                kernel.record(rec, io, params, groups);
            }
            Compositor::Inria(kernel) => {
                let io = walker_bindings! {
                    rasterize_inria, s, emitted_from_isect;
                    blue_depth_from_splat: &s.blue_depth_from_splat,
                    image: &s.image,
                    depth: &s.depth,
                    isect_end_from_pixel: &s.isect_end_from_pixel,
                };
                assert_eq!(bands.count, 1, "a pixel that has ended is not told from others");
                let params = rasterize_inria::Params { tile_stride };
                kernel.record(rec, io, params, Groups::Count(tiles as u32));
            }
        }
        rec.timestamp("rasterize");
    }

    /// Index of the buffer of `emitted_from_isect` with the sorted list of an image of so many tiles.
    pub(crate) fn sorted_index(tiles: usize) -> usize {
        (tile_sort(tiles).passes % 2) as usize
    }

    fn plan_params(&self, s: &Scratch, layout: Layout) -> plan::Params {
        plan::Params {
            stage: 0,
            isect_capacity: s.capacity.isects as u32,
            chunk: self.sort.chunk(layout),
            chunks_per_group: self.sort.chunks_per_group,
            digit_count: layout.digit_count(),
            workgroup: ELEMENTWISE,
            scanned_per_group: self.scan.chunks_per_group,
            group_limit: self.group_limit,
            tile_count: 0,
            band: 0,
            band_count: 0,
            rank_limit: 0,
        }
    }

    fn plan(&self, rec: &mut Recorder<'_>, s: &Scratch, params: plan::Params) {
        self.plan.record(
            rec,
            plan::Bindings {
                counts: &s.counts,
                args: &s.args,
                isect_from_rank: &s.isect_from_rank,
            },
            params,
            Groups::Count(1),
        );
    }

    /// Compacts the visible splats in the order of their index and sorts them by depth: ties stay in that order. Then
    /// computes the offset of each one's intersections.
    fn order_by_depth(&self, rec: &mut Recorder<'_>, s: &Scratch, count: usize) {
        let io = ScanBuffers {
            counts: &s.counts,
            values: &s.tile_count_from_splat,
            offsets: &s.visible_from_splat,
            sums: &s.sums,
        };
        let visible = What {
            count_slot: COUNT_SPLAT,
            total_slot: COUNT_VISIBLE,
            flags: true,
        };
        self.scan.record(rec, io, visible, self.scan.groups(count));
        self.plan(rec, s, self.plan_params(s, DEPTH_SORT));
        self.compact.record(
            rec,
            compact::Bindings {
                counts: &s.counts,
                tile_count_from_splat: &s.tile_count_from_splat,
                visible_from_splat: &s.visible_from_splat,
                blue_depth_from_splat: &s.blue_depth_from_splat,
                depth_from_visible: &s.depth_from_visible[0],
                splat_from_visible: &s.splat_from_visible[0],
            },
            self.compact.groups(count),
        );
        let pairs = [&s.depth_from_visible[..], &s.splat_from_visible];
        self.sort(rec, s, pairs, DEPTH_SORT);
        self.gather.record(
            rec,
            gather::Bindings {
                counts: &s.counts,
                splat_from_rank: &s.splat_from_visible[0],
                tile_count_from_splat: &s.tile_count_from_splat,
                tile_count_from_rank: &s.tile_count_from_rank,
            },
            Groups::indirect(&s.args, ARGS_VISIBLE as usize),
        );
        let io = ScanBuffers {
            values: &s.tile_count_from_rank,
            offsets: &s.isect_from_rank,
            ..io
        };
        let isects = What {
            count_slot: COUNT_VISIBLE,
            total_slot: COUNT_ISECT,
            flags: false,
        };
        self.scan
            .record(rec, io, isects, Groups::indirect(&s.args, ARGS_VISIBLE_SCAN as usize));
    }

    fn list_intersections(&self, rec: &mut Recorder<'_>, s: &Scratch) {
        self.expand.record(
            rec,
            expand::Bindings {
                view: &s.view,
                counts: &s.counts,
                splat_from_rank: &s.splat_from_visible[0],
                isect_from_rank: &s.isect_from_rank,
                tile_count_from_splat: &s.tile_count_from_splat,
                ellipse_from_splat: &s.ellipse_from_splat,
                whiten_rg_from_splat: &s.whiten_rg_from_splat,
                tile_from_isect: &s.tile_from_isect[0],
                emitted_from_isect: &s.emitted_from_isect[0],
                splat_from_emitted: &s.splat_from_emitted,
                emitted_from_splat: &s.emitted_from_splat,
                blue_depth_from_splat: &s.blue_depth_from_splat,
                limit_from_tile: &s.limit_from_tile,
                plane_from_splat: &s.plane_from_splat,
            },
            Groups::indirect(&s.args, ARGS_EXPAND as usize),
        );
    }

    /// Sorts intersections by the bits of their tile alone; stable, which keeps the depth order within each tile.
    fn order_by_tile(&self, rec: &mut Recorder<'_>, s: &Scratch, tiles: usize) {
        let layout = tile_sort(tiles);
        let pairs = [&s.tile_from_isect[..], &s.emitted_from_isect];
        let sorted = self.sort(rec, s, pairs, layout);
        rec.fill(&s.range_from_tile, 0);
        self.ranges.record(
            rec,
            ranges::Bindings {
                counts: &s.counts,
                tile_from_isect: &s.tile_from_isect[sorted],
                range_from_tile: &s.range_from_tile,
            },
            ranges::Params {
                tile_count: tiles as u32,
                list_limit: self.list_limit,
            },
            Groups::indirect(&s.args, ARGS_ISECT as usize),
        );
    }

    fn sort(&self, rec: &mut Recorder<'_>, s: &Scratch, [keys, values]: [&[Buffer<u32>]; 2], layout: Layout) -> usize {
        let io = sort::Io {
            counts: &s.counts,
            args: &s.args,
            keys,
            values,
            table: &s.table,
            places: &s.places,
            sums: &s.sums,
        };
        self.sort.record(rec, &self.scan, io, layout)
    }
}

/// Stride through the tiles, coprime to their number, that spreads neighbours: a CPU device gives each thread a
/// contiguous share of the workgroups, and contiguous shares of the image differ in cost.
pub fn tile_stride(tiles: usize) -> u32 {
    let gcd = |mut a: usize, mut b: usize| {
        while b != 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    // Products of workgroup and stride must stay within 32 bits.
    let most = (u32::MAX as usize / tiles.max(1)).clamp(1, tiles.max(1));
    let start = ((tiles as f64 * 0.381_966) as usize).clamp(1, most);
    (start..=most).find(|&stride| gcd(stride, tiles) == 1).unwrap_or(1) as u32
}

#[cfg(test)]
mod tests {
    use super::tile_stride;

    #[test]
    fn the_tile_stride_reaches_every_tile_once() {
        for tiles in [1usize, 2, 3, 30, 1020, 4096, 16_320, 129_600] {
            let stride = tile_stride(tiles);
            let mut seen = vec![false; tiles];
            (0..tiles as u32).for_each(|group| seen[((group * stride) as usize) % tiles] = true);
            assert!(seen.iter().all(|&s| s), "{tiles} tiles, stride {stride}");
        }
    }
}
