//! Order by distance: beside the reference, at several turns of one camera.

use crate::common::device;
use crate::common::scenes;
use crate::surfaces::draw_with;
use ashfall::Error;
use ashfall::reference::frame::{by_distance, center, project_all, render_screen, sorted};
use ashfall::reference::rasterize::discontinuity_margin;
use ashfall::reference::{Splat, Viewpoint};
use ashfall::render::{Compatibility, RenderOptions, Renderer, SplatOrder};
use glam::{DMat3, DVec3};

const BY_DISTANCE: fn() -> RenderOptions = || RenderOptions {
    order: SplatOrder::Distance,
    ..RenderOptions::default()
};

#[test]
fn pictures_by_distance_are_those_of_the_reference() {
    let gpu = device::gpu();
    let mut scene = scenes::gentle(63, 300, 65, 49, 1);
    // Wide: depths along z and distances differ.
    scene.camera.focal *= 0.5;
    scene.splats.log_scale.iter_mut().flatten().for_each(|s| *s += 1.0);
    let rotation = scene.camera.rotation;
    let mut told = 0;
    for degrees in [0.0_f64, 7.0, -13.0] {
        let turned = DMat3::from_axis_angle(DVec3::Y, degrees.to_radians()) * rotation;
        // As the device has it.
        scene.camera.rotation = turned.as_mat3().as_dmat3();
        let found = draw_with(&gpu, &scene, BY_DISTANCE());
        let by_depth = draw_with(&gpu, &scene, RenderOptions::default());
        let at = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
        let splats = Splat::<f64>::all(&scene.splats);
        let mut screen = project_all(&splats, &at);
        by_distance(&mut screen, &splats, &at);
        let (width, height) = (scene.camera.width, scene.camera.height);
        let expected = render_screen(&screen, width, height, &scene.options);
        let (list, _) = sorted(&screen);
        let order: Vec<usize> = (0..list.len()).collect();
        let mut inner = 0;
        for (i, pixel) in expected.pixels.iter().enumerate() {
            let margin = discontinuity_margin(&list, &order, center(i, width as usize), &scene.options.thresholds);
            if margin.nearest() <= 1e-4 {
                continue;
            }
            inner += 1;
            let error = |rgb: [f32; 3]| {
                let off = rgb.iter().zip(pixel.color).map(|(a, b)| (f64::from(*a) - b).abs());
                off.fold(0.0, f64::max)
            };
            // Compositing errs by 2e-5 of the range (`Composite::outputs`).
            assert!(
                error(found.rgb[i]) <= 2e-5,
                "{degrees}, pixel {i}: {}",
                error(found.rgb[i])
            );
            told += usize::from(error(by_depth.rgb[i]) > 1e-3);
        }
        assert!(inner > expected.pixels.len() / 2, "{inner} pixels");
    }
    assert!(told > 100, "{told} pixels tell the order by depth");
}

#[test]
fn outputs_along_z_are_refused_by_distance() {
    let gpu = device::gpu();
    let refused = |options: RenderOptions| match Renderer::new(&gpu, options) {
        Err(Error::Unsupported { what }) => what,
        other => panic!("{:?}", other.map(|_| ())),
    };
    let ids = RenderOptions {
        with_ids: true,
        ..BY_DISTANCE()
    };
    assert!(refused(ids).contains("splats of pixels in the order of distance"));
    let depth = RenderOptions {
        with_depth: true,
        ..BY_DISTANCE()
    };
    assert!(refused(depth).contains("depths in the order"));
    let inria = RenderOptions {
        compatibility: Compatibility::Inria,
        ..BY_DISTANCE()
    };
    assert!(refused(inria).contains("3DGS"));
}
