//! Case of `project_backward`: from sums over pixels to the gradient of every parameter.

use super::{KernelCase, ScreenBuffers, counts, read, sample};
use crate::Result;
use crate::gpu::{Buffer, Gpu};
use crate::kernels::project_backward::{Bindings, Choice, Params, ProjectBackward};
use crate::lab::bench::Work;
use crate::lab::bench::check::{Output, UNWRITTEN, floats};
use crate::lab::bench::input::lists::{view, viewpoint};
use crate::lab::bench::input::pack::{self, Splat2d};
use crate::lab::bench::input::random::Random;
use crate::lab::bench::input::scene::Scene;
use crate::layout::{GEOMETRY_PLANES, GRADIENT_PLANES, PART_ALL};
use crate::reference::primitive::extent;
use crate::reference::project::margins;
use crate::reference::project_backward::{PenaltyWeights, penalty_backward};
use crate::reference::smoothing::{smoothed, smoothed_backward};
use crate::reference::{ScreenSplat, Splat, Thresholds, project, sh};
use crate::render::{plane_count, planes_from_splats};
use rayon::prelude::*;

/// Splats that are compared.
const SAMPLES: usize = 500;
/// Weights of the penalties on opacity, scale and size.
const PENALTIES: [f32; 3] = [0.125, 0.5, 0.75];
/// Statistics of every splat before the step.
const STATISTICS: [f32; 4] = [0.5, 3.0, 2.0, 7.0];

/// Splats with records of one to four tiles each, and a few with many, of one sign: their sums do not cancel.
pub struct SplatSums {
    /// The scene.
    pub scene: Scene,
    /// Its splats' 3D filters.
    pub filters: Vec<f32>,
    /// The splats on the screen; none where a splat is not drawn, or so near a discontinuity of the projection that
    /// either side is right.
    screen: Vec<Option<ScreenSplat<f64>>>,
    /// Tiles of each splat.
    pub tiles: Vec<u32>,
    /// First record of each splat.
    pub begins: Vec<u32>,
    /// Records of tiles: the nine sums of `rasterize_backward`.
    pub records: Vec<[f32; 9]>,
}

impl SplatSums {
    /// Random sums; without `filters` there are none.
    pub fn new(scene: &Scene, filters: &[f32]) -> SplatSums {
        let (at, count) = (viewpoint(scene), scene.splats.len());
        let mut filters = filters.to_vec();
        filters.resize(count, 0.0);
        let drawn = |i: usize| {
            let splat = Splat::<f64>::of(&scene.splats, i);
            let margins = margins(&splat, &at);
            let sound = margins.limit.min(margins.color) > 1e-4;
            let screen = project(&smoothed(&splat, filters[i].into()), &at);
            screen.filter(|s| sound && s.opacity >= Thresholds::ENGINE.alpha_min)
        };
        let random = &mut Random::new(count as u64);
        let mut sums = SplatSums {
            scene: scene.clone(),
            screen: (0..count).into_par_iter().map(drawn).collect(),
            filters,
            tiles: Vec::new(),
            begins: Vec::new(),
            records: Vec::new(),
        };
        for i in 0..count {
            let most = if i % 64 == 5 { 100 } else { 4 };
            let tiles = sums.screen[i].map_or(0, |_| 1 + i as u32 % most);
            sums.begins.push(sums.records.len() as u32);
            sums.tiles.push(tiles);
            for _ in 0..tiles {
                let record = [0; 9].map(|_| random.normal() as f32);
                sums.records.push(if tiles > 4 { record.map(f32::abs) } else { record });
            }
        }
        sums
    }

    /// Four sums of each record.
    fn four(&self, first: usize) -> Vec<[f32; 4]> {
        let part = |record: &[f32; 9]| [0, 1, 2, 3].map(|lane| record[first + lane]);
        self.records.iter().map(part).collect()
    }

    fn total(&self, splat: usize) -> [f64; 9] {
        let begin = self.begins[splat] as usize;
        let mut sums = [0.0; 9];
        for record in &self.records[begin..][..self.tiles[splat] as usize] {
            let pairs = sums.iter_mut().zip(record);
            pairs.for_each(|(sum, &x)| *sum += f64::from(x));
        }
        sums
    }

