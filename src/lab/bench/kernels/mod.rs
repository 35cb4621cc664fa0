//! Cases of every kernel: inputs, bindings, expected values and tolerances, for its tests and its benchmarks.
//!
//! Outputs of large inputs are compared by samples, evenly spaced.

pub mod adam;
pub mod adam_color;
pub mod compact;
pub mod composite;
pub mod contribution;
pub mod delinearize;
pub mod expand;
pub mod gather;
pub mod gradient;
mod image_pair;
pub mod linearize;
pub mod loss;
pub mod overlay;
pub mod perturb;
pub mod photo_sums;
pub mod plan;
pub mod present;
pub mod project;
pub mod project_backward;
pub mod prune_limit;
pub mod ranges;
pub mod rasterize_inria;
pub mod removal_error;
pub mod scan;
pub mod select_rows;
pub mod sort;
pub mod sum_by_splat;
pub mod surface;
pub mod surface_loss;

mod case;

pub use case::{KernelCase, Workgroups};

use super::input::pack::{Splat2d, arrays};
use super::input::random::Random;
use super::input::scene::{flattened, scattered};
use super::session::{Bench, Case};
use crate::Result;
use crate::gpu::{Buffer, Caps, DeviceKind, Gpu, Groups};
use crate::kernels::Kernel;
use crate::kernels::rasterize::Outputs;
use crate::layout::COUNT_SLOTS;
use crate::reference::dropout::Dropout;
use bytemuck::Pod;
pub use composite::{Composite, CompositeBuffers};
pub use gradient::Gradient;
pub use sort::Sorting;
use std::cell::LazyCell;
use std::fmt::Display;
use std::ops::Deref;

/// Measures all kernels that the filter wants.
///
/// # Errors
/// The first kernel that is wrong, before it is timed; anything that Vulkan reports.
pub fn run(bench: &mut Bench) -> Result<()> {
    bench.measure_copy_rate()?;
    for &count in sizes(bench.gpu().caps()) {
        by_splat(bench, count)?;
        by_list(bench, count)?;
    }
    time(bench, Workgroups::FIXED, "visible", plan::usual)?;
    sort::run(bench)?;
    loss::run(bench)?;
    photo_sums::run(bench)?;
    for (count, size, sigma) in [(50_000, [480, 272], 3.0), (20_000, [1920, 1080], 60.0)] {
        let name = format!("{count}/{}x{}", size[0], size[1]);
        let make = |gpu: &Gpu| expand::scattered(gpu, count, size, sigma);
        time(bench, FULL, name, make)?;
    }
    for size in [[480, 272], [1920, 1080]] {
        let name = format!("{}x{}", size[0], size[1]);
        time(bench, Workgroups::FIXED, &name, |gpu| present::present(gpu, size))?;
        time(bench, Workgroups::FIXED, &name, |gpu| overlay::overlay(gpu, size, None))?;
        time(bench, ELEMENTWISE, &name, |gpu| linearize::usual(gpu, size))?;
        time(bench, ELEMENTWISE, &name, |gpu| delinearize::usual(gpu, size))?;
        time(bench, ELEMENTWISE, &name, |gpu| {
            surface_loss::surface_loss(gpu, size, false)
        })?;
    }
    // About 40 splats are blended at a pixel.
    by_tile(bench, "small", 50_000, [480, 272], 3.0)?;
    by_tile(bench, "large", 50_000, [640, 480], 6.0)
}

/// Kernels of one invocation a splat.
fn by_splat(bench: &mut Bench, count: usize) -> Result<()> {
    let scene = |degree| scattered(count, [960, 540], 3.0, degree);
    time(bench, ELEMENTWISE, count, |gpu| {
        project::project(gpu, &scene(3), &[], Dropout::default())
    })?;
    time(bench, ELEMENTWISE, format_args!("{count} with planes"), |gpu| {
        project::planes(gpu, &scene(3), &[])
    })?;
    time(bench, FULL, count, |gpu| project_backward::scattered(gpu, &scene(3)))?;
    time(bench, ELEMENTWISE, count, |gpu| adam::usual(gpu, count))?;
    time(bench, ELEMENTWISE, count, |gpu| adam_color::usual(gpu, count))?;
    time(bench, ELEMENTWISE, count, |gpu| {
        perturb::perturb(gpu, &perturb::faint(scene(0)))
    })
}

