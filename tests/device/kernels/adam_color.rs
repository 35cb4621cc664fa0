//! Adam step of the spherical harmonics, against the oracle.

use crate::common::check::*;
use crate::common::device;
use crate::kernels::ELEMENTWISE;
use ashfall::lab::bench::kernels::adam_color::{AdamColorInput, adam_color};

/// Splats with vectors beyond the last one.
fn splats(count: usize, sh_degree: u32, magnitude: f64, poison: Option<f32>) -> AdamColorInput {
    AdamColorInput::new(count, count + 3, sh_degree, magnitude, poison)
}

#[test]
fn harmonics_step_along_products_of_factors() {
    let gpu = device::gpu();
    let mut check = Check::new("adam_color");
    for degree in 0..=3 {
        let mut failed = splats(100, degree, 1.0, None);
        failed.adam.failed = true;
        let cases = [
            ("nothing to update", splats(0, degree, 1.0, None)),
            ("one", splats(1, degree, 1.0, None)),
            ("2^6 + 1", splats(65, degree, 1.0, None)),
            ("crosses workgroups", splats(1000, degree, 1.0, None)),
            ("small gradients", splats(100, degree, 1e-8, None)),
            ("large gradients", splats(100, degree, 1e8, None)),
            ("NaN among gradients", splats(100, degree, 1.0, Some(f32::NAN))),
            (
                "infinity among gradients",
                splats(100, degree, 1.0, Some(f32::INFINITY)),
            ),
            ("the frame failed", failed),
        ]
        .map(|(name, input)| (name, adam_color(&gpu, input).unwrap()));
        check.cases(&gpu, ELEMENTWISE, &cases);
    }
    check.finish();
}
