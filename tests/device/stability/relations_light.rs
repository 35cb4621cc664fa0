//! The metamorphic relations of compositing: weights, backgrounds, colours.

use crate::common::lists::{Lists, view};
use crate::common::pack::arrays;
use crate::stability::lab::{U, image_bound, lab, same, within};
use crate::stability::props::picked;

use crate::common::scenes::{self, Random, Scene};
use ashfall::gpu::Groups;
use ashfall::kernels::rasterize::{Bindings, Choice, Params, Rasterize, Spec, Variant};
use ashfall::layout::COUNT_SLOTS;
use ashfall::reference::frame::{center, discontinuity_margins, project_all, sorted};
use ashfall::reference::rasterize::{blended, layer};
use ashfall::reference::{Splat, Thresholds, Viewpoint};
use ashfall::render::RenderedImage;
use ashfall::scene::SH_C0;

/// A renderer draws the same picture after drawing others.
#[test]
fn m15_views_do_not_mix() {
    let lab = lab();
    let scene = scenes::gentle(215, 40, 48, 40, 2);
    let mut cameras = vec![scene.camera];
    let random = &mut Random::new(215);
    for (width, height) in [(97, 33), (16, 16), (48, 40)] {
        cameras.push(scenes::camera(random, width, height));
    }
    let seen = |camera: &ashfall::scene::Camera| {
        lab.draw(&Scene {
            camera: *camera,
            ..scene.clone()
        })
    };
    let once: Vec<RenderedImage> = cameras.iter().map(seen).collect();
    for (camera, once) in cameras.iter().zip(&once).rev() {
        assert!(same(&seen(camera), once), "another picture the second time");
    }
}

/// Removing splats changes a pixel by at most the sum of their original weights.
#[test]
fn m16_removal() {
    let lab = lab();
    let scene = scenes::gentle(216, 40, 40, 33, 0);
    let gone = |i: usize| i % 4 == 1;
    let kept: Vec<usize> = (0..40).filter(|&i| !gone(i)).collect();
    let other = Scene {
        splats: picked(&scene.splats, &kept),
        ..scene.clone()
    };
    let (whole, without) = (lab.draw(&scene), lab.draw(&other));
    let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
    let (list, splat_from_rank) = sorted(&project_all(&Splat::<f64>::all(&scene.splats), &view));
    let order: Vec<usize> = (0..list.len()).collect();
    let thresholds = Thresholds::ENGINE;
    let mut range = 1.0f64;
    for splat in &list {
        range = splat.color.iter().fold(range, |m, &c| m.max(c));
    }
    let mut worst = f64::NEG_INFINITY;
    for i in 0..whole.rgb.len() {
        let (mut through, mut weight) = (1.0, 0.0);
        for index in blended(&list, &order, center(i, 40), &thresholds) {
            let alpha = layer(&list[index], center(i, 40), &thresholds).map_or(0.0, |l| l.alpha);
            if gone(splat_from_rank[index]) {
                weight += alpha * through;
            }
            through *= 1.0 - alpha;
        }
        for c in 0..3 {
            let change = f64::from((whole.rgb[i][c] - without.rgb[i][c]).abs());
            worst = worst.max(change - range * weight);
        }
    }
    // The remainder is the rounding of both pictures, and the threshold at 1e-4, which moves.
    let bound = 2.0 * image_bound(40, 0.55, 40, range) + 1e-4 * range;
    within("rasterize", "M16", "change beyond the weights removed", worst, bound);
}

#[test]
fn m17_background() {
    let lab = lab();
    let scene = scenes::hard(217, 54, 40, 33, 1);
    let mut other = scene.clone();
    other.options.background = [0.9f32, 0.0, 0.4].map(f64::from);
    let (a, b) = (lab.draw(&scene), lab.draw(&other));
    let mut worst = 0.0f64;
    for i in 0..a.rgb.len() {
        assert_eq!(a.transmittance[i].to_bits(), b.transmittance[i].to_bits());
        for c in 0..3 {
            let behind = scene.options.background[c] - other.options.background[c];
            let change = f64::from(a.rgb[i][c]) - f64::from(b.rgb[i][c]);
            // Two roundings of each colour, relative to its size, which is up to 2 here.
            let size = f64::from(a.rgb[i][c].abs().max(b.rgb[i][c].abs())).max(1.0);
            worst = worst.max((change - f64::from(a.transmittance[i]) * behind).abs() / size);
        }
    }
    within("rasterize", "M17", "backgrounds exchanged", worst, 4.0 * U);
}

#[test]
fn m18_one_colour() {
    let lab = lab();
    let mut scene = scenes::gentle(218, 60, 40, 33, 0);
    scene.splats.sh.fill(0.25 / SH_C0);
    let image = lab.draw(&scene);
    let mut worst = 0.0f64;
    for i in 0..image.rgb.len() {
        let through = f64::from(image.transmittance[i]);
        for c in 0..3 {
            let expected = 0.75 * (1.0 - through) + through * scene.options.background[c];
            worst = worst.max((f64::from(image.rgb[i][c]) - expected).abs());
        }
    }
    // The sum of n weights and the product of as many factors round by (n + 2) U each; the colour by 4U.
    within(
        "rasterize",
        "M18",
        "one colour everywhere",
        worst,
        (2.0 * 62.0 + 4.0) * U,
    );
}

