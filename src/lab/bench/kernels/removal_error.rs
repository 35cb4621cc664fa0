//! What splats do to the pixels of their tiles.

use super::composite::{Composite, INPUTS, Input, LANES};
use super::{nothing, read, wanted};
use crate::Result;
use crate::gpu::{Buffer, Gpu};
use crate::kernels::removal_error;
use crate::lab::bench::check::Output;
use crate::lab::bench::{Bench, Work};
use crate::reference::Thresholds;
use crate::reference::removal_error::{RemovalError, touches};
use crate::render::tile_stride;
use rayon::prelude::*;

pub(super) fn run(bench: &mut Bench) -> Result<()> {
    for (name, count, size, sigma) in INPUTS {
        if wanted!(bench, removal_error, name, LANES, Work::default()).is_empty() {
            continue;
        }
        let composite = Composite::new(count, size, sigma);
        let gpu = bench.gpu().clone();
        let input = Input::new(&gpu, &composite)?;
        let case = Case::new(&gpu, &composite)?;
        for (variant, workgroup, trial) in
            wanted!(bench, removal_error, name, LANES, composite.work())
        {
            if !gpu.caps().lanes_fit(variant.info(), workgroup) {
                continue;
            }
            let spec = removal_error::Spec {
                workgroup,
                ..removal_error::Spec::default()
            };
            let kernel =
                removal_error::RemovalError::new(&gpu, removal_error::Choice { variant, spec })?;
            let io = case.bindings(&input);
            let params = removal_error::Params {
                tile_stride: tile_stride(input.tiles),
            };
            let record = |rec: &mut crate::gpu::Recorder<'_>| {
                kernel.record(rec, io, params, input.groups());
            };
            bench.trial(&trial, nothing, record, || case.outputs(&gpu))?;
        }
    }
    Ok(())
}

/// What splats are judged by, and what should come of it.
struct Case {
    image: Buffer<f32>,
    errors: Buffer<f32>,
    records: Buffer<[f32; 3]>,
    /// By source.
    expected: Vec<RemovalError>,
    /// By source: whether its tile has a pixel near a threshold.
    near: Vec<bool>,
}

/// A pixel's error, anything from 0 to 1.
fn error(pixel: usize) -> f32 {
    (pixel % 11) as f32 / 11.0
}

impl Case {
    fn new(gpu: &Gpu, composite: &Composite) -> Result<Case> {
        let pixels = composite.pixels.len();
        let lists = &composite.lists;
        let touched: Vec<_> = (0..pixels)
            .into_par_iter()
            .map(|pixel| {
                let (tile, at) = composite.place(pixel);
                let ranks = &composite.ranks_from_tile[tile];
                let background = composite.background();
                touches(
                    &composite.splats,
                    ranks,
                    at,
                    background,
                    &Thresholds::ENGINE,
                )
            })
            .collect();
        let mut expected = vec![RemovalError::default(); lists.isects.len()];
        let mut near_tile = vec![false; lists.range_from_tile.len()];
        for (pixel, touched) in touched.iter().enumerate() {
            let (tile, _) = composite.place(pixel);
            near_tile[tile] |= composite.pixels[pixel].near;
            let ranks = &composite.ranks_from_tile[tile];
            let begin = lists.range_from_tile[tile][0] as usize;
            for touch in touched {
                let isect = begin + ranks.partition_point(|&r| r < touch.splat);
                let sum = &mut expected[lists.emitted_from_isect[isect] as usize];
                *sum = sum.and(touch, f64::from(error(pixel)));
            }
        }
        let planes: Vec<f32> = composite.planes().iter().map(|&c| c as f32).collect();
        let errors: Vec<f32> = (0..pixels).map(error).collect();
        let isects = lists.isects.iter();
        Ok(Case {
            image: gpu.buffer_from("image", &planes)?,
            errors: gpu.buffer_from("errors", &errors)?,
            records: gpu.buffer("records", lists.isects.len())?,
            near: isects.map(|isect| near_tile[isect.tile as usize]).collect(),
            expected,
        })
    }

    fn bindings<'a>(&'a self, input: &'a Input) -> removal_error::Bindings<'a> {
        removal_error::Bindings {
            view: &input.view,
            range_from_tile: &input.range_from_tile,
            emitted_from_isect: &input.emitted_from_isect,
            splat_from_emitted: &input.splat_from_emitted,
            ellipse_from_splat: &input.records.shape,
            whiten_rg_from_splat: &input.records.tone,
            blue_depth_from_splat: &input.records.rest,
            image: &self.image,
            error_from_pixel: &self.errors,
            influence_from_source: &self.records,
        }
    }

    /// Tolerances and shares are those of the kernel's test.
    fn outputs(&self, gpu: &Gpu) -> Result<Vec<Output>> {
        let found = read(gpu, &self.records)?;
        let column = |i: usize| found.iter().map(|r| f64::from(r[i])).collect::<Vec<_>>();
        let wanted =
            |of: fn(&RemovalError) -> f64| self.expected.iter().map(of).collect::<Vec<_>>();
        let units = |changes: Vec<f64>| -> Vec<f64> {
            let pairs = changes.into_iter().zip(&self.expected);
            pairs
                .map(|(c, wanted)| c / wanted.slack.max(1e-30))
                .collect()
        };
        let (near, jump) = (|| self.near.clone(), 128.0 * 2.0 / 255.0);
        let sums = |name, i, of| Output::relative(name, column(i), wanted(of), 2e-5, 128.0);
        let (changes, expected) = (units(column(2)), units(wanted(|i| i.change)));
        let change = Output::relative("change", changes, expected, 2e-5, 1.0);
        Ok(vec![
            sums("weight", 0, |i| i.weight).near(near(), jump, 0.02),
            sums("error", 1, |i| i.error).near(near(), jump, 0.02),
            change.near(near(), f64::INFINITY, 0.02),
        ])
    }
}
