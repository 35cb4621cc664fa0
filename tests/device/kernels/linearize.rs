//! Depths of a host's surfaces, by every code.

use crate::common::check::*;
use crate::common::device;
use ashfall::lab::bench::kernels::Workgroups;
use ashfall::lab::bench::kernels::linearize::linearize;
use ashfall::reference::linearize::Code;

/// Near and far plane.
const NEAR: f64 = 0.125;
const FAR: f64 = 2048.0;

#[test]
fn limits_are_those_of_every_code() {
    let code = |a: f64, b: f64, empty: f64| Code {
        a: f64::from(a as f32),
        b: f64::from(b as f32),
        is_linear: false,
        empty,
    };
    let span = FAR - NEAR;
    let codes = [
        ("standard", code(FAR / span, -NEAR * FAR / span, 1.0)),
        ("reversed", code(-NEAR / span, NEAR * FAR / span, 0.0)),
        ("reversed, infinite", code(0.0, NEAR, 0.0)),
        (
            "linear",
            Code {
                is_linear: true,
                ..code(0.0, 1.0, f64::from(1e30f32))
            },
        ),
        (
            "linear from near to far",
            Code {
                is_linear: true,
                ..code(-NEAR / span, 1.0 / span, 1.0)
            },
        ),
    ];
    let gpu = device::gpu();
    let mut check = Check::new("linearize");
    for size in [[1, 1], [8, 16], [9, 17], [131, 50]] {
        let cases = codes.map(|(name, code)| (name, linearize(&gpu, size, code).unwrap()));
        check.cases(&gpu, Workgroups::any(&[64, 32]), &cases);
    }
    check.finish();
}
