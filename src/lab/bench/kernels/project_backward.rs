//! From sums over pixels to gradients of parameters.

use super::{ELEMENTWISE, Records, counts, read, sample, sizes, wanted};
use crate::Result;
use crate::kernels::project_backward::{Bindings, Choice, Params, ProjectBackward, Spec};
use crate::lab::bench::check::{Output, rms};
use crate::lab::bench::input::lists::{view, viewpoint};
use crate::lab::bench::input::pack::{Splat2d, planes, screen_row, splat2d};
use crate::lab::bench::input::random::Random;
use crate::lab::bench::input::scene::{Scene, scattered};
use crate::lab::bench::{Bench, Unit, Work};
use crate::reference::project::margins;
use crate::reference::project_backward::project_backward;
use crate::reference::{ScreenSplat, Splat, Thresholds, project};
use crate::render::{plane_count, planes_from_splats};
use rayon::prelude::*;

/// Pixels of the picture.
const SIZE: [u32; 2] = [960, 540];
/// Degree of the harmonics.
const DEGREE: u32 = 3;
/// Splats that are judged.
const SAMPLES: usize = 500;

pub(super) fn run(bench: &mut Bench) -> Result<()> {
    let gpu = bench.gpu().clone();
    for &count in sizes(gpu.caps()) {
        if wanted!(bench, project_backward, count, ELEMENTWISE, Work::default()).is_empty() {
            continue;
        }
        let input = Input::new(count);
        // Parameters in, gradients out; record, statistics, and the records of the tiles.
        let bytes = 2 * 16 * plane_count(DEGREE) + size_of::<Splat2d>() + 32 + 8;
        let work = Work::of(count, Unit::Splats).moving(bytes * count + 36 * input.rest.len());
        let parameters = planes_from_splats(&input.scene.splats);
        let view = gpu.buffer_from("view", &[view(&input.scene)])?;
        let counts = counts(&gpu, &[])?;
        let d_params = gpu.buffer("d_params", parameters.len())?;
        let params = gpu.buffer_from("params", &parameters)?;
        let tiles = gpu.buffer_from("tiles", &input.tiles)?;
        let begins = gpu.buffer_from("begins", &input.begins)?;
        let records = Records::new(&gpu, &input.records)?;
        let shape = gpu.buffer_from("shape", &input.shape)?;
        let tone = gpu.buffer_from("tone", &input.tone)?;
        let rest = gpu.buffer_from("rest", &input.rest)?;
        let statistics = gpu.buffer("statistics", count)?;
        for (variant, workgroup, case) in wanted!(bench, project_backward, count, ELEMENTWISE, work)
        {
            let spec = Spec {
                workgroup,
                sh_degree: DEGREE,
                ..Spec::default()
            };
            let kernel = ProjectBackward::new(&gpu, Choice { variant, spec })?;
            let index = gpu.buffer("splat_from_slot", 1)?;
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
                d_params: &d_params,
                statistics: &statistics,
                splat_from_slot: &index,
            };
            let all = Params {
                splat_count: count as u32,
                stride: count as u32,
                // Without penalties.
                ..Params::default()
            };
            bench.trial(
                &case,
                |rec| {
                    rec.fill(&d_params, u32::MAX);
                    rec.fill(&statistics, 0);
                },
                |rec| kernel.record(rec, io, all, kernel.groups(count)),
                || Ok(input.outputs(&read(&gpu, &d_params)?)),
            )?;
        }
    }
    Ok(())
}

/// Visible splats with one to four records each.
struct Input {
    scene: Scene,
    screen: Vec<Option<ScreenSplat<f64>>>,
    records: Vec<Splat2d>,
    tiles: Vec<u32>,
    begins: Vec<u32>,
    shape: Vec<[f32; 4]>,
    tone: Vec<[f32; 4]>,
    rest: Vec<f32>,
}

impl Input {
    fn new(count: usize) -> Input {
        let scene = scattered(count, SIZE, 3.0, DEGREE);
        let at = viewpoint(&scene);
        let screen: Vec<_> = (0..count)
            .into_par_iter()
            .map(|i| {
                let splat = Splat::<f64>::of(&scene.splats, i);
                // At a discontinuity of the projection either side is right: left out.
                let margins = margins(&splat, &at);
                let sound = margins.limit.min(margins.color) > 1e-4;
                let drawn =
                    |s: &ScreenSplat<f64>| sound && s.opacity >= Thresholds::ENGINE.alpha_min;
                project(&splat, &at).filter(drawn)
            })
            .collect();
        let random = &mut Random::new(count as u64);
        let mut input = Input {
            records: screen
                .iter()
                .map(|s| s.as_ref().map(splat2d).unwrap_or_default())
                .collect(),
            scene,
            screen,
            tiles: Vec::new(),
            begins: Vec::new(),
            shape: Vec::new(),
            tone: Vec::new(),
            rest: Vec::new(),
        };
        for i in 0..count {
            let tiles = if input.screen[i].is_some() {
                1 + i as u32 % 4
            } else {
                0
            };
            input.begins.push(input.rest.len() as u32);
            input.tiles.push(tiles);
            for _ in 0..tiles {
                input.shape.push([0; 4].map(|_| random.normal() as f32));
                input.tone.push([0; 4].map(|_| random.normal() as f32));
                input.rest.push(random.normal() as f32);
            }
        }
        input
    }

    fn sums(&self, splat: usize) -> [f64; 9] {
        let begin = self.begins[splat] as usize;
        let mut sums = [0.0; 9];
        for source in begin..begin + self.tiles[splat] as usize {
            let [a, b, c, d] = self.shape[source];
            let [e, f, g, h] = self.tone[source];
            let terms = [a, b, c, d, e, f, g, h, self.rest[source]];
            sums.iter_mut()
                .zip(terms)
                .for_each(|(sum, x)| *sum += f64::from(x));
        }
        sums
    }

    /// A sample of the gradients, each splat's mean, opacity, quaternion, scales and harmonics in units of their
    /// own length; the tolerance is that of the kernel's test.
    fn outputs(&self, found: &[[f32; 4]]) -> Vec<Output> {
        let (count, at) = (self.tiles.len(), viewpoint(&self.scene));
        let groups: [(&str, std::ops::Range<usize>); 5] = [
            ("mean", 0..3),
            ("opacity", 3..4),
            ("quaternion", 4..8),
            ("log-scale", 8..12),
            ("harmonics", 12..4 * plane_count(DEGREE)),
        ];
        let mut columns = groups.clone().map(|_| (Vec::new(), Vec::new()));
        for i in sample(count, SAMPLES) {
            let row = match &self.screen[i] {
                Some(screen) => {
                    let splat = Splat::<f64>::of(&self.scene.splats, i);
                    project_backward(&splat, &at, &screen_row(screen, self.sums(i)))
                }
                None => vec![0.0; Splat::<f64>::of(&self.scene.splats, i).parameters().len()],
            };
            let expected = planes(&[row]).concat();
            let place = |k: usize| f64::from(found[k / 4 * count + i][k % 4]);
            for ((_, range), (f, e)) in groups.iter().zip(&mut columns) {
                let part = &expected[range.clone()];
                let norm = rms(part) * (part.len() as f64).sqrt();
                let unit = if norm > 0.0 { norm } else { 1.0 };
                f.extend(range.clone().map(|k| place(k) / unit));
                e.extend(part.iter().map(|x| x / unit));
            }
        }
        let output = |((name, _), (f, e))| Output::relative(name, f, e, 2e-4, 1.0);
        groups.into_iter().zip(columns).map(output).collect()
    }
}
