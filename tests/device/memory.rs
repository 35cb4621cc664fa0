//! Device memory of runs against the formula that is printed before them.

use ashfall::gpu::Gpu;
use ashfall::lab::synth::{Kind, SynthOptions, scene};
use ashfall::render::{
    Capacity, Model, Outputs, RenderOptions, Renderer, Scratch, SurfelMode, ViewOptions, isects_expected, total,
};
use ashfall::scene::{Dataset, Primitive, ScreenFilter};
use ashfall::simplify::{AutoRun, CountController, controller_needs, for_auto_count};
use ashfall::train::{
    BufferLimits, Residency, StrategyKind, TrainConfig, TrainSize, Trainer, initial_splats, splats_expected,
};
use std::collections::BTreeMap;

const UNLIMITED: BufferLimits = BufferLimits {
    memory: u64::MAX,
    binding: u64::MAX,
};

/// Alignment to which Vulkan rounds a buffer's size, bytes: 256 at most.
const ROUNDING: u64 = 256;

fn dataset(points: usize) -> Dataset {
    dataset_of(points, [160, 120])
}

fn dataset_of(points: usize, [width, height]: [u32; 2]) -> Dataset {
    scene(Kind::Demo).dataset(&SynthOptions {
        views: 12,
        width,
        height,
        samples: 1,
        points,
        ..SynthOptions::default()
    })
}

/// Bytes by buffer name at the peak of the sum.
fn peaks(gpu: &Gpu) -> BTreeMap<String, u64> {
    let all = gpu.memory_by_name();
    all.into_iter()
        .map(|(name, memory)| (name, memory.peak_bytes))
        .collect()
}

const ALL: Outputs = Outputs {
    depth: true,
    ends: true,
    surface: true,
    spread: true,
    limit: true,
    surfels: SurfelMode::Any,
    ids: true,
};

#[test]
fn every_buffer_of_a_frame_is_in_the_formula() {
    let gpu = crate::common::device::gpu();
    // Capacities dominated by the splats, and by the intersections.
    for (splats, isects, outputs) in [
        (70_000, 1_000, ALL),
        (10, 900_000, Outputs::default()),
        (1, 1, Outputs::TRAINING),
    ] {
        let capacity = Capacity::for_image(splats, isects, 333, 77);
        gpu.reset_memory_peak();
        let scratch = Scratch::new(&gpu, capacity, outputs).unwrap();
        let found = peaks(&gpu);
        let needs = Scratch::needs(scratch.capacity, outputs);
        assert_eq!(
            found.keys().collect::<Vec<_>>(),
            {
                let mut names: Vec<_> = needs.iter().map(|need| need.name.to_owned()).collect();
                names.sort_unstable();
                names
            }
            .iter()
            .collect::<Vec<_>>()
        );
        for need in &needs {
            let taken = found[need.name];
            let most = need.bytes + 2 * ROUNDING;
            assert!((need.bytes..most).contains(&taken), "{need:?}, {taken}");
        }
        drop(scratch);
        assert_eq!(gpu.memory_in_use(), 0);
    }
}

/// Trains to the end and compares: the formula at the run's largest sizes, by buffer and in all; and the prediction
/// before the run.
fn compare(gpu: &Gpu, dataset: &Dataset, config: &TrainConfig, streamed: bool) {
    gpu.reset_memory_peak();
    let mut trainer = Trainer::new(gpu, dataset, config.clone()).unwrap();
    let first = trainer.splat_count();
    while !trainer.is_done() {
        trainer.step().unwrap();
    }
    trainer.finish().unwrap();
    let extremes = trainer.extremes();
    drop(trainer);
    let mut size = TrainSize::of(dataset, config, BufferLimits::of(gpu), extremes.splats);
    size.isects = extremes.isects;
    assert_eq!(size.photos.streamed > 0, streamed);
    let needs = size.needs();
    let found = peaks(gpu);
    let known = |name: &String| needs.iter().any(|need| need.name == name);
    assert!(found.keys().all(known), "{found:?}");
    let (measured, predicted) = (gpu.memory_peak(), total(&needs));
    let ratio = predicted as f64 / measured as f64;
    println!(
        "{:?}, {extremes:?}: {measured} measured, {ratio:.4} of it predicted",
        config.strategy
    );
    for need in &needs {
        println!("  {:24} {:10} {:?}", need.name, need.bytes, found.get(need.name));
    }
    assert!((0.95..1.05).contains(&ratio), "{ratio}");
    // Parameters and the arrays beside them have exact sizes, without spare capacity.
    for name in ["params", "moment1", "moment2", "gradients", "ellipse_from_splat"] {
        let need = needs.iter().find(|need| need.name == name).unwrap();
        let taken = found[name];
        let exact = need.bytes..=need.bytes + ROUNDING;
        assert!(exact.contains(&taken), "{need:?}, {taken}");
    }
    if let Some(splats) = splats_expected(config, first) {
        assert_eq!(splats, extremes.splats, "as many splats as expected");
        let before = TrainSize::of(dataset, config, BufferLimits::of(gpu), splats);
        let ratio = total(&before.needs()) as f64 / measured as f64;
        println!("  before: {before:?}, {ratio:.4}");
        assert!((0.9..1.1).contains(&ratio), "{ratio} before the run");
    }
}

