//! Adam step of the spherical harmonics, against the oracle.

use crate::common::check::*;
use crate::common::device;
use crate::kernels::ELEMENTWISE;
use ashfall::lab::bench::kernels::adam_color::{AdamColorInput, adam_color};

/// Splats with vectors beyond the last one.
fn splats(count: usize, sh_degree: u32, magnitude: f64, steps: usize) -> AdamColorInput {
    AdamColorInput::new(count, count + 3, sh_degree, magnitude, steps)
}

#[test]
fn harmonics_step_along_products_of_factors() {
    let gpu = device::gpu();
    let mut check = Check::new("adam_color");
    for degree in 0..=3 {
        let mut failed = splats(100, degree, 1.0, 4);
        failed.adam.failed = true;
        let cases = [
            ("nothing to update", splats(0, degree, 1.0, 4)),
            ("one", splats(1, degree, 1.0, 4)),
            ("2^6 + 1", splats(65, degree, 1.0, 4)),
            ("crosses workgroups", splats(1000, degree, 1.0, 4)),
            ("one step", splats(100, degree, 1.0, 1)),
            ("two steps", splats(100, degree, 1.0, 2)),
            ("three steps", splats(100, degree, 1.0, 3)),
            ("small gradients", splats(100, degree, 1e-8, 4)),
            ("large gradients", splats(100, degree, 1e8, 4)),
            ("the frame failed", failed),
        ]
        .map(|(name, input)| (name, adam_color(&gpu, input).unwrap()));
        check.cases(&gpu, ELEMENTWISE, &cases);
    }
    check.finish();
}
