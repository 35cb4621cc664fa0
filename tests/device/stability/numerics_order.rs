//! Accuracy gained by the engine's numerics, second part: order, compositing, positions.

use crate::common::scenes::Random;
use crate::stability::compositing::column;
use crate::stability::lab::{Lesson, U, flat_gradient, lab, rows};
use crate::stability::numerics::gained;
use crate::stability::props::{OPAQUE, Prop, place, stage};
use crate::stability::sorting::{order_error, stack};
use ashfall::reference::frame::{depth_order, project_all, render_screen};
use ashfall::reference::linear::{matrix, transform, transpose};
use ashfall::reference::rasterize::raw_alpha;
use ashfall::reference::{Options, ScreenSplat, Splat, Thresholds, Viewpoint};
use glam::{DMat3, DVec3};

/// Depth keys of 18 bits, the rest of 32 after the tile index at 1920 × 1080.
#[test]
fn b02_full_depth_keys() {
    let lab = lab();
    for distance in [1.0, 10.0, 100.0, 1000.0] {
        let depths: Vec<f64> = (0..60)
            .map(|i| f64::from((distance * (1.0 + f64::from(i) / 3000.0)) as f32))
            .collect();
        let scene = stack(903, &depths);
        let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
        let screen = project_all(&Splat::<f64>::all(&scene.splats), &view);
        let exact = render_screen(&screen, 16, 16, &Options::default());
        let mut order = depth_order(&screen);
        order.sort_unstable();
        let key = |i: &usize| {
            let z = screen[*i].map_or(0.0, |s| s.depth);
            (((2.0 * z + 1.0) / (z + 1.0) - 1.0) * 262_144.0) as u32
        };
        order.sort_by_key(key);
        // Drawn in that order, by setting depths to ranks.
        let packed: Vec<Option<ScreenSplat<f64>>> = order
            .iter()
            .zip(1..)
            .map(|(&i, rank)| {
                screen[i].map(|s| ScreenSplat {
                    depth: f64::from(rank),
                    ..s
                })
            })
            .collect();
        let found = render_screen(&packed, 16, 16, &Options::default());
        let pairs = found.pixels.iter().zip(&exact.pixels);
        let naive = pairs
            .flat_map(|(f, e)| [0, 1, 2].map(|c| (f.color[c] - e.color[c]).abs()))
            .fold(0.0, f64::max);
        let ours = order_error(&scene, &lab.draw(&scene));
        // At a distance of 1 even 18 bits are enough.
        if naive > 1e-3 {
            gained(
                2,
                &format!("60 splats within 2 % of depth {distance}"),
                naive,
                ours,
                14.1 * 2.0 * U + 62.0 * U,
            );
        } else {
            assert!(distance < 50.0 && ours < 1e-5);
        }
    }
}

/// Opacities of a column.
fn opacities(random: &mut Random, count: usize, strength: f64) -> Vec<f64> {
    (0..count)
        .map(|_| random.between(0.001, 0.999).powf(strength))
        .collect()
}

#[test]
fn b03_include_last() {
    let lab = lab();
    let random = &mut Random::new(904);
    let (mut naive, mut ours) = (0.0f64, 0.0f64);
    for seed in 0..30 {
        let scene = column(&opacities(random, 60, 1.5), seed);
        let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
        let list: Vec<ScreenSplat<f64>> = project_all(&Splat::<f64>::all(&scene.splats), &view)
            .into_iter()
            .flatten()
            .collect();
        let image = lab.draw(&scene);
        // The full sum, and the sum without the splat that crosses 1e-4 and those behind it.
        let (mut whole, mut cut) = ([0.0f64; 3], [0.0f32; 3]);
        let (mut through, mut through_cut, mut open) = (1.0f64, 1.0f32, true);
        for splat in &list {
            let alpha = raw_alpha(splat, [0.5; 2]).min(Thresholds::ENGINE.alpha_max);
            if alpha < 1.0 / 255.0 {
                continue;
            }
            let next = through_cut * (1.0 - alpha as f32);
            open &= next >= 1e-4;
            for c in 0..3 {
                whole[c] += splat.color[c] * alpha * through;
                if open {
                    cut[c] += splat.color[c] as f32 * alpha as f32 * through_cut;
                }
            }
            through *= 1.0 - alpha;
            if open {
                through_cut = next;
            }
        }
        for c in 0..3 {
            naive = naive.max((f64::from(cut[c]) - whole[c]).abs());
            ours = ours.max((f64::from(image.rgb[0][c]) - whole[c]).abs());
        }
    }
    gained(3, "what the stop at T = 1e-4 leaves out", naive, ours, 1e-4 + 100.0 * U);
}

