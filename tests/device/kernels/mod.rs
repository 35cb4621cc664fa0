//! Kernel tests: every kernel, every variant that the device can run, several workgroup sizes, against the oracle, on
//! adversarial inputs. Tolerances are derived beside their values; u = 2⁻²⁴ throughout.

use ashfall::Result;
use ashfall::kernels::Kernel;
use ashfall::lab::bench::kernels::{KernelCase, Workgroups};

mod adam;
mod adam_color;
mod baseline_16x16;
mod baseline_16x16_backward;
mod compact;
mod contribution;
mod delinearize;
mod expand;
mod gather;
mod linearize;
mod longest;
mod loss;
mod overlay;
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
mod select_rows;
mod selftest;
mod sort;
mod sum_by_splat;
mod surface_loss;

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

/// Workgroups of kernels of one invocation an element.
const ELEMENTWISE: Workgroups = Workgroups::any(&[1, 8, 64, 256]);

/// Workgroups of kernels with a workgroup a tile.
const LANES: Workgroups = Workgroups::lanes(&[8, 16, 32, 64, 128]);

/// Cases of the lengths at which workgroups and chunks begin and end.
fn by_length<'a, K: Kernel>(
    case: impl Fn(usize) -> Result<KernelCase<'a, K>>,
) -> Vec<(&'static str, KernelCase<'a, K>)> {
    LENGTHS.map(|(name, len)| (name, case(len).unwrap())).into()
}
