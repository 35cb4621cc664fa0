//! Section 4 of the catalogue: instances and tile lists.

use crate::common::scenes::{self, Random};
use crate::stability::lab::{BEGUN, Lesson, apart, config, dataset, image_bound, lab, same, view_options, within};
use crate::stability::props::{OPAQUE, Prop, place, stage};
use ashfall::gpu::Groups;
use ashfall::kernels::gather::{self, Gather};
use ashfall::kernels::plan::{self, Plan};
use ashfall::kernels::scan::{Io, Scan, What};
use ashfall::layout::*;
use ashfall::render::{Capacity, Model, RenderOptions, Renderer};
use ashfall::train::{HostState, Trainer};

/// A count of intersections beyond 32 bits saturates instead of wrapping.
#[test]
fn f037_count_saturates() {
    let lab = lab();
    let gpu = lab.gpu();
    for (values, total) in [
        (vec![0x9000_0000u32, 0x9000_0000, 5], u32::MAX),
        (vec![u32::MAX, 1, 1], u32::MAX),
        (vec![70_000; 65_536], u32::MAX),
        (vec![7; 600], 4200),
    ] {
        let mut slots = [0u32; COUNT_SLOTS as usize];
        slots[COUNT_VISIBLE as usize] = values.len() as u32;
        let counts = gpu.buffer_from("counts", &slots).unwrap();
        let args = gpu.buffer::<DispatchArgs>("args", ARGS_SLOTS as usize).unwrap();
        let scan = Scan::new(gpu).unwrap();
        let plan = Plan::new(gpu, plan::Choice::default()).unwrap();
        let (data, offsets) = (
            gpu.buffer_from("values", &values).unwrap(),
            gpu.buffer("offsets", values.len()).unwrap(),
        );
        let sums = gpu.buffer("sums", values.len().div_ceil(SCAN_CHUNK as usize)).unwrap();
        let io = Io {
            counts: &counts,
            values: &data,
            offsets: &offsets,
            sums: &sums,
        };
        let what = What {
            count_slot: COUNT_VISIBLE,
            total_slot: COUNT_ISECT,
            flags: false,
        };
        let params = plan::Params {
            stage: 1,
            isect_capacity: 1_000_000,
            chunk: 1024,
            chunks_per_group: 8,
            digit_count: 256,
            workgroup: 64,
            scanned_per_group: 64,
            group_limit: 65_535,
            tile_count: 1020,
            band: 0,
            band_count: 1,
            rank_limit: u32::MAX,
        };
        gpu.run(|rec| {
            scan.record(rec, io, what, scan.groups(values.len()));
            let io = plan::Bindings {
                counts: &counts,
                args: &args,
                isect_from_rank: &offsets,
            };
            plan.record(rec, io, params, Groups::Count(1));
        })
        .unwrap();
        let found = gpu.download(&counts, 0..COUNT_SLOTS as usize).unwrap();
        let slot = |slot: u32| found[slot as usize];
        assert_eq!(slot(COUNT_ISECT_WANTED), total);
        let failed = total > params.isect_capacity;
        assert_eq!(slot(COUNT_FAILED) != 0, failed);
        assert_eq!(slot(COUNT_ISECT), if failed { 0 } else { total });
        let groups = gpu.download(&args, 0..ARGS_SLOTS as usize).unwrap()[ARGS_EXPAND as usize];
        assert_eq!(groups.x == 0, failed, "something is written that has no room");
    }
}

/// A list one entry beyond the capacity is drawn and trained like any other.
#[test]
fn f038_room_for_one_less() {
    let lab = lab();
    let mut scene = stage(96, 80);
    for i in 0..6 {
        let depth = 3.0 + f64::from(i);
        place(
            &mut scene,
            &Prop {
                depth,
                ..Prop::ball([48.0, 40.0], 20.0, 0.0)
            },
        );
    }
    let lesson = Lesson::photo(&scene, 0.2);
    let clean = lab.step(&scene, &lesson);
    let wanted = clean.report.isect_count;
    assert!(wanted > 4 * 6 + 1, "{wanted} intersections: too few for this test");
    let expected = lab.draw(&scene);
    for isects in [wanted, wanted - 1, 1] {
        let options = RenderOptions {
            capacity: Capacity::for_image(6, isects, 96, 80),
            with_depth: true,
            ..RenderOptions::default()
        };
        let mut renderer = Renderer::new(lab.gpu(), options).unwrap();
        let model = Model::upload(lab.gpu(), &scene.splats).unwrap();
        let image = renderer.render(&model, &scene.camera, &view_options(&scene)).unwrap();
        assert!(same(&image, &expected), "room for {isects} of {wanted}");
        let dataset = dataset(&scene, &lesson);
        let state = HostState::from_splats(&scene.splats, 0);
        let config = config(&scene, lesson.lambda);
        let mut trainer = Trainer::from_state(lab.gpu(), &dataset, config, &state, BEGUN).unwrap();
        trainer.set_isect_capacity(isects).unwrap();
        trainer.step().unwrap();
        assert!(
            trainer.download().unwrap() == clean.after,
            "a step with room for {isects} of {wanted}"
        );
    }
}

