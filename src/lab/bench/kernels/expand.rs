//! One intersection for every tile that a splat touches.

use super::{ELEMENTWISE, Records, args, counts, read, sample, wanted};
use crate::Result;
use crate::gpu::{Buffer, Gpu, Groups};
use crate::kernels::expand::{Bindings, Choice, Expand, Spec};
use crate::lab::bench::check::{Output, words};
use crate::lab::bench::input::lists::{Lists, tiles_near, view};
use crate::lab::bench::input::pack::Splat2d;
use crate::lab::bench::input::scene::scattered;
use crate::lab::bench::{Bench, Unit, Work};
use crate::layout::{COUNT_BAND_END, View};
use crate::reference::Thresholds;
use crate::reference::frame::depth_order;
use crate::reference::tiles::{alpha_at_pixels, alpha_max};

/// Splats, pixels, and the largest standard deviation, pixels.
const INPUTS: [(usize, [u32; 2], f64); 2] =
    [(50_000, [480, 272], 3.0), (20_000, [1920, 1080], 60.0)];
/// Splats whose tiles are judged one by one.
const SAMPLES: usize = 500;
/// How far, relatively, an alpha may be from the cut for its tile to be listed or not (see the kernel's test).
const MARGIN: f64 = 0.01;

pub(super) fn run(bench: &mut Bench) -> Result<()> {
    let gpu = bench.gpu().clone();
    for (count, size, sigma) in INPUTS {
        let name = format!("{count}/{}x{}", size[0], size[1]);
        if wanted!(bench, expand, name, ELEMENTWISE, Work::default()).is_empty() {
            continue;
        }
        let scene = scattered(count, size, sigma, 0);
        let lists = Lists::new(&scene);
        let input = Input::new(&gpu, &lists, view(&scene))?;
        let work = Work::of(input.total, Unit::Isects)
            .moving(12 * input.total + (size_of::<Splat2d>() + 16) * input.order.len());
        for (variant, workgroup, case) in wanted!(bench, expand, name, ELEMENTWISE, work) {
            let spec = Spec {
                workgroup,
                ..Spec::default()
            };
            let kernel = Expand::new(&gpu, Choice { variant, spec })?;
            let args = args(&gpu, input.order.len(), workgroup)?;
            bench.trial(
                &case,
                |rec| rec.fill(&input.tile_from_isect, u32::MAX),
                |rec| kernel.record(rec, input.bindings(), Groups::indirect(&args, 0)),
                || input.outputs(&gpu),
            )?;
        }
    }
    Ok(())
}

/// The visible splats in order, with as many slots each as it may need.
struct Input<'a> {
    lists: &'a Lists,
    order: Vec<usize>,
    begins: Vec<u32>,
    total: usize,
    view: Buffer<View>,
    counts: Buffer<u32>,
    splat_from_rank: Buffer<u32>,
    isect_from_rank: Buffer<u32>,
    tile_count_from_splat: Buffer<u32>,
    records: Records,
    tile_from_isect: Buffer<u32>,
    emitted_from_isect: Buffer<u32>,
    splat_from_emitted: Buffer<u32>,
    emitted_from_splat: Buffer<u32>,
}

