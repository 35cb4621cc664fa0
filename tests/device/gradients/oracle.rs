//! The gradient of every parameter against the exact one.

use crate::common::scenes::{self, Scene, Trouble};
use crate::common::{device, pack};
use crate::gradients::{BEGUN, config, step_by};
use ashfall::reference::loss::Target;
use ashfall::reference::smoothing::unsmoothed_along;
use ashfall::reference::surface_loss::{SurfaceWeights, surface_loss_backward};
use ashfall::reference::{Options, Splat, Viewpoint, loss_gradient};
use ashfall::render::degrees_used;
use ashfall::scene::{Camera, ScreenFilter, Splats, sh_coefficient_count};
use ashfall::train::state::Planes;
use ashfall::train::{HostState, TrainConfig, schedule};

/// Parameters of a splat before its SH coefficients.
const GEOMETRY: usize = 11;

/// Planes and lanes of each group of parameters.
const GROUPS: [(&str, std::ops::Range<usize>, std::ops::Range<usize>); 5] = [
    ("mean", 0..1, 0..3),
    ("opacity", 0..1, 3..4),
    ("quaternion", 1..2, 0..4),
    ("log-scale", 2..3, 0..3),
    ("harmonics", 3..usize::MAX, 0..4),
];

/// A group's values, splat by splat.
fn group<'a, T: Copy>(
    planes: &'a [Vec<[T; 4]>],
    (_, rows, lanes): &'a (&str, std::ops::Range<usize>, std::ops::Range<usize>),
) -> Vec<T> {
    let rows = rows.start..rows.end.min(planes.len());
    planes[rows]
        .iter()
        .flatten()
        .flat_map(|four| four[lanes.clone()].iter().copied())
        .collect()
}

/// Errors are relative to the reference, or to this share of its group's root mean square where the reference is
/// smaller: gradients that small are remainders of terms that cancel.
const SHARE: f64 = 0.01;

/// Absolute relative errors of a group over several scenes.
#[derive(Default)]
struct Errors(Vec<f64>);

impl Errors {
    fn add(&mut self, found: &[f32], expected: &[f64]) {
        let square = expected.iter().map(|e| e * e).sum::<f64>();
        let floor = SHARE * (square / expected.len() as f64).sqrt();
        for (&f, &e) in found.iter().zip(expected) {
            if e == 0.0 {
                // Splats that are not drawn.
                assert_eq!(f, 0.0, "a gradient where there is none");
            } else {
                self.0.push((f64::from(f) - e).abs() / e.abs().max(floor));
            }
        }
    }

    fn percentile(&mut self, share: f64) -> f64 {
        self.0.sort_by(f64::total_cmp);
        self.0[((self.0.len() - 1) as f64 * share) as usize]
    }
}

fn compare(name: &str, scenes: &[Scene]) {
    let unfiltered: Vec<_> = scenes.iter().map(|s| (s.clone(), Vec::new())).collect();
    compare_smoothed(name, &unfiltered);
}

/// Compares scenes with one 3D filter per splat; empty: no filter.
pub(crate) fn compare_smoothed(name: &str, scenes: &[(Scene, Vec<f32>)]) {
    compare_by(name, scenes, config);
}

/// Gradient of the terms of geometry of a frame, rows as in `rows`, added to these.
fn add_terms(rows: &mut [Vec<f64>], drawn: &Splats, camera: &Camera, options: &Options, config: &TrainConfig) {
    let [normal, spread] = schedule::geometry(config, BEGUN + 1).map(f64::from);
    if normal == 0.0 && spread == 0.0 {
        return;
    }
    let pixels = f64::from(camera.width * camera.height);
    let weights = SurfaceWeights {
        normal: normal / pixels,
        spread: spread / pixels,
    };
    let view = Viewpoint::on(drawn, camera, options);
    let terms = surface_loss_backward(&Splat::all(drawn), &view, options, weights);
    let size = |rows: &mut dyn Iterator<Item = f64>| rows.map(|d| d * d).sum::<f64>().sqrt();
    let whole = size(&mut rows.iter().flat_map(|row| row[..GEOMETRY].to_vec()));
    let share = size(&mut terms.iter().flatten().copied()) / whole;
    assert!(share > 0.1, "the terms are {share:e} of the gradient");
    for (row, term) in rows.iter_mut().zip(&terms) {
        row.iter_mut().zip(term).for_each(|(d, term)| *d += term);
    }
}

