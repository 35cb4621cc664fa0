//! Stored depths of splats, by every code.

use crate::common::check::*;
use crate::common::device;
use ashfall::lab::bench::kernels::Workgroups;
use ashfall::lab::bench::kernels::delinearize::delinearize;
use ashfall::reference::linearize::Code;

#[test]
fn depths_are_stored_in_every_code() {
    let code = |a: f64, b: f64, empty: f64| Code {
        a: f64::from(a as f32),
        b: f64::from(b as f32),
        is_linear: false,
        empty,
    };
    let (near, span) = (0.125, 2048.0 - 0.125);
    let linear = Code {
        is_linear: true,
        ..code(-near / span, 1.0 / span, 1.0)
    };
    let codes = [
        ("standard", code(2048.0 / span, -near * 2048.0 / span, 1.0)),
        ("reversed, infinite", code(0.0, near, 0.0)),
        ("linear", linear),
    ];
    let gpu = device::gpu();
    let mut check = Check::new("delinearize");
    let all = [[false, false], [true, false], [false, true], [true, true]];
    for (pixels, limited_and_mean) in all.map(|which| (131 * 50, which)).into_iter().chain([(1, all[0])]) {
        let cases = codes.map(|(name, code)| (name, delinearize(&gpu, pixels, code, limited_and_mean).unwrap()));
        check.cases(&gpu, Workgroups::any(&[64, 32]), &cases);
    }
    check.finish();
}
