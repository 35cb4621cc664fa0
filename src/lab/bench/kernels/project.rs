//! From parameters to ellipses.

use super::{ELEMENTWISE, read, sample, sizes, wanted};
use crate::Result;
use crate::kernels::project::{Bindings, Choice, Params, Project, Spec};
use crate::lab::bench::check::Output;
use crate::lab::bench::input::lists::{tiles_near, view, viewpoint};
use crate::lab::bench::input::pack::{self, Splat2d};
use crate::lab::bench::input::scene::{Scene, scattered};
use crate::lab::bench::{Bench, Unit, Work};
use crate::reference::tiles::{Grid, alpha_at_pixels, alpha_max};
use crate::reference::{Splat, Thresholds, project};
use crate::render::{plane_count, planes_from_splats};

/// Pixels of the picture.
const SIZE: [u32; 2] = [960, 540];
/// Degree of the harmonics.
const DEGREE: u32 = 3;
/// Splats that are judged.
const SAMPLES: usize = 1000;

pub(super) fn run(bench: &mut Bench) -> Result<()> {
    let gpu = bench.gpu().clone();
    for &count in sizes(gpu.caps()) {
        let bytes = 16 * plane_count(DEGREE) + size_of::<Splat2d>() + 4;
        let work = Work::of(count, Unit::Splats).moving(count * bytes);
        let choices = wanted!(bench, project, count, ELEMENTWISE, work);
        if choices.is_empty() {
            continue;
        }
        let scene = scattered(count, SIZE, 3.0, DEGREE);
        let view = gpu.buffer_from("view", &[view(&scene)])?;
        let params = gpu.buffer_from("params", &planes_from_splats(&scene.splats))?;
        let shape = gpu.buffer("ellipse_from_splat", count)?;
        let tone = gpu.buffer("whiten_rg_from_splat", count)?;
        let rest = gpu.buffer("blue_depth_from_splat", count)?;
        let tiles = gpu.buffer("tile_count_from_splat", count)?;
        let index = gpu.buffer("splat_from_slot", 1)?;
        let all = Params {
            splat_count: count as u32,
            stride: count as u32,
        };
        for (variant, workgroup, case) in choices {
            let spec = Spec {
                workgroup,
                sh_degree: DEGREE,
                ..Spec::default()
            };
            let kernel = Project::new(&gpu, Choice { variant, spec })?;
            let io = Bindings {
                view: &view,
                params: &params,
                ellipse_from_splat: &shape,
                whiten_rg_from_splat: &tone,
                blue_depth_from_splat: &rest,
                tile_count_from_splat: &tiles,
                splat_from_slot: &index,
            };
            bench.trial(
                &case,
                |rec| rec.fill(&shape, u32::MAX),
                |rec| kernel.record(rec, io, all, kernel.groups(count)),
                || {
                    let (shape, tone) = (read(&gpu, &shape)?, read(&gpu, &tone)?);
                    let rest = read(&gpu, &rest)?;
                    let record = |i: usize| Splat2d {
                        shape: shape[i],
                        tone: tone[i],
                        rest: rest[i],
                    };
                    let records: Vec<Splat2d> = (0..count).map(record).collect();
                    Ok(outputs(&scene, &records, &read(&gpu, &tiles)?))
                },
            )?;
        }
    }
    Ok(())
}

/// The tolerances are those of the kernel's test, which derives them.
fn outputs(scene: &Scene, records: &[Splat2d], tile_counts: &[u32]) -> Vec<Output> {
    let at = viewpoint(scene);
    let grid = Grid::new(scene.camera.width, scene.camera.height);
    let cut = Thresholds::ENGINE.alpha_min;
    let [mut found, mut expected] = [(); 2].map(|()| [(); 5].map(|()| Vec::<f64>::new()));
    let (mut counted, mut allowed) = (Vec::new(), Vec::new());
    for i in sample(tile_counts.len(), SAMPLES) {
        let screen = project(&Splat::<f64>::of(&scene.splats, i), &at);
        let Some(screen) = screen.filter(|s| s.opacity >= cut) else {
            continue;
        };
        let tiles = |alpha: &dyn Fn(u32) -> f64, cut: f64| {
            tiles_near(&screen, &grid)
                .filter(|&tile| alpha(tile) >= cut)
                .count() as f64
        };
        // A pixel centre well inside needs its tile, an ellipse well outside does not.
        let low = tiles(&|tile| alpha_at_pixels(&screen, &grid, tile), cut * 1.01);
        let high = tiles(&|tile| alpha_max(&screen, &grid, tile), cut * 0.99);
        let count = f64::from(tile_counts[i]);
        counted.push(count);
        allowed.push(count.clamp(low, high));
        if tile_counts[i] == 0 {
            continue;
        }
        let [shape, tone, rest] = pack::splat2d_values(&screen);
        let record = &records[i];
        let [s, t] = [record.shape, record.tone].map(|v| v.map(f64::from));
        let r = record.rest.map(f64::from);
        let pairs = [
            (&s[..2], &shape[..2]),
            (&s[2..3], &shape[2..3]),
            (&s[3..], &shape[3..]),
            (&t[..2], &tone[..2]),
            (
                &[t[2], t[3], r[0], r[1]],
                &[tone[2], tone[3], rest[0], rest[1]],
            ),
        ];
        for (slot, (f, e)) in pairs.into_iter().enumerate() {
            found[slot].extend(f);
            expected[slot].extend(e);
        }
    }
    let size = f64::from(scene.camera.width.max(scene.camera.height));
    let bounds = [
        ("mean", 2e-6, size),
        ("slope", 2e-4, 1.0),
        ("opacity", 1e-5, 1.0),
        ("whitening", 1e-5, 0.0),
        ("colour and depth", 2e-6, 20.0),
    ];
    let columns = found.into_iter().zip(expected).zip(bounds);
    let mut outputs: Vec<Output> = columns
        .map(|((f, e), (name, tolerance, scale))| Output::relative(name, f, e, tolerance, scale))
        .collect();
    outputs.push(Output::exact("tile count", counted, allowed));
    outputs
}
