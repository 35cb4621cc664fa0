//! From sums over pixels to the gradient of every parameter.

use crate::common::check::*;
use crate::common::lists::{view, viewpoint};
use crate::common::pack::Splat2d;
use crate::common::scenes::{self, Random, Scene};
use crate::common::{device, pack};
use crate::kernels::supported;
use ashfall::gpu::Gpu;
use ashfall::kernels::project_backward::{Bindings, Choice, Params, ProjectBackward, Spec};
use ashfall::layout::COUNT_FAILED;
use ashfall::reference::primitive::extent;
use ashfall::reference::project::margins;
use ashfall::reference::project_backward::{Penalties, penalty_backward};
use ashfall::reference::smoothing::{smoothed, smoothed_backward};
use ashfall::reference::{Splat, Thresholds, project};
use ashfall::render::planes_from_splats;
use ashfall::scene::ScreenFilter;

const OPACITY_PENALTY: f32 = 0.125;
const SCALE_PENALTY: f32 = 0.5;
const SIZE_PENALTY: f32 = 0.75;
/// Statistics as they were before.
const SEEN: [f32; 4] = [0.5, 3.0, 2.0, 7.0];

/// The inputs, and what should come of them.
#[derive(Default)]
struct Case {
    records: Vec<Splat2d>,
    tile_counts: Vec<u32>,
    begins: Vec<u32>,
    shape: Vec<[f32; 4]>,
    tone: Vec<[f32; 4]>,
    rest: Vec<f32>,
    filters: Vec<f32>,
    rows: Vec<Vec<f64>>,
    statistics: Vec<f64>,
}

/// With the 3D filters of its splats, one each; none: no filter.
fn prepare(scene: &Scene, filters: Vec<f32>) -> Case {
    let at = viewpoint(scene);
    let random = &mut Random::new(scene.splats.len() as u64);
    let mut case = Case {
        filters,
        ..Case::default()
    };
    case.filters.resize(scene.splats.len(), 0.0);
    for i in 0..scene.splats.len() {
        let splat = Splat::<f64>::of(&scene.splats, i);
        let [opacity, scale, size] = [OPACITY_PENALTY, SCALE_PENALTY, SIZE_PENALTY].map(f64::from);
        let weights = Penalties {
            opacity,
            scale,
            size,
        };
        let mut row = penalty_backward(&splat, weights);
        let mut seen = SEEN.map(f64::from);
        let sigma = f64::from(case.filters[i]);
        let screen = project(&smoothed(&splat, sigma), &at)
            .filter(|s| s.opacity >= Thresholds::ENGINE.alpha_min);
        let margins = margins(&splat, &at);
        // At a discontinuity of the projection either side is right: left out.
        let sound = margins.limit.min(margins.color) > 1e-4;
        case.begins.push(case.rest.len() as u32);
        let Some(screen) = screen.filter(|_| sound) else {
            case.records.push(Splat2d::default());
            case.tile_counts.push(0);
            case.rows.push(row);
            case.statistics.extend(seen);
            continue;
        };
        let tiles = 1 + i % 4;
        let mut sums = [0.0; 9];
        for _ in 0..tiles {
            let piece = [0; 9].map(|_| random.normal() as f32);
            let [a, b, c, d, e, f, g, h, blue] = piece;
            case.shape.push([a, b, c, d]);
            case.tone.push([e, f, g, h]);
            case.rest.push(blue);
            sums.iter_mut()
                .zip(piece)
                .for_each(|(sum, x)| *sum += f64::from(x));
        }
        let by_screen = pack::screen_row(&screen, sums);
        let gradient = smoothed_backward(&splat, sigma, &at, &by_screen);
        row.iter_mut().zip(&gradient).for_each(|(sum, g)| *sum += g);
        let half = [scene.camera.width, scene.camera.height].map(|n| 0.5 * f64::from(n));
        seen[0] += (by_screen[0] * half[0]).hypot(by_screen[1] * half[1]);
        seen[1] += 1.0;
        let [x, y] = extent(&screen, &Thresholds::ENGINE);
        // The kernels widen the ellipse, so that rounding drops no pixel on its rim.
        let level = 2.0 * (screen.opacity / Thresholds::ENGINE.alpha_min).ln();
        let wider = ((level * 1.00001 + 1e-5) / level).sqrt();
        seen[2] = seen[2].max(x * wider).max(y * wider);
        case.records.push(pack::splat2d(&screen));
        case.tile_counts.push(tiles as u32);
        case.rows.push(row);
        case.statistics.extend(seen);
    }
    case
}