/// Empty scene, nothing in front of the near plane, or nothing in the picture: the background, and no gradient.
#[test]
fn f039_nothing_to_draw() {
    let lab = lab();
    let full = scenes::gentle(439, 12, 40, 33, 1);
    let camera = full.camera;
    let (mut empty, mut behind, mut beside) = (full.clone(), full.clone(), full.clone());
    empty.splats = scenes::gentle(439, 0, 40, 33, 1).splats;
    for mean in &mut behind.splats.mean {
        *mean = (camera.position - camera.rotation.row(2) * 3.0).as_vec3().to_array();
    }
    for mean in &mut beside.splats.mean {
        let there = camera.rotation.row(2) * 3.0 + camera.rotation.row(0) * 90.0;
        *mean = (camera.position + there).as_vec3().to_array();
    }
    let mut faint = full.clone();
    faint.splats.opacity_logit.fill(-7.0);
    for (name, scene) in [
        ("empty", empty),
        ("behind", behind),
        ("beside", beside),
        ("faint", faint),
    ] {
        let image = lab.draw(&scene);
        let background = scene.options.background.map(|c| c as f32);
        assert!(image.rgb.iter().all(|&c| c == background), "{name}: not the background");
        assert!(image.transmittance.iter().all(|&t| t == 1.0), "{name}");
        let stepped = lab.step(&scene, &Lesson::photo(&scene, 0.2));
        assert_eq!(stepped.report.isect_count, 0, "{name}");
        assert!(
            stepped.gradients.iter().flatten().flatten().all(|&g| g == 0.0),
            "{name}: a gradient"
        );
    }
}

/// One splat, thousands of tiles.
#[test]
fn f040_more_tiles_than_instances() {
    let lab = lab();
    let mut scene = stage(2048, 1024);
    place(&mut scene, &Prop::ball([2044.5, 1020.5], 1.0, OPAQUE));
    let image = lab.draw(&scene);
    let drawn = image.transmittance.iter().filter(|&&t| t < 1.0).count();
    // π · 3.33² · (1 + 0.3) pixels, less those beyond the corner.
    assert!((30..50).contains(&drawn), "{drawn} pixels");
    assert!(image.transmittance[1020 * 2048 + 2044] < 1e-4);
}

/// Dispatches and images beyond the limit of one grid dimension.
#[test]
fn f041_dispatch_limits() {
    let lab = lab();
    for (width, height) in [(16_385, 1), (1, 16_385)] {
        let scene = scenes::gentle(441, 24, width, height, 0);
        let error = apart(&scene, &lab.draw(&scene), 1e-2);
        // Positions of 16,385 px: two ULPs are 2e-3 px.
        within(
            "frame",
            "41",
            &format!("{width} × {height}"),
            error,
            image_bound(16_385, 0.55, 24, 1.0),
        );
    }
    let gpu = lab.gpu();
    let count = 65_535 * 64 + 1;
    let index: Vec<u32> = (0..count).rev().collect();
    let mut slots = [0u32; COUNT_SLOTS as usize];
    slots[COUNT_VISIBLE as usize] = count;
    let groups = DispatchArgs { x: 65_535, y: 2, z: 1 };
    let index = gpu.buffer_from("index", &index).unwrap();
    let target = gpu.buffer::<u32>("target", count as usize).unwrap();
    let io = gather::Bindings {
        counts: &gpu.buffer_from("counts", &slots).unwrap(),
        splat_from_rank: &index,
        tile_count_from_splat: &index,
        tile_count_from_rank: &target,
    };
    let args = gpu.buffer_from("args", &[groups]).unwrap();
    let kernel = Gather::new(gpu, gather::Choice::default()).unwrap();
    gpu.run(|rec| kernel.record(rec, io, Groups::indirect(&args, 0)))
        .unwrap();
    let found = gpu.download(&target, 0..count as usize).unwrap();
    assert!(
        found.iter().zip(0..).all(|(&f, i)| f == i),
        "an element beyond 65,535 groups is lost"
    );
}

/// A splat over the whole picture at most doubles the device time of a frame.
#[test]
fn f042_monster_splat() {
    let lab = lab();
    let mut scene = stage(512, 512);
    let random = &mut Random::new(442);
    for i in 0..3000 {
        let pixel = [random.between(0.0, 512.0), random.between(0.0, 512.0)];
        let depth = 2.0 + f64::from(i) * 1e-3;
        place(
            &mut scene,
            &Prop {
                depth,
                ..Prop::ball(pixel, 3.0, -1.0)
            },
        );
    }
    let mut monster = scene.clone();
    place(
        &mut monster,
        &Prop {
            depth: 1.0,
            ..Prop::ball([256.0, 256.0], 3000.0, -3.0)
        },
    );
    // Minimum of several alternating runs, since the machine may have other load.
    let mut least = [f64::INFINITY; 2];
    for _ in 0..7 {
        for (least, scene) in least.iter_mut().zip([&scene, &monster]) {
            *least = least.min(lab.device_time(scene));
        }
    }
    within(
        "frame",
        "42",
        "a splat over the whole picture, time",
        least[1] / least[0],
        2.0,
    );
}

/// Lists of one intersection, in images with tile counts around every power of two.
#[test]
fn f043_offsets_of_empty_tiles() {
    let lab = lab();
    for tiles in [1u32, 2, 3, 4, 5, 7, 8, 9, 15, 16, 17, 31, 32, 33, 64, 65] {
        for tile in [0, tiles - 1] {
            let mut scene = stage(tiles * TILE_WIDTH, TILE_HEIGHT);
            let middle = [f64::from(tile * TILE_WIDTH) + 4.0, 8.0];
            place(
                &mut scene,
                &Prop {
                    depth: 1.0,
                    ..Prop::ball(middle, 0.1, 0.0)
                },
            );
            let image = lab.draw(&scene);
            let in_tile = |i: usize| (i as u32 % scene.camera.width) / TILE_WIDTH == tile;
            for (i, &through) in image.transmittance.iter().enumerate() {
                assert!(
                    in_tile(i) || through == 1.0,
                    "{tiles} tiles, splat in {tile}: drawn elsewhere"
                );
            }
            let drawn = image.transmittance.iter().filter(|&&t| t < 1.0).count();
            assert!(drawn >= 4, "{tiles} tiles, splat in {tile}: {drawn} pixels");
        }
    }
}
