//! Orthographic pictures beside the reference: of a model, and of an instance by another camera.

use crate::common::device;
use crate::common::scenes::{self, Scene};
use crate::surfaces::draw_with;
use ashfall::Error;
use ashfall::reference::frame::{margins, render_splats};
use ashfall::reference::{Splat, Viewpoint};
use ashfall::render::{Compatibility, Instance, Model, RenderOptions, Renderer, SplatOrder, ViewOptions};
use ashfall::scene::{Camera, Primitive, Projection, Similarity};
use glam::{DMat3, DVec3};

const ORTHOGRAPHIC: fn() -> RenderOptions = || RenderOptions {
    projection: Projection::Orthographic,
    with_depth: true,
    ..RenderOptions::default()
};

/// A scene around four units before its camera, 16 pixels a unit.
fn scene() -> Scene {
    let mut scene = scenes::gentle(71, 300, 65, 49, 3);
    scene.camera.focal /= 4.0;
    scene
}

/// Largest error of a picture's colours and of its sums of weighted depths, over the pixels away from discontinuities.
fn errors(scene: &Scene, projection: Projection, (rgb, depth): (&[[f32; 3]], &[f32])) -> [f64; 2] {
    let view = Viewpoint {
        projection,
        ..Viewpoint::on(&scene.splats, &scene.camera, &scene.options)
    };
    let splats = Splat::<f64>::all(&scene.splats);
    let expected = render_splats(&splats, &view, &scene.options).pixels;
    let margins = margins(&splats, &view, &scene.options);
    let inner: Vec<usize> = (0..expected.len()).filter(|&i| margins[i].nearest() > 1e-4).collect();
    assert!(2 * inner.len() > expected.len(), "{} pixels", inner.len());
    let mut worst = [0.0_f64; 2];
    for i in inner {
        for (found, wanted) in rgb[i].iter().zip(expected[i].color) {
            worst[0] = worst[0].max((f64::from(*found) - wanted).abs());
        }
        worst[1] = worst[1].max((f64::from(depth[i]) - expected[i].depth).abs());
    }
    worst
}

#[test]
fn orthographic_pictures_are_those_of_the_reference() {
    let (gpu, scene) = (device::gpu(), scene());
    let found = draw_with(&gpu, &scene, ORTHOGRAPHIC());
    let depth = found.depth;
    // Compositing errs by 2e-5 of the range (`Composite::outputs`), depths reach 6.
    let [color, z] = errors(&scene, Projection::Orthographic, (&found.rgb, &depth));
    assert!(color <= 2e-5 && z <= 6.0 * 2e-5, "{color}, {z}");
    let [other, _] = errors(&scene, Projection::Perspective, (&found.rgb, &depth));
    assert!(other > 0.1, "{other}: a perspective picture");
}

/// A model moved along with its camera gives the same picture; focal lengths are in pixels per world unit.
#[test]
fn orthographic_instances_are_those_of_the_reference() {
    let (gpu, scene) = (device::gpu(), scene());
    let place = Similarity {
        rotation: DMat3::from_axis_angle(DVec3::new(2.0, -1.0, 2.0) / 3.0, 1.25),
        scale: 8.0,
        translation: DVec3::new(30.0, -7.0, 11.0),
    };
    let camera = Camera {
        focal: scene.camera.focal / place.scale,
        rotation: scene.camera.rotation * place.rotation.transpose(),
        position: place.point(scene.camera.position),
        ..scene.camera
    };
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let instance = Instance {
        world_from_model: place,
        ..Instance::new(&model)
    };
    let view = ViewOptions {
        background: scene.options.background.map(|c| c as f32),
        near: (scene.options.near * place.scale) as f32,
        filter: scene.splats.filter,
    };
    let mut renderer = Renderer::new(&gpu, ORTHOGRAPHIC()).unwrap();
    let found = renderer.render_instances(&[instance], &camera, &view).unwrap();
    let depth: Vec<f32> = found.depth.iter().map(|z| z / 8.0).collect();
    // Rounded rows of the rotation err by 3u · 6 units · 16 pixels = 2e-5 px, of splats of a pixel and more: 0.61 of it
    // in each of about ten layers at a pixel.
    let [color, z] = errors(&scene, Projection::Orthographic, (&found.rgb, &depth));
    assert!(color <= 1.4e-4 && z <= 6.0 * 1.4e-4, "{color}, {z}");
}

#[test]
fn outputs_along_rays_are_refused_in_an_orthographic_projection() {
    let gpu = device::gpu();
    let refused = |options: RenderOptions| match Renderer::new(&gpu, options) {
        Err(Error::Unsupported { what }) => what,
        other => panic!("{:?}", other.map(|_| ())),
    };
    let with_surface = RenderOptions {
        with_surface: true,
        ..ORTHOGRAPHIC()
    };
    let surfels = RenderOptions {
        primitive: Primitive::Surfel,
        ..ORTHOGRAPHIC()
    };
    let by_distance = RenderOptions {
        order: SplatOrder::Distance,
        ..ORTHOGRAPHIC()
    };
    let inria = RenderOptions {
        compatibility: Compatibility::Inria,
        ..ORTHOGRAPHIC()
    };
    for (options, part) in [
        (with_surface, "surfaces"),
        (surfels, "surfels"),
        (by_distance, "distance"),
        (inria, "3DGS"),
    ] {
        let what = refused(options);
        assert!(what.contains(part) && what.contains("orthographic"), "{what}");
    }
}