    /// Gradient of a splat's parameters, and its statistics after the step.
    pub(super) fn expected(&self, i: usize) -> (Vec<f64>, [f64; 4]) {
        let splat = Splat::<f64>::of(&self.scene.splats, i);
        let [opacity, scale, size] = PENALTIES.map(f64::from);
        let mut row = penalty_backward(&splat, PenaltyWeights { opacity, scale, size });
        let mut statistics = STATISTICS.map(f64::from);
        let Some(screen) = &self.screen[i] else {
            return (row, statistics);
        };
        let by_screen = pack::screen_row(screen, self.total(i));
        let at = viewpoint(&self.scene);
        let gradient = smoothed_backward(&splat, self.filters[i].into(), &at, &by_screen);
        row.iter_mut().zip(&gradient).for_each(|(sum, g)| *sum += g);
        let camera = &self.scene.camera;
        let half = [camera.width, camera.height].map(|n| 0.5 * f64::from(n));
        statistics[0] += (by_screen[0] * half[0]).hypot(by_screen[1] * half[1]);
        statistics[1] += 1.0;
        let [x, y] = extent(screen, &Thresholds::ENGINE);
        // The kernels widen the ellipse, so that rounding drops no pixel on its rim.
        let level = 2.0 * (screen.opacity / Thresholds::ENGINE.alpha_min).ln();
        let wider = ((level * 1.00001 + 1e-5) / level).sqrt();
        statistics[2] = statistics[2].max(x * wider).max(y * wider);
        (row, statistics)
    }
}

/// Buffers that the kernel writes.
#[derive(Clone)]
pub struct GradientOutputs {
    sh_degree: u32,
    d_params: Buffer<[f32; 4]>,
    statistics: Buffer<[f32; 4]>,
}

impl GradientOutputs {
    /// Room for the splats of a scene, and for one vector more.
    pub fn new(gpu: &Gpu, scene: &Scene) -> Result<GradientOutputs> {
        let count = scene.splats.len();
        Ok(GradientOutputs {
            sh_degree: scene.splats.sh_degree,
            d_params: gpu.buffer("d_params", GRADIENT_PLANES as usize * count + 1)?,
            statistics: gpu.buffer("statistics", count)?,
        })
    }

    /// Gradients of all parameters in planes, those of harmonics multiplied out, and statistics by splat.
    ///
    /// # Errors
    /// Those of transfers.
    pub fn read(&self, gpu: &Gpu) -> Result<[Vec<[f32; 4]>; 2]> {
        let mut gradients = read(gpu, &self.d_params)?;
        let beyond = gradients.pop().unwrap_or_default();
        let is_untouched = beyond.iter().all(|x| x.to_bits() == UNWRITTEN);
        assert!(is_untouched, "wrote past the end");
        Ok([self.multiplied(gradients), read(gpu, &self.statistics)?])
    }

    fn multiplied(&self, mut planes: Vec<[f32; 4]>) -> Vec<[f32; 4]> {
        let count = planes.len() / GRADIENT_PLANES as usize;
        let factors = planes.split_off(GEOMETRY_PLANES as usize * count);
        planes.resize(plane_count(self.sh_degree) * count, [0.0; 4]);
        for (splat, (d_color, direction)) in factors[..count].iter().zip(&factors[count..]).enumerate() {
            let [x, y, z, _] = direction.map(f64::from);
            for (k, basis) in sh::basis(self.sh_degree, [x, y, z]).into_iter().enumerate() {
                for (number, d) in (3 * k..).zip(&d_color[..3]) {
                    let place = (GEOMETRY_PLANES as usize + number / 4) * count + splat;
                    planes[place][number % 4] = (basis * f64::from(*d)) as f32;
                }
            }
        }
        planes
    }
}

/// Scattered splats without filters.
pub fn scattered<'a>(gpu: &Gpu, scene: &Scene) -> Result<KernelCase<'a, ProjectBackward>> {
    project_backward(gpu, SplatSums::new(scene, &[]))
}

/// Gradients and statistics of these sums.
pub fn project_backward<'a>(gpu: &Gpu, sums: SplatSums) -> Result<KernelCase<'a, ProjectBackward>> {
    let outputs = GradientOutputs::new(gpu, &sums.scene)?;
    let case = commands(gpu, &sums, None, &[], &outputs)?;
    Ok(case.judge(move |gpu| {
        let [gradients, statistics] = outputs.read(gpu)?;
        Ok(compare(&sums, &gradients, &statistics))
    }))
}

