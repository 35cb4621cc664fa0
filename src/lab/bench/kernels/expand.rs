//! Case of `expand`: one intersection for every tile that a splat touches.

use super::{KernelCase, ScreenBuffers, counts, sample};
use crate::Result;
use crate::gpu::Gpu;
use crate::kernels::expand::{Bindings, Expand};
use crate::lab::bench::Work;
use crate::lab::bench::check::{Output, words};
use crate::lab::bench::input::lists::{Lists, tiles_near, view};
use crate::lab::bench::input::pack::Splat2d;
use crate::lab::bench::input::scene::{self, Scene};
use crate::layout::{COUNT_BAND_BASE, COUNT_BAND_BEGIN, COUNT_BAND_END};
use crate::reference::frame::depth_order;
use crate::reference::scan::scan;
use crate::reference::tiles::{alpha_at_pixels, alpha_max};
use crate::reference::{ScreenSplat, Thresholds};
use std::collections::BTreeSet;
use std::ops::Range;

/// Splats whose tiles are compared.
const SAMPLES: usize = 500;

/// Largest relative distance of an alpha to the cut for its tile to be listed or not: the kernel widens the squared
/// radius by 1e-5 relative and absolute, and the border by a thousandth of a pixel, which at a standard deviation of
/// half a pixel and three and a half of them out is exp(3.5 · 0.002) − 1.
const MARGIN: f64 = 0.01;

/// Scattered splats with as many slots each as it may need.
pub fn scattered<'a>(gpu: &Gpu, count: usize, size: [u32; 2], sigma_max: f64) -> Result<KernelCase<'a, Expand>> {
    let scene = scene::scattered(count, size, sigma_max, 0);
    let lists = Lists::new(&scene);
    let cut = Thresholds::ENGINE.alpha_min * (1.0 - MARGIN);
    let room = |_: usize, screen: &ScreenSplat<f64>| {
        let touched = |&tile: &u32| alpha_max(screen, &lists.grid, tile) >= cut;
        tiles_near(screen, &lists.grid).filter(touched).count() as u32
    };
    let rooms: Vec<u32> = rooms(&lists, room);
    expand(gpu, &scene, lists, &rooms, 0)
}

/// Slots of each splat, in the order of depth.
pub fn rooms(lists: &Lists, room: impl Fn(usize, &ScreenSplat<f64>) -> u32) -> Vec<u32> {
    let order = depth_order(&lists.screen).into_iter().enumerate();
    order
        .map(|(rank, splat)| lists.screen[splat].as_ref().map_or(0, |screen| room(rank, screen)))
        .collect()
}

