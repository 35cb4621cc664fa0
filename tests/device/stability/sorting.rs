//! Section 5 of the catalogue: keys and sorting.

use crate::common::scenes::{self, Random, Scene};
use crate::stability::lab::{Lab, Lesson, U, difference, lab, same, view_options, within};
use crate::stability::props::{Prop, logit, picked, place, stage};
use ashfall::kernels::scan::Scan;
use ashfall::kernels::sort::{Io, Layout, Sort};
use ashfall::kernels::{sort_count, sort_scatter};
use ashfall::layout::*;
use ashfall::reference::{Options, frame};
use ashfall::render::{RenderedImage, ViewOptions};
use ashfall::scene::AlphaMode;
use std::fs;
use std::path::Path;

/// Half transparent splats in one place with the given depths, in random order.
pub(crate) fn stack(seed: u64, depths: &[f64]) -> Scene {
    let mut scene = stage(16, 16);
    scene.options.near = 1e-3;
    let random = &mut Random::new(seed);
    let order = random.permutation(depths.len());
    for i in order {
        let prop = Prop {
            depth: depths[i],
            color: [0; 3].map(|_| random.between(0.0, 1.0)),
            ..Prop::ball([8.0, 8.0], 50.0, logit(random.between(0.1, 0.5)))
        };
        place(&mut scene, &prop);
        // On the axis, so that only z differs, exactly.
        let last = scene.splats.mean.len() - 1;
        scene.splats.mean[last] = [0.0, 0.0, depths[i] as f32];
    }
    scene
}

/// Largest error against the oracle, which sorts by exact depth and ties by index.
pub(crate) fn order_error(scene: &Scene, image: &RenderedImage) -> f64 {
    let exact = frame::render(&scene.splats, &scene.camera, &scene.options);
    let pairs = image.rgb.iter().zip(&exact.pixels);
    let apart = pairs.flat_map(|(rgb, pixel)| [0, 1, 2].map(|c| (f64::from(rgb[c]) - pixel.color[c]).abs()));
    apart.fold(0.0, f64::max)
}

/// Depths that differ in their last bit are ordered, near and far.
#[test]
fn f044_depth_bits() {
    let lab = lab();
    for distance in [1.0f32, 10.0, 100.0, 1000.0, 1e5] {
        let depth = |i: u32| f64::from(f32::from_bits(distance.to_bits() + i));
        let scene = stack(544, &(0..40).map(depth).collect::<Vec<_>>());
        // 40 layers of an opacity with the exponential's rounding; a splat out of order changes a pixel by 0.1.
        let bound = 14.1 * 2.0 * U + 42.0 * U;
        let error = order_error(&scene, &lab.draw(&scene));
        within(
            "sort",
            "44",
            &format!("depths one bit apart at {distance:.0e}"),
            error,
            bound,
        );
    }
}

/// Depths on both sides of the camera: splats behind it are not drawn, at any near plane and sign.
#[test]
fn f045_depths_of_either_sign() {
    let lab = lab();
    let depths: Vec<f64> = (0..30).map(|i| 0.5 + f64::from(i) * 0.25).collect();
    let front = stack(545, &depths);
    let mut both = front.clone();
    both.splats = picked(&front.splats, &(0..30).chain(0..30).collect::<Vec<_>>());
    for (i, mean) in both.splats.mean[30..].iter_mut().enumerate() {
        mean[2] = [-mean[2], -0.0, 0.0, f32::NAN, -f32::MIN_POSITIVE][i % 5];
    }
    for near in [1e-3, 0.0, -0.0, -1e9, f32::NEG_INFINITY, f32::NAN] {
        let view = ViewOptions {
            near,
            ..view_options(&front)
        };
        let image = lab.draw_with(&both, &view);
        assert!(same(&image, &lab.draw(&front)), "near plane {near}");
    }
}