fn run(
    gpu: &Gpu,
    kernel: &ProjectBackward,
    scene: &Scene,
    case: &Case,
    failed: u32,
) -> [Vec<f64>; 2] {
    run_in_order(gpu, kernel, scene, case, failed, None)
}

/// The same with parameters in the order of an index.
fn run_in_order(
    gpu: &Gpu,
    kernel: &ProjectBackward,
    scene: &Scene,
    case: &Case,
    failed: u32,
    index: Option<&[u32]>,
) -> [Vec<f64>; 2] {
    let count = scene.splats.len();
    let mut planes = planes_from_splats(&scene.splats);
    pack::set_filters(&mut planes, &case.filters);
    if let Some(index) = index {
        planes = scenes::in_order(&planes, index);
    }
    let gradients = unwritten::<[f32; 4]>(gpu, planes.len() + 1);
    let statistics = buffer(gpu, &vec![SEEN; count]);
    let (shapes, tones, rests) = pack::arrays(&case.records);
    let io = Bindings {
        view: &buffer(gpu, &[view(scene)]),
        counts: &counts(gpu, &[(COUNT_FAILED, failed)]),
        params: &buffer(gpu, &planes),
        tile_count_from_splat: &buffer(gpu, &case.tile_counts),
        emitted_from_splat: &buffer(gpu, &case.begins),
        ellipse_from_splat: &buffer(gpu, &shapes),
        whiten_rg_from_splat: &buffer(gpu, &tones),
        blue_depth_from_splat: &buffer(gpu, &rests),
        d_shape_from_source: &buffer(gpu, &case.shape),
        d_tone_from_source: &buffer(gpu, &case.tone),
        d_rest_from_source: &buffer(gpu, &case.rest),
        d_params: &gradients,
        statistics: &statistics,
        splat_from_slot: &buffer(gpu, index.unwrap_or(&[u32::MAX])),
    };
    let params = Params {
        splat_count: count as u32,
        stride: count as u32,
        opacity_penalty: OPACITY_PENALTY,
        scale_penalty: SCALE_PENALTY,
        size_penalty: SIZE_PENALTY,
        banded: 0,
    };
    gpu.run(|rec| kernel.record(rec, io, params, kernel.groups(count)))
        .unwrap();
    let statistics = floats(&read(gpu, &statistics));
    [floats(&read(gpu, &gradients)), statistics]
}