/// The visible splats from `first_rank` on, in a band of their own, with so many slots each; slots left over become
/// padding.
pub fn expand<'a>(
    gpu: &Gpu,
    scene: &Scene,
    lists: Lists,
    rooms: &[u32],
    first_rank: usize,
) -> Result<KernelCase<'a, Expand>> {
    let order = depth_order(&lists.screen);
    let (mut begins, total) = scan(rooms);
    begins.push(total as u32);
    let base = begins[first_rank];
    let total = total as usize - base as usize;
    let mut tile_counts = vec![0; lists.screen.len()];
    for (&splat, &room) in order.iter().zip(rooms) {
        tile_counts[splat] = room;
    }
    let ranks: Vec<u32> = order.iter().map(|&splat| splat as u32).collect();
    let band = [
        (COUNT_BAND_BEGIN, first_rank as u32),
        (COUNT_BAND_END, order.len() as u32),
        (COUNT_BAND_BASE, base),
    ];
    let (view, counts) = (gpu.buffer_from("view", &[view(scene)])?, counts(gpu, &band)?);
    let splat_from_rank = gpu.buffer_from("splat_from_rank", &ranks)?;
    let isect_from_rank = gpu.buffer_from("isect_from_rank", &begins)?;
    let tile_counts = gpu.buffer_from("tile_count_from_splat", &tile_counts)?;
    let records = ScreenBuffers::new(gpu, &lists.records)?;
    let [tiles, sources, owners] = ["tile", "emitted", "splat"].map(|name| gpu.buffer::<u32>(name, total + 1));
    let (tiles, sources, owners) = (tiles?, sources?, owners?);
    let firsts = gpu.buffer::<u32>("emitted_from_splat", lists.screen.len())?;
    let limits = gpu.buffer::<f32>("limit_from_tile", 1)?;
    let planes = gpu.buffer::<[f32; 3]>("plane_from_splat", 1)?;
    let drawn = order.len() - first_rank;
    let slots = |rank: usize| (begins[rank] - base) as usize..(begins[rank + 1] - base) as usize;
    let (mut owner, mut first) = (Vec::new(), vec![f64::NAN; lists.screen.len()]);
    for rank in first_rank..order.len() {
        owner.extend(slots(rank).map(|_| order[rank] as f64));
        first[order[rank]] = slots(rank).start as f64;
    }
    let ranks = sample(drawn, SAMPLES).map(|i| first_rank + i);
    let sampled: Vec<_> = ranks.map(|rank| (order[rank], slots(rank))).collect();
    let work = Work::of(total, "isects").moving(12 * total + (size_of::<Splat2d>() + 16) * drawn);
    let case = KernelCase::new(work)
        .exact("sources", &sources, (0..total).map(|i| i as f64).collect())
        .exact("owners", &owners, owner)
        .exact("first sources", &firsts, first)
        .compare(&tiles, move |tiles| tile_outputs(&lists, &sampled, &tiles));
    Ok(case.commands(move |rec, kernel: &Expand, _| {
        let io = Bindings {
            view: &view,
            counts: &counts,
            splat_from_rank: &splat_from_rank,
            isect_from_rank: &isect_from_rank,
            tile_count_from_splat: &tile_counts,
            ellipse_from_splat: &records.shape,
            whiten_rg_from_splat: &records.tone,
            tile_from_isect: &tiles,
            emitted_from_isect: &sources,
            splat_from_emitted: &owners,
            emitted_from_splat: &firsts,
            blue_depth_from_splat: &records.rest,
            limit_from_tile: &limits,
            plane_from_splat: &planes,
        };
        kernel.record(rec, io, kernel.groups(drawn));
    }))
}

/// Every tile of the image for every compared splat: whether it is listed, has to be, and may be; and for every splat
/// the distinct entries of its slots, and one slot beyond the last, which must not be written.
fn tile_outputs(lists: &Lists, sampled: &[(usize, Range<usize>)], found: &[u32]) -> Vec<Output> {
    let (grid, cut) = (&lists.grid, Thresholds::ENGINE.alpha_min);
    let [mut member, mut needed, mut distinct, mut expected] = [(); 4].map(|()| Vec::new());
    let mut free = Vec::new();
    for (splat, slots) in sampled {
        let (Some(screen), slots) = (lists.screen[*splat].as_ref(), &found[slots.clone()]) else {
            continue;
        };
        let listed: BTreeSet<u32> = slots.iter().copied().collect();
        // No tile twice, and nothing but padding, the tile beyond the last, besides.
        let padding = slots.iter().filter(|&&tile| tile == grid.len()).count();
        distinct.push(listed.range(..=grid.len()).count() as f64);
        expected.push((slots.len() - padding + usize::from(padding > 0)) as f64);
        let near: BTreeSet<u32> = tiles_near(screen, grid).collect();
        let needs = |&tile: &u32| alpha_at_pixels(screen, grid, tile) >= cut * (1.0 + MARGIN);
        if padding == 0 && near.iter().filter(|tile| needs(tile)).count() > slots.len() {
            continue; // As many as fit.
        }
        for tile in 0..grid.len() {
            let is_needed = near.contains(&tile) && needs(&tile);
            let touched = near.contains(&tile) && alpha_max(screen, grid, tile) >= cut * (1.0 - MARGIN);
            member.push(f64::from(u8::from(listed.contains(&tile))));
            needed.push(f64::from(u8::from(is_needed)));
            free.push(!is_needed && touched);
        }
    }
    distinct.extend(words(&found[found.len() - 1..]));
    expected.push(f64::NAN);
    vec![
        // Tiles touched only between their pixel centres may be listed.
        Output::exact("tiles", member, needed).near(free, 1.0, 0.2),
        Output::exact("slots", distinct, expected),
    ]
}