/// Commands for parameters in the order of an index where there is one, with some `counts` set.
pub fn commands<'a>(
    gpu: &Gpu,
    sums: &SplatSums,
    index: Option<&[u32]>,
    slots: &[(u32, u32)],
    outputs: &GradientOutputs,
) -> Result<KernelCase<'a, ProjectBackward>> {
    let (count, degree) = (sums.scene.splats.len(), sums.scene.splats.sh_degree);
    let mut planes = planes_from_splats(&sums.scene.splats);
    pack::set_filters(&mut planes, &sums.filters);
    if let Some(index) = index {
        planes = pack::in_order(&planes, index);
    }
    let records: Vec<Splat2d> = sums
        .screen
        .iter()
        .map(|s| s.as_ref().map(pack::splat2d).unwrap_or_default())
        .collect();
    let view = gpu.buffer_from("view", &[view(&sums.scene)])?;
    let counts = counts(gpu, slots)?;
    let params = gpu.buffer_from("params", &planes)?;
    let tiles = gpu.buffer_from("tile_count_from_splat", &sums.tiles)?;
    let begins = gpu.buffer_from("emitted_from_splat", &sums.begins)?;
    let records = ScreenBuffers::new(gpu, &records)?;
    let last: Vec<f32> = sums.records.iter().map(|record| record[8]).collect();
    let shape = gpu.buffer_from("d_shape_from_source", &sums.four(0))?;
    let tone = gpu.buffer_from("d_tone_from_source", &sums.four(4))?;
    let rest = gpu.buffer_from("d_rest_from_source", &last)?;
    let splat_from_slot = gpu.buffer_from("splat_from_slot", index.unwrap_or(&[u32::MAX]))?;
    let before = gpu.buffer_from("statistics", &vec![STATISTICS; count])?;
    let (out, indexed) = (outputs.clone(), index.is_some());
    // Parameters in, gradients out; record, statistics, and the records of the tiles.
    let planes = plane_count(degree) + GRADIENT_PLANES as usize;
    let bytes = 16 * planes + size_of::<Splat2d>() + 32 + 8;
    let case = KernelCase::new(Work::of(count, "splats").moving(bytes * count + 36 * sums.records.len()));
    let case = case.commands(move |rec, kernel: &ProjectBackward, _| {
        let io = Bindings {
            view: &view,
            counts: &counts,
            params: &params,
            tile_count_from_splat: &tiles,
            emitted_from_splat: &begins,
            ellipse_from_splat: &records.shape,
            whiten_rg_from_splat: &records.tone,
            blue_depth_from_splat: &records.rest,
            d_shape_from_source: &shape,
            d_tone_from_source: &tone,
            d_rest_from_source: &rest,
            d_params: &out.d_params,
            statistics: &out.statistics,
            splat_from_slot: &splat_from_slot,
        };
        let [opacity_penalty, scale_penalty, size_penalty] = PENALTIES;
        let params = Params {
            splat_count: count as u32,
            stride: count as u32,
            opacity_penalty,
            scale_penalty,
            size_penalty,
            banded: 0,
            part: PART_ALL,
        };
        kernel.record(rec, io, params, kernel.groups(count));
    });
    let case = case.tune(move |choice: &mut Choice| {
        choice.spec.sh_degree = degree;
        choice.spec.indexed = indexed.into();
    });
    Ok(case.erase(&outputs.d_params).copy(&before, &outputs.statistics))
}

/// Gradients and statistics beside the reference's: each splat's mean, opacity, quaternion, scales and harmonics in
/// units of their own length, since splats differ by many magnitudes.
fn compare(sums: &SplatSums, gradients: &[[f32; 4]], statistics: &[[f32; 4]]) -> Vec<Output> {
    let count = sums.tiles.len();
    let planes = plane_count(sums.scene.splats.sh_degree);
    let groups: [(&str, std::ops::Range<usize>); 5] = [
        ("mean", 0..3),
        ("opacity", 3..4),
        ("quaternion", 4..8),
        ("log-scale", 8..12),
        ("harmonics", 12..4 * planes),
    ];
    let mut columns = groups.clone().map(|_| (Vec::new(), Vec::new()));
    let (mut found, mut wanted) = (Vec::new(), Vec::new());
    for i in sample(count, SAMPLES) {
        let (row, after) = sums.expected(i);
        let expected = pack::planes(&[row]).concat();
        let place = |k: usize| f64::from(gradients[k / 4 * count + i][k % 4]);
        for ((_, range), (f, e)) in groups.iter().zip(&mut columns) {
            let part = &expected[range.clone()];
            let norm = part.iter().map(|x| x * x).sum::<f64>().sqrt();
            let unit = if norm > 0.0 { norm } else { 1.0 };
            f.extend(range.clone().map(|k| place(k) / unit));
            e.extend(part.iter().map(|x| x / unit));
        }
        found.extend(floats(&statistics[i..=i]));
        wanted.extend(after);
    }
    // Everything up to here is a product of about forty factors, ten of them quotients and roots, which Vulkan rounds
    // to 2.5 ULP: 30u + 50u = 4.8e-6; the length of a quaternion's gradient is what is left of terms larger by the
    // aspect, a hundred for needles.
    let output = |((name, _), (f, e))| Output::relative(name, f, e, 4.8e-4, 1.0);
    let mut outputs: Vec<Output> = groups.into_iter().zip(columns).map(output).collect();
    // A norm of two sums of products of about sixteen factors, left of terms larger by the aspect as well: 1600u.
    outputs.push(Output::relative("statistics", found, wanted, 9.6e-5, 1.0));
    outputs
}
