//! Changes of a tile's pixels without each of its splats.

use crate::common::check::*;
use crate::common::device;
use crate::kernels::LANES;
use crate::kernels::rasterize::composites_of_kinds;
use ashfall::lab::bench::kernels::removal_error::removal_error;

#[test]
fn every_pair_has_its_change() {
    let gpu = device::gpu();
    let mut check = Check::new("removal_error");
    let composites = composites_of_kinds();
    let case = |of| removal_error(&gpu, of).unwrap();
    let cases: Vec<_> = composites.iter().map(|(name, of)| (*name, case(of))).collect();
    check.cases(&gpu, LANES, &cases);
    check.finish();
}
