//! Case of `project`: from parameters to the ellipse, its colour and its number of tiles.

use super::{KernelCase, ScreenBuffers, read, sample, surface};
use crate::Result;
use crate::gpu::{Buffer, Gpu};
use crate::kernels::project::{Bindings, Choice, Params, Project};
use crate::lab::bench::Work;
use crate::lab::bench::check::{Output, UNWRITTEN, words};
use crate::lab::bench::input::lists::{tiles_near, view, viewpoint};
use crate::lab::bench::input::pack::{self, Splat2d};
use crate::lab::bench::input::scene::Scene;
use crate::layout::View;
use crate::reference::dropout::Dropout;
use crate::reference::project::margins;
use crate::reference::smoothing::smoothed;
use crate::reference::tiles::{Grid, alpha_at_pixels, alpha_max};
use crate::reference::{Splat, Thresholds, Viewpoint, project as reference};
use crate::render::{plane_count, planes_from_splats};
use crate::scene::Projection;

/// Splats that are compared.
const SAMPLES: usize = 1000;

/// Buffers that the kernel writes.
#[derive(Clone)]
pub struct ProjectOutputs {
    records: ScreenBuffers,
    planes: Buffer<[f32; 3]>,
    tiles: Buffer<u32>,
}

impl ProjectOutputs {
    /// Room for `count` splats, and for one tile count more.
    pub fn new(gpu: &Gpu, count: usize) -> Result<ProjectOutputs> {
        Ok(ProjectOutputs {
            records: ScreenBuffers::new(gpu, &vec![Splat2d::default(); count])?,
            planes: gpu.buffer("plane_from_splat", count.max(1))?,
            tiles: gpu.buffer("tile_count_from_splat", count + 1)?,
        })
    }

    /// Records and tile counts of all splats.
    ///
    /// # Errors
    /// Those of transfers.
    pub fn read(&self, gpu: &Gpu) -> Result<(Vec<Splat2d>, Vec<u32>)> {
        let (records, mut tiles) = (&self.records, read(gpu, &self.tiles)?);
        let (shape, tone) = (read(gpu, &records.shape)?, read(gpu, &records.tone)?);
        let rest = read(gpu, &records.rest)?;
        assert_eq!(tiles.pop(), Some(UNWRITTEN), "wrote past the end");
        let record = |i: usize| Splat2d {
            shape: shape[i],
            tone: tone[i],
            rest: rest[i],
        };
        Ok(((0..shape.len()).map(record).collect(), tiles))
    }
}

/// The splats of a scene, with their smoothing filters (none: no filters), after dropout.
pub fn project<'a>(gpu: &Gpu, scene: &Scene, filters: &[f32], dropout: Dropout) -> Result<KernelCase<'a, Project>> {
    let mut planes = planes_from_splats(&scene.splats);
    let mut filters = filters.to_vec();
    filters.resize(scene.splats.len(), 0.0);
    pack::set_filters(&mut planes, &filters);
    let outputs = ProjectOutputs::new(gpu, scene.splats.len())?;
    let scene = scene.clone();
    let view = View {
        dropout: dropout.share,
        dropout_key: dropout.key,
        ..view(&scene)
    };
    let case = commands(gpu, (&scene, view), &planes, None, &outputs)?;
    Ok(case.judge(move |gpu| {
        let (records, tiles) = outputs.read(gpu)?;
        let planes = words(&read(gpu, &outputs.planes)?);
        assert!(planes.iter().all(|x| x.is_nan()), "planes that are not wanted");
        let at = viewpoint(&scene);
        Ok(compare((&scene, at, dropout), &filters, &records, &tiles))
    }))
}

