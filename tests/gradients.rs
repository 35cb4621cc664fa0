//! A whole training step on the device (frame, loss, gradients) against the oracle's exact gradient, and what
//! must hold of it without any oracle: relations, determinism, harmless poison, sizes of buffers that do not
//! matter.

#![allow(
    clippy::unwrap_used,
    reason = "a test that cannot go on may say so by panicking"
)]

#[path = "common/device.rs"]
mod device;
#[path = "common/pack.rs"]
mod pack;
#[path = "common/scenes.rs"]
mod scenes;

use ashfall::gpu::Gpu;
use ashfall::reference::loss::Target;
use ashfall::reference::{Options, loss_gradient};
use ashfall::scene::{AlphaMode, Camera, Dataset, Photo, PhotoSource, Point, Splats, View};
use ashfall::train::state::Planes;
use ashfall::train::{Background, HostState, StepReport, TrainConfig, Trainer};
use scenes::{Scene, Trouble};

/// The iteration that runs go on from: all harmonics are trained by then, and density control is over.
const BEGUN: u32 = 20_000;

fn config(scene: &Scene) -> TrainConfig {
    TrainConfig {
        sh_degree: scene.splats.sh_degree,
        background: Background::Fixed(scene.options.background.map(|c| c as f32)),
        ..TrainConfig::for_iterations(30_000)
    }
}

/// A data set of one view, whose extent puts the near plane where the scene wants it.
fn dataset(scene: &Scene, camera: &Camera) -> Dataset {
    let (width, height) = (camera.width, camera.height);
    let rgba = scenes::photo(7, width, height)
        .iter()
        .map(|&[r, g, b]| [r, g, b, 255])
        .collect();
    let distance = scene.options.near / (1.1 * f64::from(config(scene).near_factor));
    let ray = camera.rotation.row(2) * distance;
    let point = Point {
        position: (camera.position + ray).to_array().map(|x| x as f32),
        color: [0.5; 3],
    };
    Dataset {
        views: vec![View {
            name: "view".into(),
            camera: *camera,
            photo: PhotoSource::Memory(Photo {
                width,
                height,
                rgba,
            }),
        }],
        points: vec![point],
        test_every: 0,
        held_out: Vec::new(),
        alpha: AlphaMode::Composite,
        warnings: Vec::new(),
    }
}

/// What one step saw and went by.
#[derive(Clone, Debug, PartialEq)]
struct Stepped {
    image: Vec<f32>,
    gradients: Planes,
    after: HostState,
    report: StepReport,
    near: f32,
}

fn step(gpu: &Gpu, scene: &Scene) -> Stepped {
    let dataset = dataset(scene, &scene.camera);
    let state = HostState::from_splats(&scene.splats, scene.splats.sh_degree);
    let mut trainer = Trainer::from_state(gpu, &dataset, config(scene), &state, BEGUN).unwrap();
    trainer.step().unwrap();
    let gradients = trainer.gradients().unwrap();
    let image = trainer.image().unwrap();
    let after = trainer.download().unwrap();
    let report = trainer.finish().unwrap().pop().unwrap();
    Stepped {
        image,
        gradients,
        after,
        report,
        near: trainer.near(),
    }
}

/// The planes and lanes of each group of parameters.
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

/// An error counts relatively to the reference, or to this share of its group's root mean square where the
/// reference is smaller: what is small beside its kind is the remainder of terms that cancel.
const SHARE: f64 = 0.01;

/// Median and 99th percentile of a group's errors over several scenes.
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
    let gpu = device::gpu();
    let mut errors: [Errors; 5] = Default::default();
    for scene in scenes {
        let found = step(&gpu, scene);
        let options = Options {
            near: f64::from(found.near),
            ..scene.options
        };
        let camera = &scene.camera;
        let photo = scenes::photo_values(&scenes::photo(7, camera.width, camera.height));
        let target = Target {
            lambda: f64::from(config(scene).lambda_dssim),
            ..Target::new(camera.width as usize, &photo)
        };
        let expected = loss_gradient(&scene.splats, camera, &options, &target);
        let loss = (found.report.loss / expected.loss - 1.0).abs();
        assert!(loss < 1e-5, "{name}: the loss is off by {loss:e}");
        let planes: Planes = found.gradients.clone();
        let count = scene.splats.len();
        let rows = pack::gradient_rows(&expected.d_splats);
        let reference: Vec<Vec<[f64; 4]>> = pack::planes(&rows)
            .chunks(count)
            .map(<[_]>::to_vec)
            .collect();
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
        // The check itself: a percent must show.
        assert!(median > 0.0, "{name}, {group}: too good to be true");
    }
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

