//! Baseline of the backward pass: the cases of `rasterize_backward`, summed by splat.

use crate::common::check::*;
use crate::common::device;
use crate::kernels::rasterize::composites;
use ashfall::kernels::baseline_16x16_backward::Variant;
use ashfall::lab::bench::kernels::gradient::{CAPPED_TOLERANCE, Gradient, SPLAT_TOLERANCE, baseline_16x16_backward};
use ashfall::lab::bench::kernels::{Composite, Workgroups};

#[test]
fn every_splat_gets_its_gradient() {
    let gpu = device::gpu();
    if let Err(lack) = gpu.caps().supports(Variant::Base.info()) {
        // A baseline, on which nothing else relies: it is the design of another program, with its requirements.
        println!("baseline_16x16_backward needs {lack}");
        return;
    }
    let mut check = Check::new("baseline_16x16_backward");
    let composites = composites(Composite::in_squares);
    let case = |name: &'static str, of| {
        let tolerance = match name {
            "capped" => CAPPED_TOLERANCE,
            _ => SPLAT_TOLERANCE,
        };
        (
            name,
            baseline_16x16_backward(&gpu, of, Gradient::new(of, 1), tolerance).unwrap(),
        )
    };
    let cases: Vec<_> = composites.iter().map(|(name, of)| case(name, of)).collect();
    check.cases(&gpu, Workgroups::FIXED, &cases);
    check.finish();
}