/// The splats of a scene in an orthographic projection; the camera's focal lengths are in pixels per world unit.
pub fn orthographic<'a>(gpu: &Gpu, scene: &Scene) -> Result<KernelCase<'a, Project>> {
    let planes = planes_from_splats(&scene.splats);
    let outputs = ProjectOutputs::new(gpu, scene.splats.len())?;
    let scene = scene.clone();
    let degree = scene.splats.sh_degree;
    let case = commands(gpu, (&scene, view(&scene)), &planes, None, &outputs)?;
    let case = case.tune(move |choice: &mut Choice| {
        choice.spec.sh_degree = degree;
        choice.spec.orthographic = 1;
    });
    Ok(case.judge(move |gpu| {
        let (records, tiles) = outputs.read(gpu)?;
        let filters = vec![0.0; records.len()];
        let at = Viewpoint {
            projection: Projection::Orthographic,
            ..viewpoint(&scene)
        };
        Ok(compare((&scene, at, Dropout::default()), &filters, &records, &tiles))
    }))
}

/// The planes of a scene's splats, with their smoothing filters (none: no filters).
pub fn planes<'a>(gpu: &Gpu, scene: &Scene, filters: &[f32]) -> Result<KernelCase<'a, Project>> {
    let mut planes = planes_from_splats(&scene.splats);
    let mut filters = filters.to_vec();
    filters.resize(scene.splats.len(), 0.0);
    pack::set_filters(&mut planes, &filters);
    let outputs = ProjectOutputs::new(gpu, scene.splats.len())?;
    let scene = scene.clone();
    let degree = scene.splats.sh_degree;
    let case = commands(gpu, (&scene, view(&scene)), &planes, None, &outputs)?;
    let case = case.tune(move |choice: &mut Choice| {
        choice.spec.sh_degree = degree;
        choice.spec.with_planes = 1;
    });
    Ok(case.judge(move |gpu| {
        let (_, tiles) = outputs.read(gpu)?;
        let drawn = sample(tiles.len(), SAMPLES).filter(|&i| tiles[i] > 0);
        let splat = |i: usize| smoothed(&Splat::<f64>::of(&scene.splats, i), filters[i].into());
        let splats: Vec<_> = drawn.clone().map(splat).collect();
        let found = read(gpu, &outputs.planes)?;
        let found: Vec<_> = drawn.map(|i| found[i].map(f64::from)).collect();
        Ok(surface::plane_outputs(&viewpoint(&scene), &splats, &found))
    }))
}

/// Commands for parameter planes, in the order of an index where there is one.
pub fn commands<'a>(
    gpu: &Gpu,
    (scene, view): (&Scene, View),
    planes: &[[f32; 4]],
    index: Option<&[u32]>,
    outputs: &ProjectOutputs,
) -> Result<KernelCase<'a, Project>> {
    let (count, degree) = (scene.splats.len(), scene.splats.sh_degree);
    let view = gpu.buffer_from("view", &[view])?;
    let params = gpu.buffer_from("params", planes)?;
    let splat_from_slot = gpu.buffer_from("splat_from_slot", index.unwrap_or(&[UNWRITTEN]))?;
    let limits = gpu.buffer::<f32>("limit_from_tile", 1)?;
    let (out, indexed) = (outputs.clone(), index.is_some());
    let bytes = 16 * plane_count(degree) + size_of::<Splat2d>() + 4;
    let case = KernelCase::new(Work::of(count, "splats").moving(count * bytes));
    let case = case.commands(move |rec, kernel: &Project, _| {
        let io = Bindings {
            view: &view,
            params: &params,
            ellipse_from_splat: &out.records.shape,
            whiten_rg_from_splat: &out.records.tone,
            blue_depth_from_splat: &out.records.rest,
            tile_count_from_splat: &out.tiles,
            splat_from_slot: &splat_from_slot,
            plane_from_splat: &out.planes,
            limit_from_tile: &limits,
        };
        let params = Params {
            splat_count: count as u32,
            stride: count as u32,
            ..Params::default()
        };
        kernel.record(rec, io, params, kernel.groups(count));
    });
    let case = case.tune(move |choice: &mut Choice| {
        choice.spec.sh_degree = degree;
        choice.spec.indexed = indexed.into();
    });
    let records = &outputs.records;
    let case = case.erase(&records.shape).erase(&records.tone);
    Ok(case.erase(&records.rest).erase(&outputs.tiles).erase(&outputs.planes))
}

