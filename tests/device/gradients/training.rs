//! Several steps in a row: the same bits every time and at every buffer size.

use crate::common::device;
use crate::common::scenes::{self, Scene};
use crate::gradients::{BEGUN, config, dataset};
use ashfall::gpu::Gpu;
use ashfall::lab::synth::{Kind, SynthOptions};
use ashfall::scene::{Dataset, PhotoSource, Split};
use ashfall::train::{HostState, StepReport, TrainConfig, Trainer, initial_splats};
use std::path::Path;

/// State and reports after some steps; `tiny` lists steps and the intersection capacity set before each.
fn train(gpu: &Gpu, scene: &Scene, steps: u32, tiny: &[(u32, usize)]) -> (HostState, Vec<StepReport>) {
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

/// The data set with photographs of another size.
fn resized(dataset: &Dataset, width: u32, height: u32) -> Dataset {
    let mut dataset = dataset.clone();
    for view in &mut dataset.views {
        let photo = ashfall::io::photo::load(view).unwrap();
        view.camera = view.camera.resized(width, height);
        view.photo = PhotoSource::Memory(ashfall::io::photo::reduce(photo, width, height));
    }
    dataset
}

/// Four training views of 40 × 33 pixels.
fn four_views() -> Dataset {
    let options = SynthOptions {
        views: 5,
        width: 40,
        height: 33,
        points: 300,
        test_every: 5,
        ..SynthOptions::default()
    };
    ashfall::lab::synth::scene(Kind::Solids).dataset(&options)
}

/// Twelve steps, the first ones at half size; no gradient of a colour waits after the sixth.
fn half_size(until: u32) -> TrainConfig {
    let mut config = TrainConfig {
        coarse_until: until,
        ..TrainConfig::for_iterations(12)
    };
    config.adam.color_every = 3;
    config
}

#[test]
fn first_steps_see_photographs_of_half_the_size() {
    let gpu = device::gpu();
    let dataset = four_views();
    let (start, small) = (dataset.clone(), resized(&dataset, 20, 17));
    let train = |dataset: &Dataset, coarse_until: u32, steps: u32, tiny: bool| {
        let config = half_size(coarse_until);
        // The start may depend on the size of a pixel, so it is computed once.
        let splats = initial_splats(&start, start.extent(), &config).unwrap();
        let state = HostState::from_splats(&splats, config.sh_degree);
        let mut trainer = Trainer::from_state(&gpu, dataset, config, &state, 0).unwrap();
        let mut shrink = tiny;
        while trainer.iteration() < steps {
            if shrink && trainer.iteration() == 5 {
                shrink = false;
                trainer.set_isect_capacity(10).unwrap();
            }
            trainer.step().unwrap();
        }
        trainer.finish().unwrap();
        trainer.download().unwrap()
    };
    assert!(train(&dataset, 6, 6, false) != train(&dataset, 0, 6, false));
    // After the change to full size they differ, and a step that overflowed at the change has no effect.
    let turned = train(&dataset, 6, 12, false);
    assert!(turned != train(&small, 0, 12, false));
    assert!(turned == train(&dataset, 6, 12, true));
    // Resuming from a state at the change gives the same steps at full size.
    let state = train(&dataset, 6, 6, false);
    let mut resumed = Trainer::from_state(&gpu, &dataset, half_size(6), &state, 6).unwrap();
    while !resumed.is_done() {
        resumed.step().unwrap();
    }
    assert!(resumed.download().unwrap() == turned);
}

/// The data set with its photographs in files of a folder.
fn in_files(dataset: &Dataset, folder: &Path) -> Dataset {
    let mut dataset = dataset.clone();
    for view in &mut dataset.views {
        let photo = ashfall::io::photo::load(view).unwrap();
        let path = folder.join(&view.name).with_extension("png");
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        let bytes = photo.rgba.as_flattened();
        image::save_buffer(&path, bytes, photo.width, photo.height, image::ColorType::Rgba8).unwrap();
        view.photo = PhotoSource::File {
            path,
            optics: None,
            orientation: 1,
            mask: None,
            vignetting: None,
        };
    }
    dataset
}

#[test]
fn a_photograph_missing_at_the_change_of_sizes_is_an_error_until_it_is_back() {
    let gpu = device::gpu();
    let folder = tempfile::tempdir().unwrap();
    let dataset = in_files(&four_views(), folder.path());
    let PhotoSource::File { path, .. } = &dataset.views[dataset.split(Split::Train)[0]].photo else {
        panic!("its photographs are in files");
    };
    let away = path.with_extension("away");
    let train = |is_missing: bool| {
        let mut trainer = Trainer::new(&gpu, &dataset, half_size(6)).unwrap();
        while !trainer.is_done() {
            if is_missing && trainer.iteration() == 6 {
                std::fs::rename(path, &away).unwrap();
                for _ in 0..2 {
                    let error = trainer.step().unwrap_err().to_string();
                    assert!(error.contains(path.to_str().unwrap()), "{error}");
                }
                std::fs::rename(&away, path).unwrap();
            }
            trainer.step().unwrap();
        }
        trainer.finish().unwrap();
        trainer.download().unwrap()
    };
    assert!(train(true) == train(false));
}

#[test]
fn reduced_photographs_grow_by_doubling() {
    let gpu = device::gpu();
    let dataset = four_views();
    let mut config = TrainConfig {
        coarse_halvings: 2,
        coarse_dilation: 1.0,
        ..half_size(6)
    };
    let splats = initial_splats(&dataset, dataset.extent(), &config).unwrap();
    let start = HostState::from_splats(&splats, config.sh_degree);
    let train = |dataset: &Dataset, config: &TrainConfig, state: &HostState, steps: std::ops::Range<u32>| {
        let mut trainer = Trainer::from_state(&gpu, dataset, config.clone(), state, steps.start).unwrap();
        steps.for_each(|_| assert!(trainer.step().is_ok()));
        trainer.finish().unwrap();
        trainer.download().unwrap()
    };
    let grown = train(&dataset, &config, &start, 0..9);
    // Three steps each on photographs of a quarter, half and the whole of their width and height.
    config.coarse_until = 0;
    let quarter = train(&resized(&dataset, 10, 9), &config, &start, 0..3);
    let half = train(&resized(&dataset, 20, 17), &config, &quarter, 3..6);
    assert!(train(&dataset, &config, &half, 6..9) == grown);
}

/// Pictures of half-size steps are the full-size ones averaged 2 × 2; splats drawn with an unscaled dilation would not
/// be.
#[test]
fn pictures_of_half_the_size_show_the_scene_as_it_is() {
    let gpu = device::gpu();
    let options = SynthOptions {
        views: 2,
        width: 64,
        height: 48,
        points: 900,
        test_every: 0,
        ..SynthOptions::default()
    };
    let dataset = ashfall::lab::synth::scene(Kind::Solids).dataset(&options);
    let small = resized(&dataset, 32, 24);
    let config = TrainConfig::for_iterations(100);
    let splats = initial_splats(&dataset, dataset.extent(), &config).unwrap();
    let mut state = HostState::from_splats(&splats, config.sh_degree);
    // Splats of about a pixel, so that the dilation matters.
    state.params[2]
        .iter_mut()
        .for_each(|scale| *scale = [-4.0, -4.0, -4.0, 0.0]);
    // The first step's image, drawn before the scene changes.
    let image = |dataset: &Dataset, half_size: bool| {
        let config = TrainConfig {
            coarse_until: u32::from(half_size),
            ..config.clone()
        };
        let mut trainer = Trainer::from_state(&gpu, dataset, config, &state, 0).unwrap();
        trainer.step().unwrap();
        trainer.image().unwrap()
    };
    let whole = image(&dataset, false);
    let reduced = |at: usize| {
        let (plane, x, y) = (at / (32 * 24), at % 32, at / 32 % 24);
        let pixel = |dx: usize, dy: usize| whole[(plane * 48 + 2 * y + dy) * 64 + 2 * x + dx];
        (pixel(0, 0) + pixel(1, 0) + pixel(0, 1) + pixel(1, 1)) / 4.0
    };
    let off = |image: &[f32]| -> f32 {
        let square = |at: usize| (image[at] - reduced(at)).powi(2);
        (0..4 * 32 * 24).map(square).sum::<f32>() / (4.0 * 32.0 * 24.0)
    };
    let (half, other) = (off(&image(&dataset, true)), off(&image(&small, false)));
    assert!(2.0 * half < other, "{half} and {other}");
}

#[test]
fn photographs_that_do_not_fit_are_streamed_with_the_same_result() {
    let gpu = device::gpu();
    let options = SynthOptions {
        views: 5,
        width: 40,
        height: 33,
        points: 300,
        test_every: 0,
        ..SynthOptions::default()
    };
    let dataset = ashfall::lab::synth::scene(Kind::Solids).dataset(&options);
    let train = |photo_share: f32| {
        let config = TrainConfig {
            photo_share,
            sh_degree: 0,
            ..TrainConfig::for_iterations(12)
        };
        let mut trainer = Trainer::new(&gpu, &dataset, config).unwrap();
        while !trainer.is_done() {
            trainer.step().unwrap();
        }
        trainer.download().unwrap()
    };
    assert!(train(0.25) == train(0.0), "streaming changed the result");
}
