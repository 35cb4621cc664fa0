//! Error in a tile's pixels from the removal of each splat of its list.

use crate::common::check::*;
use crate::common::device;
use crate::common::lists::{Lists, view};
use crate::common::pack;
use crate::common::scenes::{Random, Scene};
use crate::kernels::contribution::{in_tiles, near};
use crate::kernels::lane_choices;
use crate::kernels::rasterize::{cases, expected as drawn};
use ashfall::gpu::{Gpu, Groups};
use ashfall::kernels::removal_error::{Bindings, Params, RemovalError as Kernel};
use ashfall::reference::Thresholds;
use ashfall::reference::removal_error::{RemovalError, removal_error};

struct Case {
    name: &'static str,
    scene: Scene,
    lists: Lists,
    /// Red, green and blue as drawn.
    image: Vec<f32>,
    errors: Vec<f32>,
    /// By source.
    expected: Vec<RemovalError>,
    /// By source: whether a pixel of its tile is near a threshold.
    near: Vec<bool>,
}

fn case((name, scene): (&'static str, Scene)) -> Case {
    let lists = Lists::new(&scene);
    let pixels = (lists.grid.width * lists.grid.height) as usize;
    let random = &mut Random::new(pixels as u64);
    let errors: Vec<f32> = (0..pixels)
        .map(|_| random.between(0.0, 1.0) as f32)
        .collect();
    let wide: Vec<f64> = errors.iter().map(|&x| f64::from(x)).collect();
    let background = scene.options.background.map(|c| f64::from(c as f32));
    let found = removal_error(
        &lists.screen,
        &lists.grid,
        background,
        &Thresholds::ENGINE,
        &wide,
    );
    let of = |isect| found.get(isect).copied().unwrap_or_default();
    let planes = drawn(&scene, &lists).planes;
    Case {
        expected: lists.isects.iter().map(of).collect(),
        near: in_tiles(&lists, &near(&lists)),
        image: planes[..3].iter().flatten().map(|&c| c as f32).collect(),
        name,
        scene,
        lists,
        errors,
    }
}

fn run(gpu: &Gpu, kernel: &Kernel, case: &Case) -> Vec<[f32; 3]> {
    let lists = &case.lists;
    let (shapes, tones, rests) = pack::arrays(&lists.records);
    let records = unwritten::<[f32; 3]>(gpu, lists.isects.len());
    let io = Bindings {
        view: &buffer(gpu, &[view(&case.scene)]),
        range_from_tile: &buffer(gpu, &lists.range_from_tile),
        emitted_from_isect: &buffer(gpu, &lists.emitted_from_isect),
        splat_from_emitted: &buffer(gpu, &lists.splat_from_emitted()),
        ellipse_from_splat: &buffer(gpu, &shapes),
        whiten_rg_from_splat: &buffer(gpu, &tones),
        blue_depth_from_splat: &buffer(gpu, &rests),
        image: &buffer(gpu, &case.image),
        error_from_pixel: &buffer(gpu, &case.errors),
        influence_from_source: &records,
    };
    let tiles = lists.grid.len() as usize;
    gpu.run(|rec| {
        kernel.record(
            rec,
            io,
            Params { tile_stride: 1 },
            Groups::Count(tiles as u32),
        )
    })
    .unwrap();
    read(gpu, &records)
}

#[test]
fn every_pair_has_its_influence() {
    let gpu = device::gpu();
    let mut check = Check::new("removal_error");
    let cases: Vec<Case> = cases().into_iter().map(case).collect();
    for choice in lane_choices!(removal_error, gpu) {
        let kernel = Kernel::new(&gpu, choice).unwrap();
        for case in &cases {
            let found = run(&gpu, &kernel, case);
            let column = |i: usize| found.iter().map(|r| f64::from(r[i])).collect::<Vec<_>>();
            let wanted =
                |of: fn(&RemovalError) -> f64| case.expected.iter().map(of).collect::<Vec<_>>();
            // Weights err as in `contribution`, and colours as in `rasterize`: 2e-5 of what there is. What that makes
            // of the changes is their slack, which they are judged in units of.
            let (tolerance, jump) = (2e-5, 2.0 / 255.0);
            let units = |changes: Vec<f64>| -> Vec<f64> {
                let of = |(change, wanted): (f64, &RemovalError)| change / wanted.slack.max(1e-30);
                changes.into_iter().zip(&case.expected).map(of).collect()
            };
            let near = || case.near.clone();
            let sums = |name, i, of| {
                Output::relative(name, column(i), wanted(of), tolerance, 128.0).near(
                    near(),
                    128.0 * jump,
                    0.02,
                )
            };
            let outputs = vec![
                sums("weight", 0, |i| i.weight),
                sums("error", 1, |i| i.error),
                Output::relative(
                    "change",
                    units(column(2)),
                    units(wanted(|i| i.change)),
                    tolerance,
                    1.0,
                )
                .near(near(), f64::INFINITY, 0.02),
            ];
            check.outputs(&format!("{}, {choice:?}", case.name), outputs);
        }
    }
    check.finish();
}
