//! From parameters to the ellipse, its colour and its number of tiles.

use crate::common::check::*;
use crate::common::lists::{view, viewpoint};
use crate::common::pack::Splat2d;
use crate::common::{device, pack, scenes};
use crate::kernels::supported;
use ashfall::gpu::Gpu;
use ashfall::kernels::project::{Bindings, Choice, Params, Project, Spec};
use ashfall::reference::project::margins;
use ashfall::reference::smoothing::smoothed;
use ashfall::reference::tiles::{Grid, alpha_at_pixels, alpha_max};
use ashfall::reference::{Splat, Thresholds, project};
use ashfall::render::planes_from_splats;
use ashfall::scene::ScreenFilter;
use scenes::Scene;

fn mip(mut scene: Scene) -> Scene {
    scene.splats.filter = ScreenFilter::Mip;
    scene
}

/// A name, a scene, and the 3D filter of each of its splats.
type Case = (&'static str, Scene, Vec<f32>);

fn cases(sh_degree: u32) -> Vec<Case> {
    let plain = |(name, scene): (&'static str, Scene)| {
        let none = vec![0.0; scene.splats.len()];
        (name, scene, none)
    };
    let smooth = |(name, scene): (&'static str, Scene)| {
        let filters = scenes::filters(&scene.splats, 1);
        (name, mip(scene), filters)
    };
    let plain = plain_scenes(sh_degree).into_iter().map(plain);
    let smoothed = [
        ("smoothed", scenes::gentle(10, 100, 97, 129, sh_degree)),
        ("smoothed, hard", scenes::hard(11, 270, 97, 129, sh_degree)),
    ];
    plain.chain(smoothed.map(smooth)).collect()
}

fn plain_scenes(sh_degree: u32) -> Vec<(&'static str, Scene)> {
    vec![
        ("nothing to draw", scenes::gentle(1, 0, 33, 47, sh_degree)),
        ("one", scenes::gentle(2, 1, 33, 47, sh_degree)),
        ("2^6 + 1", scenes::gentle(3, 65, 80, 61, sh_degree)),
        ("hard", scenes::hard(4, 270, 97, 129, sh_degree)),
        ("one pixel", scenes::hard(5, 90, 1, 1, sh_degree)),
        ("wide", scenes::hard(6, 270, 500, 20, sh_degree)),
        ("mip", mip(scenes::gentle(7, 100, 97, 129, sh_degree))),
        ("mip, hard", mip(scenes::hard(8, 270, 97, 129, sh_degree))),
    ]
}

/// Columns of the record, by quantity.
struct Columns {
    found: [Vec<f64>; 5],
    expected: [Vec<f64>; 5],
}

/// Compares what was found with the oracle, splat by splat.
fn outputs(
    scene: &Scene,
    filters: &[f32],
    records: &[Splat2d],
    tile_counts: &[u32],
) -> Vec<Output> {
    let at = viewpoint(scene);
    let grid = Grid::new(scene.camera.width, scene.camera.height);
    let cut = Thresholds::ENGINE.alpha_min;
    let mut columns = Columns {
        found: Default::default(),
        expected: Default::default(),
    };
    let (mut counted, mut least, mut near) = (Vec::new(), Vec::new(), Vec::new());
    let mut most = 0.0f64;
    for (i, &count) in tile_counts.iter().enumerate() {
        let splat = smoothed(&Splat::<f64>::of(&scene.splats, i), filters[i].into());
        let screen = project(&splat, &at);
        counted.push(f64::from(count));
        let tiles = |alpha: &dyn Fn(u32) -> f64, cut: f64| {
            (0..grid.len()).filter(|&tile| alpha(tile) >= cut).count() as f64
        };
        let Some(screen) = screen.filter(|s| s.opacity >= cut * (1.0 - 1e-5)) else {
            least.push(0.0);
            near.push(false);
            continue;
        };
        // A pixel centre well inside needs its tile, an ellipse well outside does not; between, as it comes.
        // The margins are those of `expand`, whose lists are as long.
        let low = tiles(&|tile| alpha_at_pixels(&screen, &grid, tile), cut * 1.01);
        let high = tiles(&|tile| alpha_max(&screen, &grid, tile), cut * 0.99);
        assert!(
            (low..=high).contains(&f64::from(count)),
            "splat {i} has {count} tiles, not {low} to {high}"
        );
        least.push(low);
        near.push(low < high);
        most = most.max(high - low);
        if count == 0 || margins(&splat, &at).limit < 1e-5 {
            continue;
        }
        let found = &records[i];
        let [shape, tone, rest] = pack::splat2d_values(&screen);
        let pairs = [
            (
                vec![found.shape[0], found.shape[1]],
                vec![shape[0], shape[1]],
            ),
            (vec![found.shape[2]], vec![shape[2]]),
            (vec![found.shape[3]], vec![shape[3]]),
            (vec![found.tone[0], found.tone[1]], vec![tone[0], tone[1]]),
            (
                vec![found.tone[2], found.tone[3], found.rest[0], found.rest[1]],
                vec![tone[2], tone[3], rest[0], rest[1]],
            ),
        ];
        for (slot, (f, e)) in pairs.into_iter().enumerate() {
            columns.found[slot].extend(f.into_iter().map(f64::from));
            columns.expected[slot].extend(e);
        }
    }
    let [mean, slope, opacity, whiten, color] = columns.found;
    let [mean_e, slope_e, opacity_e, whiten_e, color_e] = columns.expected;
    // A position in the view is a sum of three products of numbers up to 4: 5u · 4 of a depth of 2 and more,
    // times a focal length of up to 1.2 sizes: 1e-6 of the image. Whitening passes through about 30 roundings and
    // is built of sums of squares: 1e-5. A slope is not: a needle that points at the camera is foreshortened by a
    // difference that leaves the 30u of its full length, 50 px and more, of which a slope of 1 divides by as
    // little as 0.55 px: 2e-4. Logarithms carry the specification's 3 ULP at 8, and in mip mode half the error of
    // a determinant. Colours are sums of 16 products.
    let size = f64::from(scene.camera.width.max(scene.camera.height));
    vec![
        Output::exact("tile count", counted, least).near(near, most, 1.0),
        Output::relative("mean", mean, mean_e, 2e-6, size),
        Output::relative("slope", slope, slope_e, 2e-4, 1.0),
        Output::relative("opacity", opacity, opacity_e, 1e-5, 1.0),
        Output::relative("whitening", whiten, whiten_e, 1e-5, 0.0),
        Output::relative("colour and depth", color, color_e, 2e-6, 1.0),
    ]
}

/// What the kernel makes of a scene with these parameters: records and tile counts.
fn run(
    gpu: &Gpu,
    kernel: &Project,
    scene: &Scene,
    planes: &[[f32; 4]],
    index: Option<&[u32]>,
) -> (Vec<Splat2d>, Vec<u32>) {
    let count = scene.splats.len();
    let shapes = unwritten::<[f32; 4]>(gpu, count);
    let tones = unwritten::<[f32; 4]>(gpu, count);
    let rests = unwritten::<[f32; 2]>(gpu, count);
    let tiles = unwritten::<u32>(gpu, count + 1);
    let io = Bindings {
        view: &buffer(gpu, &[view(scene)]),
        params: &buffer(gpu, planes),
        ellipse_from_splat: &shapes,
        whiten_rg_from_splat: &tones,
        blue_depth_from_splat: &rests,
        tile_count_from_splat: &tiles,
        splat_from_slot: &buffer(gpu, index.unwrap_or(&[UNWRITTEN])),
    };
    let params = Params {
        splat_count: count as u32,
        stride: count as u32,
    };
    gpu.run(|rec| kernel.record(rec, io, params, kernel.groups(count)))
        .unwrap();
    let mut tiles = read(gpu, &tiles);
    assert_eq!(tiles.pop(), Some(UNWRITTEN), "wrote past the end");
    let (shapes, tones, rests) = (read(gpu, &shapes), read(gpu, &tones), read(gpu, &rests));
    let records = (0..count).map(|i| Splat2d {
        shape: shapes[i],
        tone: tones[i],
        rest: rests[i],
    });
    (records.collect(), tiles)
}

#[test]
fn splats_are_projected() {
    let gpu = device::gpu();
    let mut check = Check::new("project");
    for variant in supported!(project, gpu) {
        for sh_degree in 0..=3 {
            for workgroup in [8, 64] {
                let spec = Spec {
                    workgroup,
                    sh_degree,
                    ..Spec::default()
                };
                let kernel = Project::new(&gpu, Choice { variant, spec }).unwrap();
                for (name, scene, filters) in cases(sh_degree) {
                    let count = scene.splats.len();
                    let mut planes = planes_from_splats(&scene.splats);
                    pack::set_filters(&mut planes, &filters);
                    let (records, tiles) = run(&gpu, &kernel, &scene, &planes, None);
                    let case = format!("{name}, degree {sh_degree}");
                    let outputs = outputs(&scene, &filters, &records, &tiles[..count]);
                    check.outputs(&case, outputs);
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
    let kernels = [Choice::default(), indexed].map(|choice| Project::new(&gpu, choice).unwrap());
    let scene = scenes::hard(4, 270, 97, 129, 3);
    let planes = planes_from_splats(&scene.splats);
    let index = scenes::shuffled(270);
    let moved = scenes::in_order(&planes, &index);
    // As text: records of splats that are not drawn are left as they were, no numbers.
    let run = |planes: &[[f32; 4]], index: Option<&[u32]>| {
        let kernel = &kernels[usize::from(index.is_some())];
        format!("{:?}", run(&gpu, kernel, &scene, planes, index))
    };
    let ordered = run(&planes, None);
    assert!(run(&moved, Some(&index)) == ordered, "not in their places");
    assert!(
        run(&moved, None) != ordered,
        "the order makes no difference"
    );
}

#[test]
fn poison_is_not_drawn_and_harms_nobody() {
    let gpu = device::gpu();
    let kernel = Project::new(&gpu, Choice::default()).unwrap();
    let scene = scenes::gentle(9, 3, 33, 47, 3);
    let clean = planes_from_splats(&scene.splats);
    let run = |planes: &[[f32; 4]]| run(&gpu, &kernel, &scene, planes, None);
    let (records, tiles) = run(&clean);
    let places = (0..clean.len() / 3).map(|plane| (plane, plane % 3));
    // The smoothing filter; one that is no number is none.
    for (plane, lane) in places.chain([(2, 3)]) {
        for poison in scenes::POISON.iter().step_by(3) {
            let mut planes = clean.clone();
            planes[plane * 3 + 1][lane] = *poison;
            let (found, counts) = run(&planes);
            for i in [0, 2] {
                assert_eq!((found[i], counts[i]), (records[i], tiles[i]), "{poison:e}");
            }
            let drawn = counts[1] > 0;
            assert!(
                !drawn || poison.is_finite() || lane == 3,
                "{poison:e} in plane {plane} is drawn"
            );
            let Splat2d { shape, tone, rest } = found[1];
            let sound = [&shape[..], &tone, &rest].concat();
            assert!(
                !drawn || sound.iter().all(|x| x.is_finite()),
                "{poison:e} in plane {plane}: {:?}",
                found[1]
            );
            assert!(counts[1] <= 5 * 3, "{poison:e}: {} tiles", counts[1]);
        }
    }
}
