//! Terms of geometry by the surface of a frame, on images of every shape.

use super::ELEMENTWISE;
use crate::common::check::*;
use crate::common::device;
use ashfall::lab::bench::kernels::surface_loss::surface_loss;

#[test]
fn slopes_are_those_of_the_terms() {
    let gpu = device::gpu();
    let mut check = Check::new("surface_loss");
    for (size, with_spread) in [
        ([1, 1], true),
        ([2, 5], false),
        ([64, 3], true),
        ([61, 47], false),
        ([61, 47], true),
    ] {
        let name = format!("{size:?}, spread {with_spread}");
        let cases = [(name, surface_loss(&gpu, size, with_spread).unwrap())];
        check.cases(&gpu, ELEMENTWISE, &cases);
    }
    check.finish();
}
