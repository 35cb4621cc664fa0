//! Every kernel, in every variant and workgroup that the device can run, on inputs of several sizes: checked
//! against the reference, then timed.
//!
//! A kernel that writes more than the reference can prune_limit to judge is judged by samples, evenly spaced.

mod backward;
mod composite;
mod contribution;
mod expand;
mod loss;
mod present;
mod project;
mod project_backward;
mod rasterize_inria;
mod removal_error;
mod sort;
mod stream;
mod sums;
mod update;

pub use backward::{Device, Gradient, params as backward_params};
pub use composite::{Composite, Input};
pub use sort::Sorting;

use super::input::pack::{Splat2d, arrays};
use super::session::Bench;
use crate::Result;
use crate::gpu::{Buffer, Caps, DeviceKind, Gpu};
use crate::layout::{COUNT_SLOTS, DispatchArgs};
use bytemuck::Pod;

/// Measures all kernels that are asked for.
///
/// # Errors
/// The first kernel that is wrong, before it is timed; anything that Vulkan reports.
pub fn run(bench: &mut Bench) -> Result<()> {
    bench.copy_rate()?;
    project::run(bench)?;
    stream::run(bench)?;
    sums::run(bench)?;
    sort::run(bench)?;
    expand::run(bench)?;
    composite::run(bench)?;
    rasterize_inria::run(bench)?;
    present::run(bench)?;
    backward::run(bench)?;
    loss::run(bench)?;
    project_backward::run(bench)?;
    update::run(bench)?;
    contribution::run(bench)?;
    removal_error::run(bench)
}

/// The choices of a kernel that the device can run and the filter wants, each as (variant, workgroup, case).
macro_rules! wanted {
    ($bench:expr, $kernel:ident, $input:expr, $workgroups:expr, $work:expr) => {{
        use crate::kernels::$kernel::Variant;
        let (input, work) = (&$input, $work);
        let caps = $bench.gpu().caps();
        let mut choices = Vec::new();
        for &variant in Variant::ALL {
            if caps.supports(variant.info()).is_err() {
                continue;
            }
            for workgroup in $workgroups {
                let kernel = stringify!($kernel);
                let case = crate::lab::bench::Case::of(kernel, input, variant.name(), workgroup);
                if workgroup <= caps.max_workgroup && $bench.wants(&case) {
                    choices.push((variant, workgroup, case.doing(work)));
                }
            }
        }
        choices
    }};
}
pub(super) use wanted;

/// Workgroups that kernels of one invocation per element are tried with.
const ELEMENTWISE: [u32; 4] = [32, 64, 128, 256];

/// Splats, or other elements, of the inputs: in the caches and beyond them.
fn sizes(caps: &Caps) -> &'static [usize] {
    match caps.kind {
        DeviceKind::Cpu => &[1 << 14, 1 << 17],
        _ => &[1 << 14, 1 << 17, 1 << 20],
    }
}

/// At most `most` of `count` indices, evenly spaced.
fn sample(count: usize, most: usize) -> impl Iterator<Item = usize> + Clone {
    (0..count).step_by((count / most).max(1))
}

/// All of a buffer.
pub(super) fn read<T: Pod>(gpu: &Gpu, buffer: &Buffer<T>) -> Result<Vec<T>> {
    gpu.download(buffer, 0..buffer.len())
}

/// The slots of `counts`, with some of them set.
fn counts(gpu: &Gpu, slots: &[(u32, u32)]) -> Result<Buffer<u32>> {
    let mut counts = [0; COUNT_SLOTS as usize];
    for &(slot, value) in slots {
        counts[slot as usize] = value;
    }
    gpu.buffer_from("counts", &counts)
}

/// Workgroups for `count` invocations, as far as one dimension holds them, which the sizes here respect.
fn groups(count: usize, workgroup: u32) -> DispatchArgs {
    let x = (count as u32).div_ceil(workgroup);
    let y = u32::from(x > 0);
    DispatchArgs { x, y, z: 1 }
}

/// Arguments of one indirect dispatch: one invocation for each of `count` elements.
fn args(gpu: &Gpu, count: usize, workgroup: u32) -> Result<Buffer<DispatchArgs>> {
    gpu.buffer_from("args", &[groups(count, workgroup)])
}

/// Splats on the screen, as kernels read them.
pub(super) struct Records {
    pub(super) shape: Buffer<[f32; 4]>,
    pub(super) tone: Buffer<[f32; 4]>,
    pub(super) rest: Buffer<[f32; 2]>,
}

impl Records {
    fn new(gpu: &Gpu, records: &[Splat2d]) -> Result<Records> {
        let (shape, tone, rest) = arrays(records);
        Ok(Records {
            shape: gpu.buffer_from("ellipse_from_splat", &shape)?,
            tone: gpu.buffer_from("whiten_rg_from_splat", &tone)?,
            rest: gpu.buffer_from("blue_depth_from_splat", &rest)?,
        })
    }
}

/// Before a run that finds everything as it was.
fn nothing(_: &mut crate::gpu::Recorder<'_>) {}