/// Splats of equal depth are ordered by index, in every run.
#[test]
fn f046_equal_depths() {
    let lab = lab();
    let scene = stack(546, &[3.0; 40]);
    let image = lab.draw(&scene);
    let bound = 14.1 * 2.0 * U + 42.0 * U;
    within("sort", "46", "40 coplanar splats", order_error(&scene, &image), bound);
    for _ in 0..3 {
        assert!(same(&lab.draw(&scene), &image), "another order of equals");
    }
    let turned = Scene {
        splats: picked(&scene.splats, &(0..40).rev().collect::<Vec<_>>()),
        ..scene.clone()
    };
    assert!(
        difference(&lab.draw(&turned), &image) > 0.01,
        "the order of equals shows, so that it can be tested"
    );
}

/// Sorts keys with their indices as values; returns keys and values.
fn sorted(lab: &Lab, sort: &Sort, keys: &[u32]) -> [Vec<u32>; 2] {
    let (gpu, len) = (lab.gpu(), keys.len());
    let values: Vec<u32> = (0..len as u32).collect();
    let chunks = sort.chunks(LAYOUT, len);
    let entries = chunks * LAYOUT.digit_count() as usize;
    let mut slots = [0u32; COUNT_SLOTS as usize];
    slots[LAYOUT.count_slot as usize] = len as u32;
    slots[LAYOUT.chunk_slot as usize] = chunks as u32;
    slots[LAYOUT.table_slot as usize] = entries as u32;
    let groups = |count: usize, workgroup: u32| DispatchArgs {
        x: (count as u32).div_ceil(workgroup),
        y: 1,
        z: 1,
    };
    let scanned = entries.div_ceil(SCAN_CHUNK as usize);
    let scan = Scan::new(gpu).unwrap();
    let args = [
        groups(chunks, sort.chunks_per_group),
        groups(scanned, scan.chunks_per_group),
    ];
    let pair = |name, data: &[u32]| [gpu.buffer_from(name, data).unwrap(), gpu.buffer(name, len).unwrap()];
    let (keys, values) = (pair("keys", keys), pair("values", &values));
    let io = Io {
        counts: &gpu.buffer_from("counts", &slots).unwrap(),
        args: &gpu.buffer_from("args", &args).unwrap(),
        keys: &keys,
        values: &values,
        table: &gpu.buffer("table", entries).unwrap(),
        places: &gpu.buffer("places", entries).unwrap(),
        sums: &gpu.buffer("sums", scanned).unwrap(),
    };
    let mut place = 0;
    gpu.run(|rec| place = sort.record(rec, &scan, io, LAYOUT)).unwrap();
    [&keys[place], &values[place]].map(|buffer| gpu.download(buffer, 0..len).unwrap())
}

/// Eight bits a pass, over all of a key's 32 bits.
const LAYOUT: Layout = Layout {
    digit_bits: 8,
    passes: 4,
    count_slot: COUNT_ISECT,
    chunk_slot: COUNT_ISECT_CHUNK,
    table_slot: COUNT_ISECT_TABLE,
    chunk_args: 0,
    table_args: 1,
};

/// A permutation is sorted to the identity: no key is lost or duplicated.
#[test]
fn f047_permutations() {
    let lab = lab();
    let sort = Sort::new(lab.gpu()).unwrap();
    for power in [0, 5, 8, 10, 12, 16, 20] {
        for len in [(1usize << power) - 1, 1 << power, (1 << power) + 1] {
            if len == 0 {
                continue;
            }
            let keys: Vec<u32> = Random::new(len as u64)
                .permutation(len)
                .iter()
                .map(|&k| k as u32)
                .collect();
            let [found, places] = sorted(&lab, &sort, &keys);
            assert!(
                found.iter().zip(0..).all(|(&f, i)| f == i),
                "{len} keys are not the identity"
            );
            assert!(
                places.iter().zip(0..).all(|(&p, i)| keys[p as usize] == i),
                "{len} values"
            );
        }
    }
}