/// Kernels of one invocation an element of a list.
fn by_list(bench: &mut Bench, count: usize) -> Result<()> {
    let below = |most: usize, count: usize| -> Vec<u32> {
        let random = &mut Random::new(count as u64);
        (0..count).map(|_| random.below(most) as u32).collect()
    };
    // Three splats of four are visible.
    time(bench, ELEMENTWISE, count, |gpu| compact::compact(gpu, &below(4, count)))?;
    time(bench, ELEMENTWISE, count, |gpu| gather::gather(gpu, count))?;
    time(bench, ELEMENTWISE, count, |gpu| {
        select_rows::select_rows(gpu, count, true)
    })?;
    // About a hundred intersections a tile.
    let tiles = || {
        let mut tiles = below(count / 100, count);
        tiles.sort_unstable();
        tiles
    };
    time(bench, ELEMENTWISE, count, |gpu| {
        ranges::ranges(gpu, &tiles(), count as u32 / 100, u32::MAX)
    })?;
    let values = || below(9, count);
    time(bench, ELEMENTWISE, count, |gpu| scan::reduce(gpu, &values(), false))?;
    time(bench, ELEMENTWISE, count, |gpu| {
        scan::chunks(gpu, &scan::chunk_sums(&values(), false))
    })?;
    time(bench, ELEMENTWISE, count, |gpu| scan::apply(gpu, &values(), false))?;
    time(bench, Workgroups::FIXED, count, |gpu| {
        scan::whole(gpu, &values(), false)
    })
}

/// Kernels that walk the lists of tiles.
fn by_tile(bench: &mut Bench, name: &str, count: usize, size: [u32; 2], sigma: f64) -> Result<()> {
    let engine = LazyCell::new(|| Composite::of(scattered(count, size, sigma, 0)));
    let squares = LazyCell::new(|| Composite::in_squares(scattered(count, size, sigma, 0)));
    let (lanes, fixed) = (LANES, Workgroups::FIXED);
    time(bench, lanes, name, |gpu| {
        composite::rasterize(gpu, &engine, Default::default())
    })?;
    let surface = Outputs {
        surface: true,
        ..Outputs::default()
    };
    time(bench, lanes, format_args!("{name} with surface"), |gpu| {
        composite::rasterize(gpu, &engine, surface)
    })?;
    time(bench, fixed, name, |gpu| composite::baseline_16x16(gpu, &squares))?;
    time(bench, fixed, name, |gpu| rasterize_inria::rasterize_inria(gpu, &engine))?;
    use gradient::{SAMPLED, SOURCE_TOLERANCE, SPLAT_TOLERANCE, SURFEL_TOLERANCE};
    time(bench, lanes, name, |gpu| {
        gradient::rasterize_backward(gpu, &engine, Gradient::new(&engine, SAMPLED), SOURCE_TOLERANCE)
    })?;
    time(bench, fixed, name, |gpu| {
        gradient::baseline_16x16_backward(gpu, &squares, Gradient::new(&squares, SAMPLED), SPLAT_TOLERANCE)
    })?;
    let surfels = LazyCell::new(|| Composite::of(flattened(scattered(count, size, sigma, 0))));
    let named = format!("{name} surfels");
    time(bench, lanes, &named, |gpu| {
        composite::rasterize(gpu, &surfels, surfels.kernel_outputs())
    })?;
    time(bench, lanes, &named, |gpu| {
        let gradient = Gradient::of_surfels(&surfels, SAMPLED);
        gradient::surfels_backward(
            gpu,
            &surfels,
            gradient,
            surfels.kernel_outputs().surfels,
            SURFEL_TOLERANCE,
        )
    })?;
    let kinds: [(&str, &dyn Deref<Target = Composite>); 2] = [(name, &engine), (&named, &surfels)];
    for (name, lists) in kinds {
        time(bench, lanes, name, |gpu| contribution::contribution(gpu, lists))?;
        time(bench, lanes, name, |gpu| prune_limit::prune_limit(gpu, lists, 0.05))?;
        time(bench, lanes, name, |gpu| removal_error::removal_error(gpu, lists))?;
    }
    time(bench, ELEMENTWISE, name, |gpu| {
        sum_by_splat::sum_by_splat(gpu, &sum_by_splat::Records::of(&engine), false)
    })
}

