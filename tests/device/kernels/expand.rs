//! Tiles that splats are listed for.

use crate::common::check::*;
use crate::common::lists::{Lists, view};
use crate::common::{device, scenes};
use ashfall::gpu::Groups;
use ashfall::kernels::expand::{Bindings, Choice, Expand, Variant};
use ashfall::lab::bench::kernels::Workgroups;
use ashfall::lab::bench::kernels::expand::{expand, rooms};
use ashfall::layout::COUNT_BAND_END;

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
    let case = |(number, (name, scene)): (usize, (&'static str, scenes::Scene))| {
        let lists = Lists::new(&scene);
        let tiles = lists.grid.len();
        // Room for all tiles and two more, which must become padding; but only three for every fifth splat.
        let rooms = rooms(&lists, |rank, _| if rank % 5 == 4 { 3 } else { tiles + 2 });
        // In every other case, a band that begins at a third.
        let first_rank = if number % 2 == 1 { rooms.len() / 3 } else { 0 };
        (name, expand(&gpu, &scene, lists, &rooms, first_rank).unwrap())
    };
    let cases: Vec<_> = cases().into_iter().enumerate().map(case).collect();
    check.cases(&gpu, Workgroups::subgroups(&[1, 8, 64, 256]), &cases);
    check.finish();
}

#[test]
fn a_splat_may_cover_more_tiles_than_a_driver_runs_loops() {
    let gpu = device::gpu();
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
        blue_depth_from_splat: &buffer(&gpu, &[[0.0; 2]]),
        limit_from_tile: &unwritten(&gpu, 1),
        plane_from_splat: &unwritten(&gpu, 1),
    };
    let args = args(&gpu, 1, 64);
    for &variant in Variant::ALL {
        if gpu.caps().supports(variant.info()).is_err() {
            continue;
        }
        let choice = Choice {
            variant,
            ..Choice::default()
        };
        let kernel = Expand::new(&gpu, choice).unwrap();
        gpu.run(|rec| {
            rec.fill(&listed, u32::MAX);
            kernel.record(rec, io, Groups::indirect(&args, 0));
        })
        .unwrap();
        assert!(read(&gpu, &listed).into_iter().eq(0..tiles), "{variant:?}");
    }
}
