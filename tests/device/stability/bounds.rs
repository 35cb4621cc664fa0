//! Section 3 of the catalogue, second part: pixels and tiles within an ellipse's bounds.

use crate::common::pack::arrays;
use crate::common::scenes::{self, Random};
use crate::stability::conic::{alpha_errors, needle, needles, on_screen};
use crate::stability::lab::{Lesson, U, image_bound, lab, same, view_options, within};
use crate::stability::props::{OPAQUE, Prop, logit, place, stage, with_copy};
use ashfall::gpu::Groups;
use ashfall::kernels::expand::{self, Expand};
use ashfall::layout::{COUNT_BAND_END, COUNT_SLOTS, DispatchArgs};
use ashfall::reference::primitive::extent;
use ashfall::reference::rasterize::raw_alpha;
use ashfall::reference::tiles::{Grid, alpha_max};
use ashfall::reference::{ScreenSplat, Splat, Thresholds, Viewpoint, project};
use ashfall::render::view_of;
use ashfall::scene::ScreenFilter;

/// The extent of the drawn ellipse is exact: no eigenvalues, no determinant.
#[test]
fn f031_radius() {
    let lab = lab();
    for (scene, name) in [
        (scenes::hard(331, 90, 64, 48, 0), "hard"),
        (needles(331, 1e3, 30), "aspect 1e3"),
    ] {
        let stepped = lab.step(&scene, &Lesson::flat(&scene, 0));
        let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
        let mut worst = 0.0f64;
        for (i, seen) in stepped.statistics.iter().enumerate().filter(|(_, s)| s[1] > 0.0) {
            let exact = project(&Splat::<f64>::of(&scene.splats, i), &view).unwrap();
            let [x, y] = extent(&exact, &Thresholds::ENGINE);
            // Near the threshold the level is a difference of logarithms, with 1e-5 added to it.
            if exact.opacity > 1.2 / 255.0 {
                worst = worst.max((f64::from(seen[2]) / x.max(y) - 1.0).abs());
            }
        }
        // The level is scaled by 1 + 1e-5, and 1e-5 is added to 2 ln 1.2 of it at least: half of both.
        within(
            "project",
            "31",
            &format!("extent, {name}"),
            worst,
            0.5e-5 + 0.5e-5 / 0.36 + 40.0 * U,
        );
    }
}

/// An opaque splat extends to 3.33 σ, not 3 σ: its rim has no visible edge.
#[test]
fn f032_rim_of_an_opaque_splat() {
    let lab = lab();
    let sigma = 9.0f64;
    let mut scene = stage(96, 96);
    place(&mut scene, &Prop::ball([48.0, 48.0], sigma, OPAQUE));
    let image = lab.draw(&scene);
    let exact = on_screen(&scene).unwrap();
    let wide = exact.covariance[0].sqrt();
    let (mut between, mut worst) = (0, 0.0f64);
    for (i, through) in image.transmittance.iter().enumerate() {
        let at = [(i % 96) as f64 + 0.5, (i / 96) as f64 + 0.5];
        let distance = (at[0] - exact.mean[0]).hypot(at[1] - exact.mean[1]) / wide;
        if distance > 3.3285 {
            assert_eq!(*through, 1.0, "drawn at {distance} σ");
        } else if distance > 3.0 && distance < 3.3283 {
            between += 1;
            worst = worst.max((1.0 - f64::from(*through) - raw_alpha(&exact, at)).abs());
        }
    }
    assert!(between > 400, "{between} pixels between 3 and 3.33 σ");
    within(
        "rasterize",
        "32",
        "alpha between 3 and 3.33 σ",
        worst,
        image_bound(96, sigma, 1, 1.0),
    );
}

/// Bounds of needles, computed from the covariance and not from its inverse, contain every drawn pixel.
#[test]
fn f033_bounds_of_needles() {
    for filter in [ScreenFilter::Classic, ScreenFilter::Mip] {
        for aspect in [1e3, 1e4, 1e5] {
            let random = &mut Random::new(333);
            let mut pixels = 0;
            for _ in 0..15 {
                // A lost pixel would show as an error of its whole alpha.
                let errors = alpha_errors(&needle(random, aspect, filter, 128));
                assert!(
                    errors.iter().all(|&e| e < 1.0 / 255.0),
                    "a pixel is lost at aspect {aspect:e}"
                );
                pixels += errors.len();
            }
            assert!(pixels > 100, "{pixels} pixels");
        }
    }
}

/// Ellipses with bounds beyond every integer.
#[test]
fn f034_bounds_beyond_integers() {
    let lab = lab();
    let scene = scenes::gentle(334, 12, 40, 33, 0);
    let clean = lab.draw(&scene);
    let camera = scene.camera;
    for pixel in [-3e9, -2_147_483_649.0, -1.0, 3e9, 4_294_967_296.0, 1e18, f64::INFINITY] {
        for log_scale in [-3.0f32, 3.0, 30.0] {
            let odd = with_copy(&scene, |splats, i| {
                let x = (pixel - camera.center.x) / camera.focal.x * 2.0;
                let at = camera.rotation.transpose() * glam::DVec3::new(x, 0.0, 2.0);
                splats.mean[i] = (camera.position + at).as_vec3().to_array();
                splats.log_scale[i] = [log_scale; 3];
                splats.opacity_logit[i] = 0.0;
            });
            let image = lab.draw(&odd);
            assert!(image.rgb.as_flattened().iter().all(|x| x.is_finite()));
            // A splat farther off than 1000 times its σ is invisible.
            let reach = f64::from(log_scale).exp() * camera.focal.x;
            if pixel.abs() > 1e3 * reach {
                assert!(
                    same(&image, &clean),
                    "a splat at {pixel:e} px shows, log-scale {log_scale}"
                );
            }
        }
    }
}

