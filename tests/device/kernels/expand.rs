//! Lists of the tiles that each splat touches.

use crate::common::check::*;
use crate::common::lists::{Lists, view};
use crate::common::{device, pack, scenes};
use crate::kernels::supported;
use ashfall::gpu::Groups;
use ashfall::kernels::expand::{Bindings, Choice, Expand, Spec};
use ashfall::layout::{COUNT_BAND_BASE, COUNT_BAND_BEGIN, COUNT_BAND_END};
use ashfall::reference::Thresholds;
use ashfall::reference::frame::depth_order;
use ashfall::reference::tiles::{alpha_at_pixels, alpha_max};
use std::collections::BTreeSet;

/// How far, relatively, an alpha may be from the cut for its tile to be listed or not: the kernel widens the
/// squared radius by 1e-5 relative and absolute, and the border by a thousandth of a pixel, which at a
/// standard deviation of half a pixel and three and a half of them out is exp(3.5 · 0.002) − 1.
const MARGIN: f64 = 0.01;

fn cases() -> Vec<(&'static str, scenes::Scene)> {
    vec![
        ("nothing to draw", scenes::gentle(1, 0, 33, 47, 0)),
        ("one", scenes::gentle(2, 1, 33, 47, 0)),
        ("one tile", scenes::gentle(3, 20, 8, 16, 0)),
        ("one pixel", scenes::gentle(4, 20, 1, 1, 0)),
        ("a row", scenes::hard(5, 40, 97, 1, 0)),
        ("a column", scenes::hard(6, 40, 1, 97, 0)),
        ("hard, odd size", scenes::hard(7, 90, 97, 129, 0)),
        ("crosses workgroups", scenes::gentle(8, 700, 130, 90, 0)),
    ]
}