/// Records and tile counts beside the reference's, splat by splat.
fn compare(
    (scene, at, dropout): (&Scene, Viewpoint, Dropout),
    filters: &[f32],
    records: &[Splat2d],
    tiles: &[u32],
) -> Vec<Output> {
    let grid = Grid::new(scene.camera.width, scene.camera.height);
    let cut = Thresholds::ENGINE.alpha_min;
    let [mut found, mut expected] = [(); 2].map(|()| [(); 5].map(|()| Vec::<f64>::new()));
    let (mut counted, mut allowed) = (Vec::new(), Vec::new());
    for i in sample(tiles.len(), SAMPLES) {
        let splat = smoothed(&Splat::<f64>::of(&scene.splats, i), filters[i].into());
        let count = f64::from(tiles[i]);
        counted.push(count);
        let screen = reference(&splat, &at).and_then(|screen| dropout.applied(i as u32, screen));
        let screen = screen.filter(|s| s.opacity >= cut * (1.0 - 1e-5));
        let Some(screen) = screen else {
            allowed.push(0.0);
            continue;
        };
        // A pixel centre well inside needs its tile, an ellipse well outside does not; between, as it comes. The
        // margins are those of `expand`, whose lists are as long.
        let near = |alpha: &dyn Fn(u32) -> f64, cut: f64| {
            tiles_near(&screen, &grid).filter(|&tile| alpha(tile) >= cut).count() as f64
        };
        let low = near(&|tile| alpha_at_pixels(&screen, &grid, tile), cut * 1.01);
        let high = near(&|tile| alpha_max(&screen, &grid, tile), cut * 0.99);
        allowed.push(count.clamp(low, high.max(low)));
        let is_clamped = at.projection == Projection::Perspective && margins(&splat, &at).limit < 1e-5;
        if tiles[i] == 0 || is_clamped {
            continue;
        }
        let [s, t, [blue, depth, ..]] = pack::splat2d_values(&screen);
        let Splat2d { shape, tone, rest } = records[i];
        let (shape, tone, rest) = (shape.map(f64::from), tone.map(f64::from), rest.map(f64::from));
        let columns: [(&[f64], &[f64]); 5] = [
            (&shape[..2], &s[..2]),
            (&shape[2..3], &s[2..3]),
            (&shape[3..], &s[3..]),
            (&tone[..2], &t[..2]),
            (&[tone[2], tone[3], rest[0], rest[1]], &[t[2], t[3], blue, depth]),
        ];
        for (slot, (f, e)) in columns.into_iter().enumerate() {
            found[slot].extend(f);
            expected[slot].extend(e);
        }
    }
    // A position in the view is a sum of three products of numbers up to 4: 5u · 4 of a depth of 2 and more, times a
    // focal length of up to 1.2 sizes: 1e-6 of the image. Whitening passes through about 30 roundings and is built of
    // sums of squares: 1e-5. A slope is not: a needle that points at the camera is foreshortened by a difference that
    // leaves the 30u of its full length, 50 px and more, of which a slope of 1 divides by as little as 0.55 px: 2e-4.
    // Logarithms carry the specification's 3 ULP at 8, and in mip mode half the error of a determinant. Colours are
    // sums of 16 products.
    let size = f64::from(scene.camera.width.max(scene.camera.height));
    let bounds = [
        ("mean", 2e-6, size),
        ("slope", 2e-4, 1.0),
        ("opacity", 1e-5, 1.0),
        ("whitening", 1e-5, 0.0),
        ("colour and depth", 2e-6, 1.0),
    ];
    let columns = found.into_iter().zip(expected).zip(bounds);
    let mut outputs: Vec<Output> = columns
        .map(|((f, e), (name, tolerance, scale))| Output::relative(name, f, e, tolerance, scale))
        .collect();
    outputs.push(Output::exact("tile count", counted, allowed));
    outputs
}