#[test]
fn b06_transmittance() {
    let lab = lab();
    let mut walls = stage(24, 20);
    let wall = |depth, color| Prop {
        depth,
        color,
        ..Prop::ball([12.0, 10.0], 4000.0, OPAQUE)
    };
    place(&mut walls, &wall(1.0, [1.0, 0.0, 0.0]));
    place(&mut walls, &wall(2.0, [0.0, 0.0, 1.0]));
    let leak = lab.draw(&walls).rgb.iter().map(|c| f64::from(c[2])).fold(0.0, f64::max);
    gained(
        6,
        "blue behind an opaque red wall",
        f64::from((1.0f32 - 0.99) * 0.99),
        leak,
        4e-5,
    );
    // dC/dα by the remaining colour, front to back, in single precision.
    for (count, through) in [(100usize, 2e-4), (1000, 2e-4)] {
        let each = 1.0 - through_root(through, count);
        let scene = column(&vec![each; count], 906);
        let stepped = lab.step(&scene, &Lesson::flat(&scene, 0));
        let exact = rows(&flat_gradient(&scene, stepped.near, 1.0));
        let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
        let list = project_all(&Splat::<f64>::all(&scene.splats), &view);
        let shade: Vec<f32> = list
            .iter()
            .flatten()
            .map(|s| (s.color.iter().sum::<f64>() / 3.0) as f32)
            .collect();
        let alpha: Vec<f32> = list.iter().flatten().map(|s| raw_alpha(s, [0.5; 2]) as f32).collect();
        let mut left = 0.0f32;
        let mut before = 1.0f32;
        for (a, c) in alpha.iter().zip(&shade) {
            left += a * before * c;
            before *= 1.0 - a;
        }
        let (mut naive, mut ours, mut before) = (0.0f64, 0.0f64, 1.0f32);
        for i in 0..count {
            let slope = f64::from(alpha[i]) * (1.0 - each);
            left -= alpha[i] * before * shade[i];
            let d = before * shade[i] - left / (1.0 - alpha[i]);
            naive = naive.max((f64::from(d) - exact[i][10] / slope).abs() / f64::from(before));
            ours = ours.max((stepped.row(i)[10] - exact[i][10]).abs() / slope / f64::from(before));
            before *= 1.0 - alpha[i];
        }
        gained(
            6,
            &format!("dC/dα over T, {count} splats to T = 2e-4"),
            naive,
            ours,
            5e-5,
        );
    }
}

fn through_root(through: f64, count: usize) -> f64 {
    through.powf(1.0 / count as f64)
}

#[test]
fn b07_differences_first() {
    let lab = lab();
    for distance in [1e4, 6e5, 5e6] {
        let mut scene = stage(64, 48);
        let random = &mut Random::new(907);
        for i in 0..200 {
            let pixel = [random.between(0.0, 64.0), random.between(0.0, 48.0)];
            place(
                &mut scene,
                &Prop {
                    depth: 50.0 + f64::from(i),
                    ..Prop::ball(pixel, 2.0, 0.0)
                },
            );
        }
        // A rotated camera with entries exact in f32, as the splats' are.
        let turn = DMat3::from_euler(glam::EulerRot::XYZ, 0.4, -0.7, 0.2);
        let turn = DMat3::from_cols_array(&turn.to_cols_array().map(|x| f64::from(x as f32)));
        let by = DVec3::new(distance, -distance * 0.5, 1e3).as_vec3().as_dvec3();
        for mean in &mut scene.splats.mean {
            *mean = (turn.transpose() * DVec3::from(mean.map(f64::from)) + by)
                .as_vec3()
                .to_array();
        }
        scene.camera.rotation = turn;
        scene.camera.position = by;
        let (records, tiles) = lab.records(&scene);
        let rows = matrix::<f64>(turn);
        let rows32 = rows.map(|row| row.map(|x| x as f32));
        let shift = transform(rows, by.to_array()).map(|x| -x as f32);
        let (mut naive, mut ours) = (0.0f64, 0.0f64);
        for (i, mean) in scene.splats.mean.iter().enumerate().filter(|(i, _)| tiles[*i] > 0) {
            let exact = transform(rows, (DVec3::from(mean.map(f64::from)) - by).to_array())[2];
            let found = transform(rows32, *mean)[2] + shift[2];
            naive = naive.max((f64::from(found) - exact).abs());
            ours = ours.max((f64::from(records[i].rest[1]) - exact).abs());
        }
        // Three products of differences up to 250, and their sums.
        gained(
            7,
            &format!("depth at {distance:.0e} from the origin, world units"),
            naive,
            ours,
            8.0 * 250.0 * U,
        );
        assert!(transpose(rows) != rows);
    }
}
