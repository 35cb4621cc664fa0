//! Baseline of compositing, with 16 × 16 tiles: the cases of `rasterize`.

use crate::common::check::*;
use crate::common::device;
use crate::kernels::rasterize::composites;
use ashfall::lab::bench::kernels::composite::baseline_16x16;
use ashfall::lab::bench::kernels::{Composite, Workgroups};

#[test]
fn pixels_are_composited() {
    let gpu = device::gpu();
    let mut check = Check::new("baseline_16x16");
    let composites = composites(Composite::in_squares);
    let case = |of| baseline_16x16(&gpu, of).unwrap();
    let cases: Vec<_> = composites.iter().map(|(name, of)| (*name, case(of))).collect();
    check.cases(&gpu, Workgroups::FIXED, &cases);
    check.finish();
}
