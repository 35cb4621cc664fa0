//! Adam step of every parameter, against the oracle.

use crate::common::check::*;
use crate::common::device;
use crate::kernels::ELEMENTWISE;
use ashfall::lab::bench::kernels::adam::{AdamInput, adam};

/// The three planes of geometry with vectors beyond the last splat.
fn planes(count: usize, magnitude: f64) -> AdamInput {
    AdamInput::new(count, count + 3, 0..3, magnitude)
}

/// Planes with a number among the gradients of every third vector.
fn poisoned(number: f32) -> AdamInput {
    let mut input = planes(100, 1.0);
    for (i, gradient) in input.vectors[1].iter_mut().enumerate() {
        if i % 3 == 1 && i % 11 != 5 {
            gradient[i % 4] = number;
        }
    }
    input
}

/// Planes with a bound on the log-ratio of scales. Log-scales lie between -2 and 2: a bound of 1 moves most of them,
/// one of 3.9 hardly any.
fn bounded(log_aspect_max: f32) -> AdamInput {
    AdamInput {
        log_aspect_max,
        ..planes(200, 1.0)
    }
}

#[test]
fn parameters_and_moments_step_together() {
    let gpu = device::gpu();
    let mut check = Check::new("adam");
    let failed = AdamInput {
        failed: true,
        ..planes(100, 1.0)
    };
    let cases = [
        ("nothing to update", planes(0, 1.0)),
        ("one", planes(1, 1.0)),
        ("2^6 + 1", planes(65, 1.0)),
        ("crosses workgroups", planes(1000, 1.0)),
        ("small gradients", planes(100, 1e-8)),
        ("large gradients", planes(100, 1e8)),
        ("NaN among gradients", poisoned(f32::NAN)),
        ("infinity among gradients", poisoned(f32::NEG_INFINITY)),
        ("a square beyond all numbers", poisoned(-3e19)),
        ("the frame failed", failed),
        ("aspect 1", bounded(1.0)),
        ("aspect 3.9", bounded(3.9)),
    ]
    .map(|(name, input)| (name, adam(&gpu, input).unwrap()));
    check.cases(&gpu, ELEMENTWISE, &cases);
    check.finish();
}
