//! Splats of pixels and their depths: beside the reference, without a change of the picture, in bands.

use crate::common::device;
use crate::common::scenes;
use crate::surfaces::draw_with;
use ashfall::layout::NO_SPLAT;
use ashfall::reference::frame::{center, discontinuity_margins, project_all, sorted};
use ashfall::reference::rasterize::{median, weights};
use ashfall::reference::{Splat, Viewpoint};
use ashfall::render::RenderOptions;

const WITH_IDS: fn() -> RenderOptions = || RenderOptions {
    with_ids: true,
    ..RenderOptions::default()
};

#[test]
fn splats_of_pixels_are_those_of_the_reference() {
    let gpu = device::gpu();
    let (mut pixels, mut inner, mut covered) = (0, 0, 0);
    for scene in [scenes::gentle(61, 200, 65, 49, 2), scenes::hard(62, 180, 64, 48, 1)] {
        let found = draw_with(&gpu, &scene, WITH_IDS());
        let at = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
        let (list, splat_from_rank) = sorted(&project_all(&Splat::<f64>::all(&scene.splats), &at));
        let order: Vec<usize> = (0..list.len()).collect();
        let thresholds = &scene.options.thresholds;
        let margins = discontinuity_margins(&scene.splats, &scene.camera, &scene.options);
        for (i, margin) in margins.iter().enumerate() {
            let at = center(i, scene.camera.width as usize);
            let mut coverage = 0.0;
            let to_half = weights(&list, &order, at, thresholds).into_iter().map(|(_, weight)| {
                coverage += weight;
                f64::abs(coverage - 0.5)
            });
            // Weights err by 2e-5 at most (`Composite::outputs`).
            if margin.nearest() <= 1e-4 || to_half.fold(1.0, f64::min) <= 2e-5 {
                continue;
            }
            inner += 1;
            let (id, depth) = (found.ids[i], found.id_depth[i]);
            match median(&list, &order, at, thresholds) {
                None => assert_eq!((id, depth), (NO_SPLAT, f32::INFINITY), "pixel {i}"),
                Some(rank) => {
                    covered += 1;
                    assert_eq!(id as usize, splat_from_rank[rank], "pixel {i}");
                    assert!((f64::from(depth) / list[rank].depth - 1.0).abs() < 1e-5, "pixel {i}");
                }
            }
        }
        pixels += margins.len();
    }
    let is_told = inner > pixels / 2 && covered > pixels / 5 && covered + 50 < inner;
    assert!(is_told, "{covered} of {inner} of {pixels} pixels");
}

#[test]
fn splats_of_pixels_change_no_bit_of_the_picture() {
    let gpu = device::gpu();
    let scene = scenes::hard(62, 180, 64, 48, 1);
    let bits = |options| -> Vec<u32> {
        let image = draw_with(&gpu, &scene, options);
        let all = image.rgb.as_flattened().iter().chain(&image.transmittance);
        all.map(|x| x.to_bits()).collect()
    };
    assert!(bits(RenderOptions::default()) == bits(WITH_IDS()));
    assert!(draw_with(&gpu, &scene, RenderOptions::default()).ids.is_empty());
}