/// Checks and times a kernel in every choice that the filter wants. The case is made if there is one.
///
/// # Errors
/// A wrong result, before anything is timed in that choice; errors of Vulkan.
pub fn time<'a, K: Kernel>(
    bench: &mut Bench,
    workgroups: Workgroups,
    input: impl Display,
    make: impl FnOnce(&Gpu) -> Result<KernelCase<'a, K>>,
) -> Result<()> {
    let gpu = bench.gpu().clone();
    let mut choices = Vec::new();
    for (choice, workgroup) in workgroups.choices::<K>(gpu.caps()) {
        let variant = match K::info(&choice).variant {
            "" => "base",
            name => name,
        };
        let named = Case::of(K::NAME, &input, variant, workgroup);
        if bench.wants(&named) {
            choices.push((choice, named));
        }
    }
    if choices.is_empty() {
        return Ok(());
    }
    let case = make(&gpu)?;
    for (choice, named) in choices {
        if !case.takes(&choice) {
            continue;
        }
        let subject = case.subject(&gpu, named.doing(case.work), choice)?;
        bench.measure(&subject.case, subject.run)?;
    }
    Ok(())
}

/// Workgroups of kernels of one invocation an element.
const ELEMENTWISE: Workgroups = Workgroups::any(&[32, 64, 128, 256]);

/// The same, with full subgroups where there are any.
const FULL: Workgroups = Workgroups::subgroups(&[32, 64, 128, 256]);

/// Workgroups of kernels with a workgroup a tile.
const LANES: Workgroups = Workgroups::lanes(&[8, 16, 32, 64, 128]);

/// Splats, or other elements, of the inputs: in the caches and beyond them.
fn sizes(caps: &Caps) -> &'static [usize] {
    match caps.kind {
        DeviceKind::Cpu => &[1 << 14, 1 << 17],
        _ => &[1 << 14, 1 << 17, 1 << 20],
    }
}

/// Dispatch over chunks with a workgroup each, or with an invocation each.
fn chunk_groups(chunks: usize, by_workgroup: bool, workgroup: u32) -> Groups<'static> {
    let per_group = if by_workgroup { 1 } else { workgroup };
    Groups::Count((chunks as u32).div_ceil(per_group))
}

/// At most `most` of `count` indices, evenly spaced.
fn sample(count: usize, most: usize) -> impl Iterator<Item = usize> + Clone {
    (0..count).step_by((count / most.max(1)).max(1))
}

/// All of a buffer.
pub(super) fn read<T: Pod>(gpu: &Gpu, buffer: &Buffer<T>) -> Result<Vec<T>> {
    gpu.download(buffer, 0..buffer.len())
}

/// The slots of `counts`, with some of them set.
pub fn counts(gpu: &Gpu, slots: &[(u32, u32)]) -> Result<Buffer<u32>> {
    let mut counts = [0; COUNT_SLOTS as usize];
    for &(slot, value) in slots {
        counts[slot as usize] = value;
    }
    gpu.buffer_from("counts", &counts)
}

/// Splats on the screen, as kernels read them.
#[derive(Clone)]
pub struct ScreenBuffers {
    /// Mean in pixels, slope, log2 of the opacity.
    pub shape: Buffer<[f32; 4]>,
    /// Whitening factors, red, green.
    pub tone: Buffer<[f32; 4]>,
    /// Blue, depth.
    pub rest: Buffer<[f32; 2]>,
}

impl ScreenBuffers {
    /// Uploads them.
    pub fn new(gpu: &Gpu, records: &[Splat2d]) -> Result<ScreenBuffers> {
        let (shape, tone, rest) = arrays(records);
        Ok(ScreenBuffers {
            shape: gpu.buffer_from("ellipse_from_splat", &shape)?,
            tone: gpu.buffer_from("whiten_rg_from_splat", &tone)?,
            rest: gpu.buffer_from("blue_depth_from_splat", &rest)?,
        })
    }
}