fn config(strategy: StrategyKind) -> TrainConfig {
    let mut config = TrainConfig::for_iterations(60).with_strategy(strategy);
    config.refine.from = 10;
    config.refine.every = 15;
    config.adc.grad_threshold = 1e-5;
    config.max_splats = Some(match strategy {
        StrategyKind::Adc => 12_000,
        StrategyKind::Mcmc => 15_000,
    });
    config
}

#[test]
fn training_takes_what_the_formula_says() {
    let gpu = crate::common::device::gpu();
    let dataset = dataset(6_000);
    for (strategy, share, kind) in [
        (StrategyKind::Adc, 0.25, Primitive::Gaussian3d),
        (StrategyKind::Mcmc, 0.0, Primitive::Gaussian3d),
        (StrategyKind::Mcmc, 0.25, Primitive::Surfel),
    ] {
        let mut config = config(strategy);
        (config.photo_share, config.kind) = (share, kind);
        if kind == Primitive::Surfel {
            (config.geometry.normal, config.geometry.distortion) = (0.05, 1.0);
        }
        compare(&gpu, &dataset, &config, share == 0.0);
    }
}

/// The device never holds photographs of two sizes.
#[test]
fn training_from_coarse_to_fine_takes_what_the_formula_says() {
    let gpu = crate::common::device::gpu();
    let mut config = TrainConfig::for_iterations(4);
    config.coarse_until = 2;
    compare(&gpu, &dataset_of(1_000, [640, 480]), &config, false);
}

/// After lowering degrees during a run, memory is that of the formula for the new degrees.
#[test]
fn memory_falls_with_the_degrees() {
    let gpu = crate::common::device::gpu();
    let dataset = dataset(20_000);
    let config = TrainConfig::for_iterations(1_000);
    let mut trainer = Trainer::new(&gpu, &dataset, config).unwrap();
    trainer.step().unwrap();
    let count = trainer.splat_count();
    // Four of five splats at degree 0, the others at 3.
    let degrees: Vec<u8> = (0..count).map(|i| 3 * u8::from(i % 5 == 0)).collect();
    trainer.lower_degrees(&degrees).unwrap();
    trainer.step().unwrap();
    trainer.finish().unwrap();
    let whole = trainer.size();
    let lower = degrees.iter().filter(|&&degree| degree == 0).count();
    assert_eq!(whole.lower, [lower, 0, 0]);
    assert_eq!(whole.counts(), [lower, 0, 0, count - lower]);
    let needs = whole.needs();
    let taken: BTreeMap<_, _> = gpu.memory_by_name().into_iter().collect();
    for (name, bytes) in [
        ("params", 64 * lower + 240 * (count - lower)),
        ("moment1", 64 * lower + 240 * (count - lower)),
        ("moment2", 64 * lower + 240 * (count - lower)),
        ("splat_from_slot", 4 * count),
        ("gradients", 80 * 16_384.min(lower.max(count - lower))),
    ] {
        let need = needs.iter().find(|need| need.name == name).unwrap();
        let bytes = bytes as u64;
        assert_eq!(need.bytes, bytes, "{name}");
        let found = taken[name].bytes;
        assert!(
            (bytes..bytes + 4 * ROUNDING).contains(&found),
            "{name}: {found}, not {bytes}"
        );
    }
}

/// Evaluations and surveys of a run that chooses its splat count have buffers beside those of training.
#[test]
fn a_count_controller_takes_what_the_formula_says() {
    let gpu = crate::common::device::gpu();
    let dataset = dataset(6_000);
    let config = for_auto_count(TrainConfig::for_iterations(60), dataset.views_per_point());
    gpu.reset_memory_peak();
    let run = AutoRun::new(&gpu, &dataset, config).unwrap();
    let mut run = run
        .controlled(|trainer, dataset| CountController::begin(trainer, dataset, false))
        .unwrap();
    while !run.is_done() {
        run.step().unwrap();
    }
    run.finish().unwrap();
    let (measured, size) = (gpu.memory_peak(), run.trainer().size());
    let predicted = total(&size.needs()) + total(&controller_needs(&size));
    let ratio = predicted as f64 / measured as f64;
    println!("{size:?}: {measured} measured, {ratio:.4} of it predicted");
    for (name, bytes) in peaks(&gpu) {
        println!("  {name:24} {bytes:10}");
    }
    assert!((0.9..1.1).contains(&ratio), "{ratio}");
}

