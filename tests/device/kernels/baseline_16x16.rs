//! Baseline of compositing, with 16 × 16 tiles: the cases of `rasterize`.

use crate::common::check::*;
use crate::common::lists::{Lists, view};
use crate::common::scenes::Scene;
use crate::common::{device, pack};
use crate::kernels::rasterize::{cases, expected};
use crate::kernels::supported;
use ashfall::gpu::Groups;
use ashfall::kernels::baseline_16x16::{Baseline16x16, Bindings, Choice};
use ashfall::layout::BASELINE_TILE;
use ashfall::reference::tiles::Grid;

/// The lists of a scene by square tiles.
pub(crate) fn lists(scene: &Scene) -> Lists {
    let grid = Grid {
        tile_width: BASELINE_TILE,
        tile_height: BASELINE_TILE,
        ..Grid::new(scene.camera.width, scene.camera.height)
    };
    Lists::over(scene, grid)
}

#[test]
fn pixels_are_composited() {
    let gpu = device::gpu();
    let mut check = Check::new("baseline_16x16");
    for variant in supported!(baseline_16x16, gpu) {
        let choice = Choice {
            variant,
            ..Choice::default()
        };
        let kernel = Baseline16x16::new(&gpu, choice).unwrap();
        for (name, scene) in cases() {
            let lists = lists(&scene);
            let expected = expected(&scene, &lists);
            let pixels = expected.ends.len();
            let image = unwritten::<f32>(&gpu, 4 * pixels);
            let ends = unwritten::<u32>(&gpu, pixels);
            let (shapes, tones, rests) = pack::arrays(&lists.records);
            let io = Bindings {
                view: &buffer(&gpu, &[view(&scene)]),
                range_from_tile: &buffer(&gpu, &lists.range_from_tile),
                splat_from_isect: &buffer(&gpu, &lists.splat_from_isect()),
                ellipse_from_splat: &buffer(&gpu, &shapes),
                whiten_rg_from_splat: &buffer(&gpu, &tones),
                blue_depth_from_splat: &buffer(&gpu, &rests),
                image: &image,
                isect_end_from_pixel: &ends,
            };
            gpu.run(|rec| kernel.record(rec, io, Groups::Count(lists.grid.len())))
                .unwrap();
            let found = floats(&read(&gpu, &image));
            let [r, g, b, through, _] = &expected.planes;
            let near = &expected.near;
            let planes = [r.as_slice(), g, b, through].concat();
            let four = [near.as_slice(), near, near, near].concat();
            // The tolerances of `rasterize`, for the same reasons.
            check.outputs(
                name,
                vec![
                    Output::relative("planes", found, planes, 2e-5, 1.0).near(
                        four,
                        1.0 / 255.0,
                        0.01,
                    ),
                    Output::exact("ends", words(&read(&gpu, &ends)), expected.ends).near(
                        near.clone(),
                        f64::INFINITY,
                        0.02,
                    ),
                ],
            );
        }
    }
    check.finish();
}