/// The same by other configurations.
pub(crate) fn compare_by(name: &str, scenes: &[(Scene, Vec<f32>)], config: fn(&Scene) -> TrainConfig) {
    let gpu = device::gpu();
    let mut errors: [Errors; 5] = Default::default();
    for (scene, filters) in scenes {
        let state = state_of(scene, filters);
        let config = config(scene);
        let found = step_by(&gpu, scene, &state, config.clone());
        let options = Options {
            near: f64::from(found.near),
            ..scene.options
        };
        let camera = &scene.camera;
        let photo = scenes::photo_values(&scenes::photo(7, camera.width, camera.height));
        let target = Target {
            lambda: f64::from(config.lambda_dssim),
            ..Target::new(camera.width as usize, &photo)
        };
        // As drawn: the filters are applied to the splats, then undone in the gradient.
        let drawn = state.to_splats(scene.splats.filter);
        let expected = loss_gradient(&drawn, camera, &options, &target);
        let loss = (found.report.loss / expected.loss - 1.0).abs();
        assert!(loss < 1e-5, "{name}: the loss is off by {loss:e}");
        let planes: Planes = found.gradients;
        let count = scene.splats.len();
        let mut rows = pack::gradient_rows(&expected.d_splats);
        add_terms(&mut rows, &drawn, camera, &options, &config);
        for (i, (row, &sigma)) in rows.iter_mut().zip(filters).enumerate() {
            let splat = Splat::of(&scene.splats, i);
            *row = unsmoothed_along(&splat, sigma.into(), row, scene.splats.primitive);
        }
        for (row, &degree) in rows.iter_mut().zip(&state.degrees) {
            // A band absent from a splat has no gradient.
            row[GEOMETRY + 3 * sh_coefficient_count(degree.into())..].fill(0.0);
        }
        let reference: Vec<Vec<[f64; 4]>> = pack::planes(&rows).chunks(count).map(<[_]>::to_vec).collect();
        for (errors, which) in errors.iter_mut().zip(&GROUPS) {
            errors.add(&group(&planes, which), &group(&reference, which));
        }
    }
    for (errors, (group, ..)) in errors.iter_mut().zip(&GROUPS) {
        let (median, high) = (errors.percentile(0.5), errors.percentile(0.99));
        let worst = errors.percentile(1.0);
        println!("{name:8} {group:12} median {median:.1e}, 99% {high:.1e}, all {worst:.1e}");
        assert!(median <= 1e-5, "{name}, {group}: median {median:e}");
        assert!(high <= 1e-3, "{name}, {group}: 99th percentile {high:e}");
        // Validity of the check: errors are not all zero.
        assert!(median > 0.0, "{name}, {group}: too good to be true");
    }
}

/// The scene's state with its filters, each splat at the degree that its coefficients need.
fn state_of(scene: &Scene, filters: &[f32]) -> HostState {
    let mut state = HostState::from_splats(&scene.splats, scene.splats.sh_degree);
    for (row, &filter) in state.params[2].iter_mut().zip(filters) {
        row[3] = filter;
    }
    state.lower_degrees(&degrees_used(&scene.splats));
    state
}

#[test]
fn mip_gradients_are_the_oracles_with_the_3d_filter_and_without() {
    let mip = |mut scene: Scene, has_filters: bool| {
        scene.splats.filter = ScreenFilter::Mip;
        let filters = match has_filters {
            true => scenes::filters(&scene.splats, 3),
            false => Vec::new(),
        };
        (scene, filters)
    };
    compare_smoothed(
        "mip",
        &[
            mip(scenes::gentle(64, 60, 64, 48, 2), false),
            mip(scenes::hard(65, 90, 49, 65, 1), false),
        ],
    );
    compare_smoothed(
        "smoothed",
        &[
            mip(scenes::gentle(66, 60, 64, 48, 2), true),
            mip(scenes::hard(67, 90, 49, 65, 1), true),
        ],
    );
}

#[test]
fn surfel_gradients_are_the_oracles_in_both_filters() {
    for (name, filter) in [("spot", ScreenFilter::Classic), ("mip disc", ScreenFilter::Mip)] {
        let scenes = [
            scenes::gentle(74, 60, 64, 48, 2),
            scenes::gentle(75, 100, 49, 65, 0),
            scenes::hard(76, 90, 64, 48, 1),
        ];
        compare(name, &scenes.map(|scene| scenes::flattened(scene, filter)));
    }
    let smoothed = |scene: Scene| {
        let scene = scenes::flattened(scene, ScreenFilter::Mip);
        let filters = scenes::filters(&scene.splats, 3);
        (scene, filters)
    };
    compare_smoothed(
        "smooth disc",
        &[
            smoothed(scenes::gentle(77, 60, 64, 48, 1)),
            smoothed(scenes::hard(78, 90, 49, 65, 0)),
        ],
    );
}

#[test]
fn gentle_gradients_are_the_oracles() {
    compare(
        "gentle",
        &[
            scenes::gentle(50, 60, 64, 48, 3),
            scenes::gentle(51, 100, 49, 65, 2),
            scenes::gentle(52, 40, 33, 17, 0),
        ],
    );
}

#[test]
fn hard_gradients_are_the_oracles() {
    // Clamped, saturated, needles of aspect 100, behind, invisible, huge, tiny, dark.
    assert_eq!(Trouble::ALL.len(), 9);
    compare(
        "hard",
        &[
            scenes::hard(53, 90, 64, 48, 3),
            scenes::hard(54, 90, 49, 65, 1),
            scenes::hard(55, 63, 40, 40, 2),
        ],
    );
}
