//! Gradient of compositing for each intersection.

use crate::common::check::*;
use crate::common::device;
use crate::kernels::LANES;
use crate::kernels::rasterize::{composites, surfels};
use ashfall::lab::bench::kernels::Composite;
use ashfall::lab::bench::kernels::gradient::{
    CAPPED_TOLERANCE, Gradient, SOURCE_TOLERANCE, SURFEL_TOLERANCE, rasterize_backward, surfels_backward,
};

#[test]
fn every_intersection_gets_its_gradient() {
    let gpu = device::gpu();
    let mut check = Check::new("rasterize_backward");
    let composites = composites(Composite::of);
    let case = |name: &'static str, of| {
        let tolerance = match name {
            // A whole frame, whose passes share their alphas, does not feel the cap; the transmittance here is the
            // reference's.
            "capped" => CAPPED_TOLERANCE,
            // Peaks of 1 - 6e-6 likewise, in few pixels: of the 3 ULP that the Vulkan specification grants an
            // exponential near 0, the transmittance in front of them takes 3 %, at one pixel in 128 of a tile.
            "opaque stack" => 4.0 * SOURCE_TOLERANCE + 0.03 / 128.0,
            _ => SOURCE_TOLERANCE,
        };
        (
            name,
            rasterize_backward(&gpu, of, Gradient::new(of, 1), tolerance).unwrap(),
        )
    };
    let cases: Vec<_> = composites.iter().map(|(name, of)| case(name, of)).collect();
    check.cases(&gpu, LANES, &cases);
    check.finish();
}

#[test]
fn surfels_get_the_gradients_of_their_colours_and_alphas() {
    let gpu = device::gpu();
    let mut check = Check::new("rasterize_backward");
    let composites = surfels().map(|(name, mode, scene)| (name, mode, Composite::of(scene)));
    let case = |of, mode| surfels_backward(&gpu, of, Gradient::of_surfels(of, 1), mode, SURFEL_TOLERANCE).unwrap();
    let cases: Vec<_> = composites
        .iter()
        .map(|(name, mode, of)| (*name, case(of, *mode)))
        .collect();
    check.cases(&gpu, LANES, &cases);
    check.finish();
}