/// Splat `index` of `from` again at the end of `splats`, changed.
fn append(splats: &mut Splats, index: usize, change: impl FnOnce(&mut [Option<&mut f32>])) {
    let stride = splats.sh_stride();
    splats.mean.push(splats.mean[index]);
    splats.quaternion.push(splats.quaternion[index]);
    splats.log_scale.push(splats.log_scale[index]);
    splats.opacity_logit.push(splats.opacity_logit[index]);
    let sh = splats.sh[index * stride..][..stride].to_vec();
    splats.sh.extend(sh);
    let last = splats.mean.len() - 1;
    let mut slots: Vec<Option<&mut f32>> = splats.mean[last].iter_mut().map(Some).collect();
    slots.extend(splats.quaternion[last].iter_mut().map(Some));
    slots.extend(splats.log_scale[last].iter_mut().map(Some));
    slots.push(Some(&mut splats.opacity_logit[last]));
    slots.extend(splats.sh[last * stride..].iter_mut().map(Some));
    change(&mut slots);
}

/// The first splats' gradients, as bits.
fn bits(gradients: &Planes, count: usize) -> Vec<[u32; 4]> {
    let four = |four: &[f32; 4]| four.map(f32::to_bits);
    gradients
        .iter()
        .flat_map(|plane| plane[..count].iter().map(four))
        .collect()
}

/// Asserts that the splats from `count` on are seen by nobody, and harm nobody.
#[track_caller]
fn assert_unseen(name: &str, found: &Stepped, clean: &Stepped, count: usize) {
    assert!(found.image == clean.image, "{name}: the image changed");
    assert!(
        bits(&found.gradients, count) == bits(&clean.gradients, count),
        "{name}: a neighbour's gradient changed"
    );
    for four in found.gradients.iter().flat_map(|plane| &plane[count..]) {
        assert_eq!(*four, [0.0; 4], "{name}: a gradient of what is not seen");
    }
}

#[test]
fn what_is_not_seen_changes_nothing() {
    let gpu = device::gpu();
    let scene = scenes::gentle(56, 30, 40, 33, 1);
    let count = scene.splats.len();
    let clean = step(&gpu, &scene);
    let backward = scene.camera.rotation.row(2);
    let behind = (scene.camera.position - backward * 2.0).as_vec3();
    let sideways = scene.camera.rotation.row(0);
    let beside = (scene.camera.position + backward * 3.0 + sideways * 300.0).as_vec3();
    for (name, place, logit) in [
        ("faint", None, Some(-5.6)),
        ("behind the camera", Some(behind), None),
        ("off the screen", Some(beside), None),
    ] {
        let mut more = scene.clone();
        for index in 0..5 {
            append(&mut more.splats, index, |slots| {
                for (slot, x) in slots.iter_mut().zip(place.unwrap_or_default().to_array()) {
                    if let (Some(slot), true) = (slot, place.is_some()) {
                        **slot = x;
                    }
                }
                if let (Some(Some(slot)), Some(logit)) = (slots.get_mut(10), logit) {
                    **slot = logit;
                }
            });
        }
        assert_unseen(name, &step(&gpu, &more), &clean, count);
    }
}

#[test]
fn what_lies_behind_an_opaque_stack_changes_nothing() {
    let gpu = device::gpu();
    let mut scene = scenes::gentle(57, 30, 40, 33, 0);
    // A wall near the camera: wide, opaque, two deep, so that nothing of a ray is left behind it.
    let axis = scene.camera.rotation.row(2);
    let at = |z: f64| (scene.camera.position + axis * z).as_vec3().to_array();
    let (near, nearer, far) = (at(1.0), at(0.9), at(9.0));
    for place in [near, nearer] {
        append(&mut scene.splats, 0, |slots| {
            for (k, slot) in slots.iter_mut().enumerate() {
                let Some(slot) = slot else { continue };
                match k {
                    0..3 => **slot = place[k],
                    7..10 => **slot = 4.0,
                    10 => **slot = 15.0,
                    _ => {}
                }
            }
        });
    }
    let count = scene.splats.len();
    let clean = step(&gpu, &scene);
    let mut more = scene.clone();
    append(&mut more.splats, 3, |slots| {
        for (slot, x) in slots.iter_mut().zip(far) {
            if let Some(slot) = slot {
                **slot = x;
            }
        }
    });
    assert_unseen("behind the wall", &step(&gpu, &more), &clean, count);
}

#[test]
fn the_order_of_splats_does_not_matter() {
    let gpu = device::gpu();
    let scene = scenes::gentle(58, 50, 40, 33, 1);
    let clean = step(&gpu, &scene);
    let order = scenes::Random::new(1).permutation(50);
    let mut shuffled = scene.clone();
    let stride = scene.splats.sh_stride();
    for (to, &from) in order.iter().enumerate() {
        shuffled.splats.mean[to] = scene.splats.mean[from];
        shuffled.splats.quaternion[to] = scene.splats.quaternion[from];
        shuffled.splats.log_scale[to] = scene.splats.log_scale[from];
        shuffled.splats.opacity_logit[to] = scene.splats.opacity_logit[from];
        let sh = &scene.splats.sh[from * stride..][..stride];
        shuffled.splats.sh[to * stride..][..stride].copy_from_slice(sh);
    }
    let found = step(&gpu, &shuffled);
    assert!(found.image == clean.image, "the image changed");
    for (plane, was) in found.gradients.iter().zip(&clean.gradients) {
        for (to, &from) in order.iter().enumerate() {
            assert_eq!(plane[to], was[from], "splat {from}");
        }
    }
}