/// A name, and which planes and lanes belong to it.
type Group = (&'static str, fn(usize, usize) -> bool);

/// The parameters' groups: the planes and lanes that hold them.
const GROUPS: [Group; 5] = [
    ("mean", |plane, lane| plane == 0 && lane < 3),
    ("opacity", |plane, lane| plane == 0 && lane == 3),
    ("quaternion", |plane, _| plane == 1),
    ("log-scale", |plane, _| plane == 2),
    ("harmonics", |plane, _| plane > 2),
];

/// Each group, every splat's part of it divided by its own length: splats differ by many magnitudes.
fn grouped(found: &[f64], expected: &[f64], count: usize) -> Vec<Output> {
    let planes = expected.len() / (4 * count).max(1);
    let output = |(name, holds): Group| {
        let (mut f, mut e) = (Vec::new(), Vec::new());
        for splat in 0..count {
            let places: Vec<usize> = (0..planes * 4)
                .filter(|&k| holds(k / 4, k % 4))
                .map(|k| (k / 4 * count + splat) * 4 + k % 4)
                .collect();
            let norm = places
                .iter()
                .map(|&k| expected[k].powi(2))
                .sum::<f64>()
                .sqrt();
            let norm = if norm > 0.0 { norm } else { 1.0 };
            f.extend(places.iter().map(|&k| found[k] / norm));
            e.extend(places.iter().map(|&k| expected[k] / norm));
        }
        // Everything up to here is a product of about forty factors, 40u = 2.4e-6; the length of a quaternion's
        // gradient is what is left of terms larger by the aspect, a hundred for needles.
        Output::relative(name, f, e, 2e-4, 1.0)
    };
    GROUPS.map(output).into()
}

fn mip(mut scene: Scene) -> Scene {
    scene.splats.filter = ScreenFilter::Mip;
    scene
}

#[test]
fn sums_become_gradients_of_parameters() {
    let gpu = device::gpu();
    let mut check = Check::new("project_backward");
    for variant in supported!(project_backward, gpu) {
        for sh_degree in 0..=3 {
            for workgroup in [8, 64] {
                let spec = Spec {
                    workgroup,
                    sh_degree,
                    ..Spec::default()
                };
                let kernel = ProjectBackward::new(&gpu, Choice { variant, spec }).unwrap();
                for (name, scene, has_filters) in [
                    (
                        "nothing to do",
                        scenes::gentle(30, 0, 33, 47, sh_degree),
                        false,
                    ),
                    ("one", scenes::gentle(31, 1, 33, 47, sh_degree), false),
                    ("2^6 + 1", scenes::gentle(32, 65, 80, 61, sh_degree), false),
                    ("hard", scenes::hard(33, 270, 97, 129, sh_degree), false),
                    (
                        "mip",
                        mip(scenes::gentle(34, 100, 97, 129, sh_degree)),
                        false,
                    ),
                    (
                        "mip, hard",
                        mip(scenes::hard(35, 270, 97, 129, sh_degree)),
                        false,
                    ),
                    (
                        "smoothed",
                        mip(scenes::gentle(37, 100, 97, 129, sh_degree)),
                        true,
                    ),
                    (
                        "smoothed, hard",
                        mip(scenes::hard(38, 270, 97, 129, sh_degree)),
                        true,
                    ),
                ] {
                    let filters = match has_filters {
                        true => scenes::filters(&scene.splats, 2),
                        false => Vec::new(),
                    };
                    let case = prepare(&scene, filters);
                    let [found, statistics] = run(&gpu, &kernel, &scene, &case, 0);
                    let expected = pack::planes(&case.rows).concat();
                    assert!(found[expected.len()].is_nan(), "wrote past the end");
                    let count = scene.splats.len();
                    let mut outputs = grouped(&found, &expected, count);
                    // A norm of two sums.
                    let statistics = statistics[..4 * count].to_vec();
                    let seen = case.statistics.clone();
                    outputs.push(Output::relative("statistics", statistics, seen, 1e-5, 1.0));
                    check.outputs(&format!("{name}, degree {sh_degree}"), outputs);
                    let [untouched, _] = run(&gpu, &kernel, &scene, &case, 1);
                    assert!(
                        untouched.iter().all(|x| x.is_nan()),
                        "{name}: wrote, though failed"
                    );
                }
            }
        }
    }
    check.finish();
}

#[test]
fn slots_may_lie_in_any_order() {
    let gpu = device::gpu();
    let indexed = Choice {
        spec: Spec {
            indexed: 1,
            ..Spec::default()
        },
        ..Choice::default()
    };
    let [kernel, indexed] =
        [Choice::default(), indexed].map(|choice| ProjectBackward::new(&gpu, choice).unwrap());
    let scene = scenes::hard(33, 270, 97, 129, 3);
    let case = prepare(&scene, Vec::new());
    let index = scenes::shuffled(270);
    let [ordered, seen] = run(&gpu, &kernel, &scene, &case, 0);
    let [moved, seen_too] = run_in_order(&gpu, &indexed, &scene, &case, 0, Some(&index));
    let fours = |numbers: &[f64]| -> Vec<[f32; 4]> {
        let (fours, _) = numbers.as_chunks::<4>();
        fours.iter().map(|four| four.map(|x| x as f32)).collect()
    };
    let planes = fours(&ordered)[..15 * 270].to_vec();
    let expected = scenes::in_order(&planes, &index);
    assert!(fours(&moved)[..15 * 270] == expected, "not in their places");
    assert!(planes != expected, "the order makes no difference");
    assert_eq!(seen_too, seen);
}

#[test]
fn a_splat_may_have_more_records_than_a_driver_runs_loops() {
    let gpu = device::gpu();
    let kernel = ProjectBackward::new(&gpu, Choice::default()).unwrap();
    let scene = scenes::gentle(36, 1, 33, 47, 3);
    let mut case = prepare(&scene, Vec::new());
    let records = 80_001;
    case.tile_counts = vec![records as u32];
    case.begins = vec![0];
    case.shape = vec![[0.0; 4]; records];
    case.tone = vec![[0.0; 4]; records];
    case.rest = vec![1.0; records];
    let [found, _] = run(&gpu, &kernel, &scene, &case, 0);
    // The constant harmonic's blue: the third number of the fourth plane. Sums of ones are exact.
    let expected = records as f64 * 0.28209479177387814;
    let blue = found[4 * 3 + 2];
    assert!(
        (blue / expected - 1.0).abs() < 1e-6,
        "{blue}, not {expected}"
    );
}