/// Blocks that are full, one over, or one short, of equal keys: the sort is stable.
#[test]
fn f048_partial_blocks() {
    let lab = lab();
    let sort = Sort::new(lab.gpu()).unwrap();
    for chunk in [16, 256, 1024] {
        let chunks = sort.chunks(LAYOUT, 1);
        for len in [chunks * chunk, chunks * chunk + 1, chunks * (chunk + 4) - 1] {
            for key in [0, u32::MAX, 0x0102_0304] {
                let keys = vec![key; len];
                let [found, places] = sorted(&lab, &sort, &keys);
                assert_eq!(found, keys, "{len} keys {key:#x} in chunks of {chunk}");
                assert!(
                    places.iter().zip(0..).all(|(&p, i)| p == i),
                    "{len} keys {key:#x}: not stable"
                );
            }
        }
    }
}

/// Every variant and every workgroup size gives the same result.
#[test]
fn f049_subgroup_sizes() {
    let lab = lab();
    let gpu = lab.gpu();
    let random = &mut Random::new(549);
    let keys: Vec<u32> = (0..20_001).map(|_| random.bits() as u32).collect();
    let expected = sorted(&lab, &Sort::new(gpu).unwrap(), &keys);
    let size = gpu.caps().subgroup_size;
    let mut seen = 0;
    for count in sort_count::Variant::ALL {
        for scatter in sort_scatter::Variant::ALL {
            let whole = *count == sort_count::Variant::Subgroup;
            if whole != (*scatter == sort_scatter::Variant::Subgroup) || gpu.caps().supports(scatter.info()).is_err() {
                continue;
            }
            for workgroup in if whole { [size, 2 * size, 8 * size] } else { [1, 8, 64] } {
                let count = sort_count::Choice {
                    variant: *count,
                    spec: sort_count::Spec { workgroup },
                };
                let scatter = sort_scatter::Choice {
                    variant: *scatter,
                    spec: sort_scatter::Spec { workgroup },
                };
                let sort = Sort::with(gpu, count, scatter).unwrap();
                assert_eq!(sorted(&lab, &sort, &keys), expected, "{count:?}, {scatter:?}");
                seen += 1;
            }
        }
    }
    assert!(seen >= 3, "{seen} ways to sort");
}

/// No workgroup waits for another, since Vulkan does not guarantee forward progress between workgroups: shaders use no
/// memory operation that waiting needs.
#[test]
fn f050_no_look_back() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("glsl");
    let mut seen = 0;
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if !path.is_file() {
            continue;
        }
        seen += 1;
        let text = fs::read_to_string(&path).unwrap();
        for line in text.lines().map(|line| line.split("//").next().unwrap_or_default()) {
            for word in ["coherent", "volatile", "while (true)", "atomicCompSwap", "atomicLoad"] {
                assert!(!line.contains(word), "{}: {word}", path.display());
            }
        }
    }
    assert!(seen > 20, "{seen} shaders");
}

/// Tiles that cross the image's edge, and tiles that are masked out entirely.
#[test]
fn f051_partial_and_masked_tiles() {
    use ashfall::reference::loss::{Target, values};
    let lab = lab();
    for (width, height) in [(9, 17), (17, 31), (33, 18)] {
        let scene = scenes::gentle(551, 20, width, height, 0);
        let mut lesson = Lesson::photo(&scene, 0.2);
        lesson.alpha = AlphaMode::Mask;
        for (i, pixel) in lesson.rgba.iter_mut().enumerate() {
            let (x, y) = (i as u32 % width, i as u32 / width);
            pixel[3] = if x < 16 && y < 16 { 0 } else { 200 };
        }
        let stepped = lab.step(&scene, &lesson);
        let options = Options {
            near: f64::from(stepped.near),
            ..scene.options
        };
        let (photo, mask) = values(&lesson.rgba, AlphaMode::Mask, scene.options.background);
        let target = Target {
            mask: mask.as_deref(),
            lambda: f64::from(lesson.lambda),
            ..Target::new(width as usize, &photo)
        };
        let exact = ashfall::reference::loss_gradient(&scene.splats, &scene.camera, &options, &target);
        let error = (stepped.report.loss / exact.loss - 1.0).abs();
        // Sums of some hundred terms, and SSIM's shifted variances: the usual 1e-5.
        within(
            "loss",
            "51",
            &format!("{width} × {height}, a tile masked out"),
            error,
            1e-5,
        );
    }
}
