//! Terms of geometry in a training step: gradients against the oracle's, bands, resumption, and steps without terms.

use crate::common::device;
use crate::common::scenes::{self, Random, Scene, flattened};
use crate::gradients::oracle::compare_by;
use crate::gradients::{BEGUN, config, dataset, step_by};
use ashfall::gpu::Gpu;
use ashfall::scene::{Primitive, ScreenFilter};
use ashfall::train::{HostState, TrainConfig, Trainer};
use glam::{DQuat, DVec2, DVec3};

/// Columns and rows of splats for the oracle, which takes its time.
const SMALL: [usize; 2] = [6, 5];

/// Splats beside a tilted plane, of about its direction, that cover the image.
fn sheet(seed: u64, filter: ScreenFilter, [columns, rows]: [usize; 2]) -> Scene {
    let mut scene = scenes::gentle(seed, columns * rows, 33, 25, 0);
    scene.splats.filter = filter;
    let random = &mut Random::new(seed + 1);
    let camera = scene.camera;
    let world_from_view = camera.rotation.transpose();
    let normal = DVec3::new(0.5, -0.3, 1.0).normalize();
    for i in 0..columns * rows {
        let cell = DVec2::new((i % columns) as f64 + 0.5, (i / columns) as f64 + 0.5);
        let apart = DVec2::new(random.between(-0.2, 0.2), random.between(-0.2, 0.2));
        let pixel = (cell + apart) * DVec2::new(33.0 / columns as f64, 25.0 / rows as f64);
        let ray = ((pixel - camera.center) / camera.focal).extend(1.0);
        let depth = 3.0 / normal.dot(ray) * random.between(0.99, 1.01);
        let mean = camera.position + world_from_view * (ray * depth);
        let lean = DVec3::new(random.between(-0.3, 0.3), random.between(-0.3, 0.3), 0.0);
        let turn = DQuat::from_rotation_z(random.between(0.0, 6.0));
        let q = DQuat::from_rotation_arc(DVec3::Z, world_from_view * (normal + lean).normalize()) * turn;
        scene.splats.mean[i] = mean.as_vec3().to_array();
        scene.splats.quaternion[i] = [q.w, q.x, q.y, q.z].map(|x| 1.3 * x as f32);
        let footprint = depth / camera.focal.x;
        let scales = [
            random.between(3.0, 5.0),
            random.between(2.5, 4.0),
            random.between(0.5, 1.0),
        ];
        scene.splats.log_scale[i] = scales.map(|s| (s * footprint).ln() as f32);
        scene.splats.opacity_logit[i] = random.between(-0.5, 2.0) as f32;
    }
    scene
}

/// Weights at which the terms are as strong as the photograph.
fn with_terms(scene: &Scene) -> TrainConfig {
    let mut config = config(scene);
    config.geometry.normal = 0.5;
    config.geometry.distortion = 40.0;
    config
}

#[test]
fn gradients_with_terms_are_the_oracles_for_both_kinds() {
    for (name, filter) in [("classic", ScreenFilter::Classic), ("mip", ScreenFilter::Mip)] {
        let scene = sheet(171, filter, SMALL);
        let filters = match filter {
            ScreenFilter::Classic => Vec::new(),
            ScreenFilter::Mip => scenes::filters(&scene.splats, 3),
        };
        compare_by(name, &[(scene, filters)], with_terms);
        let scene = flattened(sheet(172, filter, SMALL), filter);
        compare_by(name, &[(scene, Vec::new())], with_terms);
    }
}

fn begun<'a>(gpu: &Gpu, scene: &'a Scene, dataset: &'a ashfall::scene::Dataset, config: TrainConfig) -> Trainer<'a> {
    let state = HostState::from_splats(&scene.splats, scene.splats.sh_degree);
    Trainer::from_state(gpu, dataset, config, &state, BEGUN).unwrap()
}

#[test]
fn terms_take_effect_from_their_start_and_bands_and_resumption_change_no_bit() {
    let gpu = device::gpu();
    for kind in [Primitive::Gaussian3d, Primitive::Surfel] {
        let mut scene = sheet(173, ScreenFilter::Classic, SMALL);
        if kind == Primitive::Surfel {
            scene = flattened(scene, ScreenFilter::Classic);
        }
        let dataset = dataset(&scene, &scene.camera);
        // The terms begin with the third step.
        let mut config = with_terms(&scene);
        let start = (f64::from(BEGUN) + 2.5) / f64::from(config.iterations);
        (config.geometry.normal_from, config.geometry.distortion_from) = (start as f32, start as f32);
        config.geometry.ramp = 1e-4;
        let plain = TrainConfig {
            geometry: Default::default(),
            ..config.clone()
        };
        let after = |config: &TrainConfig, steps: u32, isects: Option<usize>| {
            let mut trainer = begun(&gpu, &scene, &dataset, config.clone());
            if let Some(isects) = isects {
                trainer.set_isect_capacity(isects).unwrap();
            }
            // Steps that do not fit are repeated.
            while trainer.iteration() < BEGUN + steps {
                trainer.step().unwrap();
            }
            trainer.finish().unwrap();
            assert_eq!(trainer.iteration(), BEGUN + steps);
            trainer.download().unwrap()
        };
        assert!(
            after(&config, 2, None) == after(&plain, 2, None),
            "terms before their start"
        );
        let whole = after(&config, 6, None);
        assert!(whole != after(&plain, 6, None), "no terms after their start");
        assert!(whole == after(&config, 6, Some(50)), "other bits with small buffers");
        let half = after(&config, 4, None);
        let mut resumed = Trainer::from_state(&gpu, &dataset, config, &half, BEGUN + 4).unwrap();
        for _ in 0..2 {
            resumed.step().unwrap();
        }
        assert!(resumed.download().unwrap() == whole, "resumed elsewhere");
    }
}

#[test]
fn bands_change_no_bit_of_gradients_with_terms() {
    let scene = sheet(174, ScreenFilter::Classic, [20, 16]);
    for scene in [scene.clone(), flattened(scene, ScreenFilter::Classic)] {
        let state = HostState::from_splats(&scene.splats, scene.splats.sh_degree);
        let of = |gpu: &Gpu| step_by(gpu, &scene, &state, with_terms(&scene)).gradients;
        let whole = of(&device::gpu());
        // Records of a thousand pairs at most.
        let banded = of(&device::narrow(40 << 10));
        assert!(whole == banded, "other bits in bands");
    }
}