/// Largest ratio of a run's device memory to the bytes of parameters, moments, photographs and lists.
const SHARE_MAX: f64 = 1.3;

#[test]
fn training_takes_little_beside_what_it_cannot_do_without() {
    let gpu = crate::common::device::gpu();
    let dataset = dataset(50_000);
    let config = TrainConfig::for_iterations(1_000);
    let mut trainer = Trainer::new(&gpu, &dataset, config).unwrap();
    for _ in 0..3 {
        trainer.step().unwrap();
    }
    trainer.finish().unwrap();
    let (measured, size) = (gpu.memory_peak(), trainer.size());
    let (share, predicted) = (
        measured as f64 / size.essential_bytes() as f64,
        size.bytes() as f64 / measured as f64,
    );
    println!("{share:.3} of the essential bytes, {predicted:.3} of the measured ones predicted");
    assert!(share <= SHARE_MAX, "{share}");
    assert!((0.9..1.1).contains(&predicted), "{predicted}");
    // Other sizes by the formula, which the run above and other tests compare with measurements.
    for (splats, photos, image) in [
        (50_000, 43, [270, 480]),
        (200_000, 43, [270, 480]),
        (100_000, 100, [540, 960]),
        (50_000, 43, [1920, 1080]),
        (2_000_000, 300, [1600, 1200]),
    ] {
        let sizes = std::iter::repeat_n(image, photos);
        let size = TrainSize {
            outputs: Outputs::TRAINING,
            splats,
            sh_degree: 3,
            lower: [0; 3],
            isects: isects_expected(splats, image[0], image[1]),
            image,
            binding: u64::MAX,
            photos: Residency::of(sizes, 1.0, u64::MAX),
            reloads: false,
            patches: 0,
            pose_view: None,
        };
        let share = size.bytes() as f64 / size.essential_bytes() as f64;
        println!("{splats} splats, {photos} photographs of {image:?}: {share:.3}");
        assert!(share <= SHARE_MAX, "{share} at {size:?}");
    }
}

#[test]
fn a_refinement_without_room_is_refused_and_leaves_the_run_as_it_was() {
    let dataset = dataset(6_000);
    let mut config = config(StrategyKind::Mcmc);
    config.mcmc.growth = 1.2;
    let size = TrainSize::of(&dataset, &config, UNLIMITED, 9_000);
    let gpu = crate::common::device::limited(Some(total(&size.needs())));
    let mut trainer = Trainer::new(&gpu, &dataset, config).unwrap();
    let first = trainer.splat_count();
    let error = loop {
        match trainer.step() {
            Ok(_) => assert!(!trainer.is_done(), "it should not fit"),
            Err(error) => break error,
        }
    };
    assert!(error.to_string().contains("out of device memory"), "{error}");
    let (count, splats) = (trainer.splat_count(), trainer.splats().unwrap());
    assert!(count > first && splats.len() == count);
    assert!(splats.mean.iter().flatten().all(|x| x.is_finite()));
}

#[test]
fn a_renderer_that_grows_never_holds_old_and_new() {
    let gpu = crate::common::device::gpu();
    let dataset = dataset(20_000);
    let config = TrainConfig::for_iterations(1_000);
    let splats = initial_splats(&dataset, dataset.extent(), &config).unwrap();
    let model = Model::upload(&gpu, &splats).unwrap();
    let mut renderer = Renderer::new(&gpu, RenderOptions::default()).unwrap();
    let view = ViewOptions {
        background: [0.0; 3],
        near: 0.01,
        filter: ScreenFilter::Classic,
    };
    let mut camera = dataset.views[0].camera;
    renderer.render(&model, &camera, &view).unwrap();
    gpu.reset_memory_peak();
    camera.width *= 4;
    camera.height *= 4;
    camera.focal *= 4.0;
    camera.center *= 4.0;
    let isects = 3_000_000;
    renderer.reserve(&model, &camera, isects).unwrap();
    let capacity = Capacity::for_image(splats.len(), isects, camera.width, camera.height);
    let frame: u64 = peaks(&gpu).values().sum();
    let wanted = total(&Scratch::needs(capacity, Outputs::default())) + total(&Model::needs(model.blocks));
    assert!(frame < wanted + (1 << 20), "{frame} bytes, {wanted} needed");
}
