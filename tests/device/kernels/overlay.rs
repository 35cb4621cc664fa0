//! Splats over a host's pixels; `tests/device/embed` has hosts' images.

use crate::common::check::*;
use crate::common::device;
use ashfall::lab::bench::kernels::Workgroups;
use ashfall::lab::bench::kernels::overlay::overlay;

#[test]
fn splats_are_laid_over_display_values_and_over_light() {
    let gpu = device::gpu();
    let mut check = Check::new("overlay");
    for gain in [None, Some(1.0), Some(2.0)] {
        let sizes = [("less than a block", [7, 5]), ("a block", [8, 8]), ("wide", [131, 9])];
        let cases = sizes.map(|(name, size)| (name, overlay(&gpu, size, gain).unwrap()));
        check.cases(&gpu, Workgroups::FIXED, &cases);
    }
    check.finish();
}
