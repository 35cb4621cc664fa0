//! A composited image in a storage image of our own; hosts' images are those of `tests/device/embed`.

use crate::common::check::*;
use crate::common::device;
use ashfall::lab::bench::kernels::Workgroups;
use ashfall::lab::bench::kernels::present::present;

/// Sizes at which blocks of 8x8 invocations begin and end.
const SIZES: [(&str, [u32; 2]); 6] = [
    ("one", [1, 1]),
    ("less than a block", [7, 5]),
    ("a block", [8, 8]),
    ("a pixel more than a block", [9, 9]),
    ("wide", [131, 3]),
    ("tall", [2, 97]),
];

#[test]
fn every_pixel_gets_its_colour_and_its_opacity() {
    let gpu = device::gpu();
    let mut check = Check::new("present");
    let cases = SIZES.map(|(name, size)| (name, present(&gpu, size).unwrap()));
    check.cases(&gpu, Workgroups::FIXED, &cases);
    check.finish();
}