impl<'a> Input<'a> {
    fn new(gpu: &Gpu, lists: &'a Lists, view: View) -> Result<Input<'a>> {
        let order = depth_order(&lists.screen);
        let rooms: Vec<u32> = order.iter().map(|&splat| room(lists, splat)).collect();
        let (begins, total) = crate::reference::scan::scan(&rooms);
        let total = total as usize;
        let mut tile_counts = vec![0; lists.screen.len()];
        for (&splat, &room) in order.iter().zip(&rooms) {
            tile_counts[splat] = room;
        }
        let ranks: Vec<u32> = order.iter().map(|&splat| splat as u32).collect();
        Ok(Input {
            total,
            view: gpu.buffer_from("view", &[view])?,
            counts: counts(gpu, &[(COUNT_BAND_END, order.len() as u32)])?,
            splat_from_rank: gpu.buffer_from("ranks", &ranks)?,
            isect_from_rank: gpu.buffer_from("begins", &begins)?,
            tile_count_from_splat: gpu.buffer_from("tile_counts", &tile_counts)?,
            records: Records::new(gpu, &lists.records)?,
            tile_from_isect: gpu.buffer("tiles", total)?,
            emitted_from_isect: gpu.buffer("sources", total)?,
            splat_from_emitted: gpu.buffer("owners", total)?,
            emitted_from_splat: gpu.buffer("firsts", lists.screen.len())?,
            lists,
            order,
            begins,
        })
    }

    fn bindings(&self) -> Bindings<'_> {
        Bindings {
            view: &self.view,
            counts: &self.counts,
            splat_from_rank: &self.splat_from_rank,
            isect_from_rank: &self.isect_from_rank,
            tile_count_from_splat: &self.tile_count_from_splat,
            ellipse_from_splat: &self.records.shape,
            whiten_rg_from_splat: &self.records.tone,
            tile_from_isect: &self.tile_from_isect,
            emitted_from_isect: &self.emitted_from_isect,
            splat_from_emitted: &self.splat_from_emitted,
            emitted_from_splat: &self.emitted_from_splat,
        }
    }

    /// Which splat owns which slot, exactly; and of a sample of splats, how many tiles are missing or needless.
    fn outputs(&self, gpu: &Gpu) -> Result<Vec<Output>> {
        let found = read(gpu, &self.tile_from_isect)?;
        let end = |rank: usize| {
            self.begins
                .get(rank + 1)
                .map_or(self.total, |&b| b as usize)
        };
        let mut owners = Vec::with_capacity(self.total);
        for (rank, &splat) in self.order.iter().enumerate() {
            owners.resize(end(rank), splat as f64);
        }
        let mut faults = Vec::new();
        for rank in sample(self.order.len(), SAMPLES) {
            let slots = &found[self.begins[rank] as usize..end(rank)];
            faults.push(faults_of(self.lists, self.order[rank], slots));
        }
        let sound = vec![0.0; faults.len()];
        let sources = (0..self.total).map(|i| i as f64).collect();
        let found_sources = words(&read(gpu, &self.emitted_from_isect)?);
        let found_owners = words(&read(gpu, &self.splat_from_emitted)?);
        Ok(vec![
            Output::exact("sources", found_sources, sources),
            Output::exact("owners", found_owners, owners),
            Output::exact("tiles missing or needless", faults, sound),
        ])
    }
}

/// Tiles that a kernel may list for a splat.
fn room(lists: &Lists, splat: usize) -> u32 {
    let cut = Thresholds::ENGINE.alpha_min * (1.0 - MARGIN);
    let touched = |screen| {
        let near = tiles_near(screen, &lists.grid);
        near.filter(|&tile| alpha_max(screen, &lists.grid, tile) >= cut)
            .count() as u32
    };
    lists.screen[splat].as_ref().map_or(0, touched)
}

fn faults_of(lists: &Lists, splat: usize, slots: &[u32]) -> f64 {
    let Some(screen) = lists.screen[splat].as_ref() else {
        return slots.len() as f64;
    };
    let (grid, cut) = (&lists.grid, Thresholds::ENGINE.alpha_min);
    let needs = |tile: &u32| alpha_at_pixels(screen, grid, *tile) >= cut * (1.0 + MARGIN);
    let missing = tiles_near(screen, grid)
        .filter(needs)
        .filter(|tile| !slots.contains(tile))
        .count();
    // Slots left over go to the tile beyond the last.
    let needless = slots.iter().enumerate().filter(|&(i, &tile)| {
        let twice = slots[..i].contains(&tile);
        tile > grid.len()
            || (tile < grid.len()
                && (twice || alpha_max(screen, grid, tile) < cut * (1.0 - MARGIN)))
    });
    (missing + needless.count()) as f64
}
