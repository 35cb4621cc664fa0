//! The compatibility mode: frames by the rules of the 3DGS code, against the same rules in double precision.

use crate::common::scenes::{self, Scene};
use crate::stability::lab::{image_bound, lab, same, view_options, within};
use crate::stability::props::{OPAQUE, Prop, place, stage};
use ashfall::reference::frame::project_all;
use ashfall::reference::{Splat, Viewpoint, rasterize_inria};
use ashfall::render::{Accuracy, Compatibility, Model, RenderOptions, RenderedImage, Renderer};

/// Draws scenes by the rules of the 3DGS code.
fn draw(renderer: &mut Renderer, scene: &Scene) -> RenderedImage {
    let model = Model::upload(lab().gpu(), &scene.splats).unwrap();
    renderer.render(&model, &scene.camera, &view_options(scene)).unwrap()
}

fn renderer() -> Renderer {
    let options = RenderOptions {
        with_depth: true,
        compatibility: Compatibility::Inria,
        ..RenderOptions::default()
    };
    Renderer::new(lab().gpu(), options).unwrap()
}

/// Whether no splat is close to a change of its tiles, which would affect many pixels at once.
fn is_clear(scene: &Scene) -> bool {
    let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
    let screen = project_all(&Splat::<f64>::all(&scene.splats), &view);
    screen
        .iter()
        .flatten()
        .all(|splat| rasterize_inria::margin(splat) > 2e-4)
}

#[test]
fn frames_by_the_inria_rules() {
    let mut renderer = renderer();
    let (mut worst, mut compared, mut near) = (0.0f64, 0, 0);
    for seed in 0..40 {
        let make = if seed % 2 == 0 { scenes::gentle } else { scenes::hard };
        let scene = make(2000 + seed, 45, 97, 61, 1);
        if !is_clear(&scene) {
            continue;
        }
        compared += 1;
        let image = draw(&mut renderer, &scene);
        let (exact, nearest) = rasterize_inria::render(&scene.splats, &scene.camera, &scene.options);
        for (i, pixel) in exact.pixels.iter().enumerate() {
            if nearest[i] < 1e-4 {
                near += 1;
                continue;
            }
            worst = worst.max((f64::from(image.transmittance[i]) - pixel.transmittance).abs());
            for c in 0..3 {
                worst = worst.max((f64::from(image.rgb[i][c]) - pixel.color[c]).abs());
            }
        }
    }
    assert!(compared >= 5, "{compared} scenes without a splat at a threshold");
    assert!(near < compared * 97 * 61 / 20, "{near} pixels excused");
    within(
        "original",
        "mode",
        "frames by the rules of the 3DGS code",
        worst,
        image_bound(97, 0.55, 45, 1.5),
    );
}

/// Effects of those rules: the leak of a wall, the edge of a bright splat, the splat left out at the threshold.
#[test]
fn the_inria_rules_differ_where_they_should() {
    let mut renderer = renderer();
    let mut walls = stage(32, 32);
    let wall = |depth, color| Prop {
        depth,
        color,
        ..Prop::ball([16.0, 16.0], 4000.0, OPAQUE)
    };
    place(&mut walls, &wall(1.0, [1.0, 0.0, 0.0]));
    place(&mut walls, &wall(2.0, [0.0, 0.0, 1.0]));
    let image = draw(&mut renderer, &walls);
    // 1 − 0.99 passes the first wall, and the second would take the transmittance to 1e-4 or below.
    assert!(image.transmittance.iter().all(|t| (9e-5..=1.1e-2).contains(t)));
    let mut ball = stage(96, 96);
    place(&mut ball, &Prop::ball([40.3, 40.3], 8.0, OPAQUE));
    let (theirs, ours) = (draw(&mut renderer, &ball), lab().draw(&ball));
    let drawn = |image: &RenderedImage| image.transmittance.iter().filter(|&&t| t < 1.0).count();
    assert!(!same(&theirs, &ours) && drawn(&theirs) <= drawn(&ours));
    // The accuracy setting has no effect on these rules.
    let options = RenderOptions {
        with_depth: true,
        compatibility: Compatibility::Inria,
        accuracy: Accuracy {
            transmittance_min: 0.1,
            alpha_min: 0.1,
        },
        ..RenderOptions::default()
    };
    let mut coarse = Renderer::new(lab().gpu(), options).unwrap();
    assert!(same(&draw(&mut coarse, &ball), &theirs));
}
