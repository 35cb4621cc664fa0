//! Kernel tests: every kernel, every variant that the device can run, several workgroup sizes, against the oracle, on
//! adversarial inputs. Tolerances are derived beside their values; u = 2⁻²⁴ throughout.

use ashfall::gpu::Gpu;

mod adam;
mod baseline_16x16;
mod baseline_16x16_backward;
mod compact;
mod contribution;
mod expand;
mod gather;
mod longest;
mod loss;
mod perturb;
mod plan;
mod present;
mod project;
mod project_backward;
mod prune_limit;
mod ranges;
mod rasterize;
mod rasterize_backward;
mod removal_error;
mod scan;
mod selftest;
mod sort;
mod sum_by_splat;

/// Lengths at which workgroups and chunks begin and end.
const LENGTHS: [(&str, usize); 9] = [
    ("nothing to do", 0),
    ("one", 1),
    ("2^6 - 1", 63),
    ("2^6", 64),
    ("2^6 + 1", 65),
    ("2^8 - 1", 255),
    ("2^8", 256),
    ("2^8 + 1", 257),
    ("crosses workgroups", 5000),
];

/// Sizes of workgroups that the device can have.
fn fitting<const N: usize>(gpu: &Gpu, sizes: [u32; N]) -> impl Iterator<Item = u32> {
    let most = gpu.caps().max_workgroup;
    sizes.into_iter().filter(move |&size| size <= most)
}

/// The variants that the device can run.
macro_rules! supported {
    ($kernel:ident, $gpu:expr) => {
        ashfall::kernels::$kernel::Variant::ALL
            .iter()
            .copied()
            .filter(|variant| $gpu.caps().supports(variant.info()).is_ok())
    };
}
pub(crate) use supported;

/// The choices of a kernel that walks the lists of tiles: every variant in every number of lanes that a tile can have.
macro_rules! lane_choices {
    ($kernel:ident, $gpu:expr) => {
        crate::kernels::supported!($kernel, $gpu)
            .flat_map(|variant| [8, 16, 32].map(|lanes| (variant, lanes)))
            .filter(|(variant, lanes)| $gpu.caps().lanes_fit(variant.info(), *lanes))
            .map(|(variant, workgroup)| {
                let mut choice = ashfall::kernels::$kernel::Choice::default();
                choice.variant = variant;
                choice.spec.workgroup = workgroup;
                choice
            })
    };
}
pub(crate) use lane_choices;