/// Number of tiles of a square image in which the rectangle spanned by the pixel centres meets the ellipse.
pub(crate) fn touched_tiles(splat: &ScreenSplat<f64>, side: u32) -> u32 {
    let grid = Grid::new(side, side);
    let over = |&tile: &u32| alpha_max(splat, &grid, tile) >= Thresholds::ENGINE.alpha_min;
    (0..grid.len()).filter(over).count() as u32
}

/// No tile is missed, and few are listed needlessly.
#[test]
fn f035_tiles_of_ellipses() {
    let lab = lab();
    let grid = Grid::new(512, 512);
    let (mut listed, mut touched) = (0.0, 0.0);
    for aspect in [1.0, 10.0, 1e2, 1e3, 1e4, 1e6] {
        let random = &mut Random::new(335);
        for _ in 0..25 {
            let mut scene = needle(random, aspect, ScreenFilter::Classic, 512);
            scene.splats.opacity_logit[0] = logit(random.log_between(0.01, 0.99));
            let (_, tiles) = lab.records(&scene);
            let Some(exact) = on_screen(&scene) else {
                continue;
            };
            let cut = Thresholds::ENGINE.alpha_min;
            let over = |cut: f64| (0..grid.len()).filter(|&t| alpha_max(&exact, &grid, t) >= cut).count() as u32;
            // Listed: every tile in which the rectangle of pixel centres meets the ellipse.
            assert!(
                tiles[0] >= over(cut * 1.001),
                "aspect {aspect}: {} tiles of {}",
                tiles[0],
                over(cut)
            );
            listed += f64::from(tiles[0]);
            touched += f64::from(over(cut));
        }
    }
    within(
        "project",
        "35",
        "tiles listed in vain, share",
        listed / touched - 1.0,
        0.1,
    );
}

/// Counts equal list lengths: no slot is unused and none is missing.
#[test]
fn f036_count_and_list() {
    let lab = lab();
    let gpu = lab.gpu();
    for scene in [scenes::hard(336, 180, 97, 129, 0), needles(336, 1e4, 60)] {
        let (records, tiles) = lab.records(&scene);
        let visible: Vec<u32> = (0..tiles.len() as u32).filter(|&i| tiles[i as usize] > 0).collect();
        let mut begins = Vec::new();
        let mut total = 0u32;
        for &splat in &visible {
            begins.push(total);
            total += tiles[splat as usize];
        }
        let mut counts = [0; COUNT_SLOTS as usize];
        counts[COUNT_BAND_END as usize] = visible.len() as u32;
        let view = view_of(&scene.camera, &view_options(&scene));
        let (shapes, tones, _) = arrays(&records);
        let sentinel = vec![u32::MAX; total as usize + 64];
        let [tile, source, owner] = [(); 3].map(|()| gpu.buffer_from("list", &sentinel).unwrap());
        let io = expand::Bindings {
            view: &gpu.buffer_from("view", &[view]).unwrap(),
            counts: &gpu.buffer_from("counts", &counts).unwrap(),
            splat_from_rank: &gpu.buffer_from("ranks", &visible).unwrap(),
            isect_from_rank: &gpu.buffer_from("begins", &begins).unwrap(),
            tile_count_from_splat: &gpu.buffer_from("tiles", &tiles).unwrap(),
            ellipse_from_splat: &gpu.buffer_from("shapes", &shapes).unwrap(),
            whiten_rg_from_splat: &gpu.buffer_from("tones", &tones).unwrap(),
            tile_from_isect: &tile,
            emitted_from_isect: &source,
            splat_from_emitted: &owner,
            emitted_from_splat: &gpu.buffer("begin", tiles.len()).unwrap(),
            blue_depth_from_splat: &gpu.buffer("rests", 1).unwrap(),
            limit_from_tile: &gpu.buffer("limits", 1).unwrap(),
            plane_from_splat: &gpu.buffer("planes", 1).unwrap(),
        };
        let args = DispatchArgs {
            x: (visible.len() as u32).div_ceil(64),
            y: 1,
            z: 1,
        };
        let args = gpu.buffer_from("args", &[args]).unwrap();
        let kernel = Expand::new(gpu, expand::Choice::default()).unwrap();
        gpu.run(|rec| kernel.record(rec, io, Groups::indirect(&args, 0)))
            .unwrap();
        let found = gpu.download(&tile, 0..sentinel.len()).unwrap();
        let (list, beyond) = found.split_at(total as usize);
        let last = view.tiles[0] * view.tiles[1];
        assert!(list.iter().all(|&t| t < last), "a slot that was counted is not listed");
        assert!(beyond.iter().all(|&t| t == u32::MAX), "written past what was counted");
        let owners = gpu.download(&owner, 0..total as usize).unwrap();
        for (rank, &splat) in visible.iter().enumerate() {
            let range = begins[rank] as usize..(begins[rank] + tiles[splat as usize]) as usize;
            assert!(owners[range.clone()].iter().all(|&o| o == splat));
            assert!(list[range].windows(2).all(|pair| pair[0] < pair[1]), "a tile twice");
        }
    }
}
