//! Section 9 of the catalogue: the accumulated depth. Depth of surfaces: `tests/device/surfaces.rs`.
//!
//! * 87: splats are ellipsoids here; there are no discs that could stand edge-on.
//! * 88: as 87: there is no disc that could cross the camera's plane.
//! * 93: fusion needs no device: `tests/host/mesh.rs` has the volume that stays empty.
//! * 94: as 93; weights and colours of voxels are floats, which do not saturate.
//! * 95: as 93; `src/mesh/cubes.rs` tests all 256 cubes, `tests/host/mesh.rs` Euler's number.
//! * 96: nothing is triangulated from points.

use crate::common::scenes;
use crate::stability::lab::{Lesson, U, lab, within};
use crate::stability::props::{Prop, logit, place, stage};

/// Every exit of the projection sets the tile count to 0.
#[test]
fn f089_every_exit_says_so() {
    let lab = lab();
    let mut scene = scenes::hard(989, 180, 64, 48, 2);
    for (i, quaternion) in scene
        .splats
        .quaternion
        .iter_mut()
        .enumerate()
        .filter(|(i, _)| i % 7 == 0)
    {
        *quaternion = [[0.0; 4], [f32::NAN; 4]][i % 2];
    }
    let centre = scene.camera.position.as_vec3().to_array();
    scene.splats.mean[5] = centre;
    let (records, tiles) = lab.records(&scene);
    let most = (64 / 8) * (48 / 16);
    for (i, (record, &count)) in records.iter().zip(&tiles).enumerate() {
        // Fresh buffers hold 0x7FC0DEAD.
        assert!(count <= most, "splat {i} has {count:#x} tiles");
        assert!(
            !(count > 0 && record.shape[0].is_nan()),
            "splat {i} is listed without a record"
        );
    }
    assert!(tiles.iter().filter(|&&t| t == 0).count() > 30);
}

/// Statistics for density control are complete when read, and the same every time.
#[test]
fn f090_statistics_are_complete() {
    let lab = lab();
    let scene = scenes::hard(990, 120, 64, 48, 1);
    let lesson = Lesson::photo(&scene, 0.2);
    let once = lab.step(&scene, &lesson).statistics;
    for _ in 0..3 {
        assert!(
            lab.step(&scene, &lesson).statistics == once,
            "other statistics of the same step"
        );
    }
    let (_, tiles) = lab.records(&scene);
    for (i, (seen, &count)) in once.iter().zip(&tiles).enumerate() {
        assert_eq!(seen[1] > 0.0, count > 0, "splat {i}");
    }
}

/// The depth of a wall of small splats is that of the wall.
#[test]
fn f091_depth_of_a_plane() {
    let lab = lab();
    let mut scene = stage(64, 64);
    // z = 4 + x / 2 in world units; splats a pixel apart with a σ of 0.8 px, opaque.
    for i in 0..96 * 96 {
        let [px, py] = [i % 96 - 16, i / 96 - 16].map(|k| f64::from(k) + 0.5);
        let slope = (px - 32.0) / 64.0;
        let depth = 4.0 / (1.0 - 0.5 * slope);
        place(
            &mut scene,
            &Prop {
                depth,
                ..Prop::ball([px, py], 0.8, logit(0.9))
            },
        );
    }
    let image = lab.draw(&scene);
    let mut worst = 0.0f64;
    for i in 0..64 * 64 {
        let (x, y) = (i % 64, i / 64);
        if !(8..56).contains(&x) || !(8..56).contains(&y) {
            continue;
        }
        let mean = f64::from(image.depth[i]) / (1.0 - f64::from(image.transmittance[i]));
        let exact = 4.0 / (1.0 - 0.5 * ((x as f64 + 0.5 - 32.0) / 64.0));
        worst = worst.max((mean / exact - 1.0).abs());
    }
    // The depth is that of the centres. Nearer splats come first, so the mean is biased towards them, within two of
    // their σ of (0.8² + 0.3)^½ = 0.97 px; a pixel's step of depth is a relative 0.5 / 64 / (1 − 0.25).
    within(
        "rasterize",
        "91",
        "depth of a tilted plane, relative",
        worst,
        2.0 * 0.97 * 0.5 / 64.0 / 0.75,
    );
}

/// At low coverage the mean depth is still that of the splat; at zero coverage the sum is 0.
#[test]
fn f092_depth_of_hardly_anything() {
    let lab = lab();
    let mut scene = stage(48, 48);
    place(
        &mut scene,
        &Prop {
            depth: 7.0,
            ..Prop::ball([24.0, 24.0], 4.0, logit(0.02))
        },
    );
    let image = lab.draw(&scene);
    let mut worst = 0.0f64;
    for (depth, through) in image.depth.iter().zip(&image.transmittance) {
        let alpha = 1.0 - f64::from(*through);
        if alpha == 0.0 {
            assert_eq!(*depth, 0.0);
        } else {
            worst = worst.max((f64::from(*depth) / alpha / 7.0 - 1.0).abs());
        }
    }
    // 1 − T of an alpha of 1/255 has lost U · 255.
    within(
        "rasterize",
        "92",
        "mean depth at an alpha of 1/255",
        worst,
        2.0 * 255.0 * U,
    );
}