#[test]
fn poison_stays_where_it_is() {
    let gpu = device::gpu();
    let scene = scenes::gentle(59, 20, 33, 20, 1);
    let count = scene.splats.len();
    let clean = step(&gpu, &scene);
    let slots = 11 + scene.splats.sh_stride();
    for poison in scenes::POISON {
        let mut poisoned = scene.clone();
        for slot in 0..slots {
            append(&mut poisoned.splats, slot % count, |slots| {
                if let Some(Some(value)) = slots.get_mut(slot) {
                    **value = poison;
                }
            });
        }
        let found = step(&gpu, &poisoned);
        assert!(
            found.image.iter().all(|x| x.is_finite()),
            "{poison:e}: the image is not finite"
        );
        let sound = |plane: &Vec<[f32; 4]>| plane[..count].iter().flatten().all(|x| x.is_finite());
        assert!(
            found.after.params.iter().all(sound),
            "{poison:e}: a neighbour is not finite afterwards"
        );
        // The square of a brighter splat than this exceeds all numbers, and who overlaps it learns nothing.
        if poison.abs() < 1e15 {
            assert!(found.report.loss.is_finite(), "{poison:e}: the loss");
            assert!(
                found.gradients.iter().all(sound),
                "{poison:e}: a neighbour's gradient is not finite"
            );
        }
        if !poison.is_finite() {
            assert!(found.image == clean.image, "{poison:e}: the image changed");
            let neighbours = bits(&found.gradients, count) == bits(&clean.gradients, count);
            assert!(neighbours, "{poison:e}: a neighbour's gradient changed");
        }
    }
}

/// The state and the reports after some steps; before each of the named ones, buffers are made that hold just so
/// many intersections.
fn train(
    gpu: &Gpu,
    scene: &Scene,
    steps: u32,
    tiny: &[(u32, usize)],
) -> (HostState, Vec<StepReport>) {
    let dataset = dataset(scene, &scene.camera);
    let state = HostState::from_splats(&scene.splats, scene.splats.sh_degree);
    let mut trainer = Trainer::from_state(gpu, &dataset, config(scene), &state, BEGUN).unwrap();
    let mut reports = Vec::new();
    let mut tiny = tiny.iter().peekable();
    while trainer.iteration() < BEGUN + steps {
        let next = trainer.iteration() + 1 - BEGUN;
        if let Some((_, isects)) = tiny.next_if(|(at, _)| *at == next) {
            trainer.set_isect_capacity(*isects).unwrap();
        }
        reports.extend(trainer.step().unwrap());
    }
    reports.extend(trainer.finish().unwrap());
    assert!(tiny.next().is_none(), "not all sizes were tried");
    (trainer.download().unwrap(), reports)
}

#[test]
fn training_repeats_to_the_bit_and_whatever_the_buffers_sizes() {
    let gpu = device::gpu();
    let scene = scenes::hard(60, 90, 48, 40, 2);
    let (state, reports) = train(&gpu, &scene, 20, &[]);
    assert_eq!(reports.len(), 20);
    let numbers: Vec<u32> = reports.iter().map(|r| r.iteration - BEGUN).collect();
    assert_eq!(numbers, (1..=20).collect::<Vec<u32>>());
    assert!(
        train(&gpu, &scene, 20, &[]) == (state.clone(), reports.clone()),
        "not the same bits twice"
    );
    let small = train(&gpu, &scene, 20, &[(1, 3), (7, 100), (8, 1), (20, 50)]);
    assert_eq!(small.1, reports, "reports with a small buffer");
    assert!(small.0 == state, "a small buffer changed the result");
}

#[test]
fn poisoned_gradients_are_counted_by_the_step() {
    let gpu = device::gpu();
    let mut scene = scenes::gentle(61, 20, 33, 20, 0);
    // So bright that its square is infinite: who overlaps it has no gradient.
    append(&mut scene.splats, 0, |slots| {
        if let Some(Some(value)) = slots.get_mut(11) {
            **value = 1e30;
        }
    });
    let (_, reports) = train(&gpu, &scene, 3, &[]);
    let counted: Vec<usize> = reports.iter().map(|r| r.poisoned).collect();
    assert!(counted[0] > 0, "nothing was poisoned");
    assert!(
        counted.windows(2).all(|pair| pair[0] == pair[1]),
        "{counted:?}"
    );
}