#[test]
fn every_tile_with_a_pixel_is_listed_and_few_others() {
    let gpu = device::gpu();
    let mut check = Check::new("expand");
    for variant in supported!(expand, gpu) {
        for workgroup in [8, 64] {
            let spec = Spec {
                workgroup,
                ..Spec::default()
            };
            let kernel = Expand::new(&gpu, Choice { variant, spec }).unwrap();
            for (case, (name, scene)) in cases().into_iter().enumerate() {
                let lists = Lists::new(&scene);
                let order: Vec<u32> = depth_order(&lists.screen)
                    .iter()
                    .map(|&i| i as u32)
                    .collect();
                let tiles = lists.grid.len();
                // Room for all tiles and a few more, which must become padding; but only three for every
                // fifth splat, which must then not be exceeded.
                let room = |rank: usize| if rank % 5 == 4 { 3 } else { tiles + 2 };
                let begins: Vec<u32> = (0..=order.len())
                    .map(|rank| (0..rank).map(room).sum())
                    .collect();
                // In every other case, a band that begins at a third.
                let first_rank = if case % 2 == 1 { order.len() / 3 } else { 0 };
                let base = begins[first_rank];
                let total = (begins[order.len()] - base) as usize;
                let mut counts_by_splat = vec![0; scene.splats.len()];
                for (rank, &splat) in order.iter().enumerate() {
                    counts_by_splat[splat as usize] = room(rank);
                }
                let listed = unwritten::<u32>(&gpu, total + 1);
                let sources = unwritten::<u32>(&gpu, total + 1);
                let owners = unwritten::<u32>(&gpu, total + 1);
                let firsts = unwritten::<u32>(&gpu, scene.splats.len());
                let (shapes, tones, _) = pack::arrays(&lists.records);
                let band = [
                    (COUNT_BAND_BEGIN, first_rank as u32),
                    (COUNT_BAND_END, order.len() as u32),
                    (COUNT_BAND_BASE, base),
                ];
                let io = Bindings {
                    view: &buffer(&gpu, &[view(&scene)]),
                    counts: &counts(&gpu, &band),
                    splat_from_rank: &buffer(&gpu, &order),
                    isect_from_rank: &buffer(&gpu, &begins),
                    tile_count_from_splat: &buffer(&gpu, &counts_by_splat),
                    ellipse_from_splat: &buffer(&gpu, &shapes),
                    whiten_rg_from_splat: &buffer(&gpu, &tones),
                    tile_from_isect: &listed,
                    emitted_from_isect: &sources,
                    splat_from_emitted: &owners,
                    emitted_from_splat: &firsts,
                };
                let args = args(&gpu, order.len() - first_rank, workgroup);
                gpu.run(|rec| kernel.record(rec, io, Groups::indirect(&args, 0)))
                    .unwrap();

                let found = read(&gpu, &listed);
                let (mut member, mut must, mut free) = (Vec::new(), Vec::new(), Vec::new());
                let (mut owner, mut first) = (Vec::new(), vec![f64::NAN; scene.splats.len()]);
                for (rank, &splat) in order.iter().enumerate().skip(first_rank) {
                    let slots = (begins[rank] - base) as usize..(begins[rank + 1] - base) as usize;
                    owner.extend(slots.clone().map(|_| f64::from(splat)));
                    first[splat as usize] = slots.start as f64;
                    let slice = &found[slots];
                    assert!(slice.iter().all(|&t| t <= tiles), "{name}: {slice:?}");
                    let set: BTreeSet<u32> = slice.iter().copied().collect();
                    let real = slice.iter().filter(|&&tile| tile < tiles).count();
                    let padding = slice.len() - real;
                    assert_eq!(
                        set.len(),
                        real + usize::from(padding > 0),
                        "{name}: listed twice"
                    );
                    if rank % 5 == 4 {
                        continue;
                    }
                    let screen = lists.screen[splat as usize].as_ref().unwrap();
                    for tile in 0..tiles {
                        let at_pixels = alpha_at_pixels(screen, &lists.grid, tile);
                        let at_most = alpha_max(screen, &lists.grid, tile);
                        let cut = Thresholds::ENGINE.alpha_min;
                        let needed = at_pixels >= cut * (1.0 + MARGIN);
                        member.push(f64::from(u8::from(set.contains(&tile))));
                        must.push(f64::from(u8::from(needed)));
                        free.push(!needed && at_most >= cut * (1.0 - MARGIN));
                    }
                }
                owner.push(f64::NAN);
                let mut source: Vec<f64> = (0..total).map(|i| i as f64).collect();
                source.push(f64::NAN);
                let firsts = words(&read(&gpu, &firsts))[..first.len()].to_vec();
                let sources = words(&read(&gpu, &sources));
                let owners = words(&read(&gpu, &owners));
                check.outputs(
                    name,
                    vec![
                        // Tiles touched only between their pixel centres may be listed.
                        Output::exact("tiles", member, must).near(free, 1.0, 0.2),
                        Output::exact("sources", sources, source),
                        Output::exact("owners", owners, owner),
                        Output::exact("first sources", firsts, first),
                    ],
                );
            }
        }
    }
    check.finish();
}

#[test]
fn a_splat_may_cover_more_tiles_than_a_driver_runs_loops() {
    let gpu = device::gpu();
    let kernel = Expand::new(&gpu, Choice::default()).unwrap();
    let scene = scenes::gentle(9, 1, 8192, 1200, 0);
    let view = view(&scene);
    let tiles = view.tiles[0] * view.tiles[1];
    assert!(tiles > 65_535);
    // Ten thousand pixels wide, about the middle.
    let (shape, tone): ([f32; 4], [f32; 4]) = ([4096.0, 600.0, 0.0, -0.1], [1e-4, 1e-4, 0.5, 0.5]);
    let listed = unwritten::<u32>(&gpu, tiles as usize);
    let io = Bindings {
        view: &buffer(&gpu, &[view]),
        counts: &counts(&gpu, &[(COUNT_BAND_END, 1)]),
        splat_from_rank: &buffer(&gpu, &[0]),
        isect_from_rank: &buffer(&gpu, &[0]),
        tile_count_from_splat: &buffer(&gpu, &[tiles]),
        ellipse_from_splat: &buffer(&gpu, &[shape]),
        whiten_rg_from_splat: &buffer(&gpu, &[tone]),
        tile_from_isect: &listed,
        emitted_from_isect: &unwritten(&gpu, tiles as usize),
        splat_from_emitted: &unwritten(&gpu, tiles as usize),
        emitted_from_splat: &unwritten(&gpu, 1),
    };
    let args = args(&gpu, 1, 64);
    gpu.run(|rec| kernel.record(rec, io, Groups::indirect(&args, 0)))
        .unwrap();
    assert!(read(&gpu, &listed).into_iter().eq(0..tiles));
}