#[test]
fn m19_twice_in_one_place() {
    let lab = lab();
    let mut scene = scenes::gentle(219, 1, 40, 33, 0);
    scene.splats.opacity_logit[0] = 1.0;
    let once = lab.draw(&scene);
    scene.splats = picked(&scene.splats, &[0, 0]);
    let twice = lab.draw(&scene);
    let mut worst = 0.0f64;
    for (twice, once) in twice.transmittance.iter().zip(&once.transmittance) {
        worst = worst.max((f64::from(*twice) - f64::from(*once).powi(2)).abs());
    }
    within("rasterize", "M19", "a splat twice", worst, 4.0 * U);
}

/// Subgroup and shared-memory variants and any order of tiles give the same bits. Any number of lanes per tile gives
/// the same up to the rounding of rows, which each lane counts from its own first. (For the sort, see entry 49.)
#[test]
fn m22_workgroups_and_variants() {
    workgroups_and_variants(false);
}

/// The same behind a host's surfaces, which hide half of the splats in every other column.
#[test]
fn m22_workgroups_and_variants_behind_limits() {
    workgroups_and_variants(true);
}

fn workgroups_and_variants(with_limit: bool) {
    let lab = lab();
    let gpu = lab.gpu();
    let scene = scenes::hard(222, 90, 65, 47, 0);
    let lists = Lists::new(&scene);
    let (shapes, tones, rests) = arrays(&lists.records);
    let pixels = 65 * 47;
    let mut depths: Vec<f32> = rests.iter().map(|rest| rest[1]).filter(|z| z.is_finite()).collect();
    depths.sort_by(f32::total_cmp);
    let middle = depths[depths.len() / 2];
    let limits: Vec<f32> = (0..pixels)
        .map(|i| if i % 2 == 0 { f32::INFINITY } else { middle })
        .collect();
    let mut pictures: Vec<(u32, Vec<f32>)> = Vec::new();
    for &variant in Variant::ALL {
        if gpu.caps().supports(variant.info()).is_err() {
            continue;
        }
        for workgroup in [8, 16, 32] {
            if !gpu.caps().lanes_fit(variant.info(), workgroup) {
                continue;
            }
            for tile_stride in [1, 7] {
                let spec = Spec {
                    workgroup,
                    with_limit: with_limit.into(),
                    ..Spec::default()
                };
                let kernel = Rasterize::new(gpu, Choice { variant, spec }).unwrap();
                let image = gpu.buffer::<f32>("image", 4 * pixels).unwrap();
                let io = Bindings {
                    view: &gpu.buffer_from("view", &[view(&scene)]).unwrap(),
                    counts: &gpu.buffer_from("counts", &[0; COUNT_SLOTS as usize]).unwrap(),
                    range_from_tile: &gpu.buffer_from("ranges", &lists.range_from_tile).unwrap(),
                    emitted_from_isect: &gpu.buffer_from("sources", &lists.emitted_from_isect).unwrap(),
                    splat_from_emitted: &gpu.buffer_from("owners", &lists.splat_from_emitted()).unwrap(),
                    ellipse_from_splat: &gpu.buffer_from("shapes", &shapes).unwrap(),
                    whiten_rg_from_splat: &gpu.buffer_from("tones", &tones).unwrap(),
                    blue_depth_from_splat: &gpu.buffer_from("rests", &rests).unwrap(),
                    image: &image,
                    depth: &gpu.buffer("depth", pixels).unwrap(),
                    isect_end_from_pixel: &gpu.buffer("ends", pixels).unwrap(),
                    plane_from_splat: &gpu.buffer("planes", 1).unwrap(),
                    surface: &gpu.buffer("surface", 1).unwrap(),
                    limit_from_pixel: &gpu.buffer_from("limits", &limits).unwrap(),
                };
                let params = Params {
                    tile_stride,
                    band: 0,
                    band_count: 1,
                };
                let tiles = lists.grid.len() as usize;
                gpu.run(|rec| kernel.record(rec, io, params, Groups::Count(tiles as u32)))
                    .unwrap();
                let found: Vec<f32> = gpu.download(&image, 0..4 * pixels).unwrap();
                pictures.push((workgroup, found));
            }
        }
    }
    assert!(pictures.len() >= 6, "{} ways to composite", pictures.len());
    let bits = |picture: &[f32]| -> Vec<u32> { picture.iter().map(|x| x.to_bits()).collect() };
    let clear: Vec<bool> = discontinuity_margins(&scene.splats, &scene.camera, &scene.options)
        .iter()
        .map(|margin| margin.nearest() > 1e-4)
        .collect();
    let (lanes, first) = &pictures[0];
    let mut worst = 0.0f64;
    for (workgroup, picture) in &pictures {
        if workgroup == lanes {
            assert!(bits(picture) == bits(first), "another picture with as many lanes");
        }
        for (i, (a, b)) in picture.iter().zip(first).enumerate() {
            if clear[i % pixels] {
                worst = worst.max(f64::from((a - b).abs()));
            }
        }
    }
    // Rows up to 16 round by 16U twice, which changes an alpha by 0.61 / σ of that.
    let bound = 0.61 / 0.55 * 4.0 * 16.0 * U + 92.0 * U;
    within("rasterize", "M22", "lanes of a tile", worst, bound);
}
