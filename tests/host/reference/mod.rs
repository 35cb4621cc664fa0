//! The oracle against closed forms, finite differences and metamorphic relations, without a GPU.

mod bounds;
mod closed_forms;
mod derivatives;
mod gradient_bounds;
mod gradients;
mod losses;
mod metamorphic;
mod operations;
mod packing;
mod planes;
mod rays;
mod sample;
mod surface_terms;
mod surfels;
mod thresholds;

/// Asserts that two numbers agree within `tolerance` times the larger magnitude, or absolutely within `tolerance *
/// scale`.
#[track_caller]
fn assert_close(a: f64, b: f64, tolerance: f64, scale: f64) {
    let bound = tolerance * a.abs().max(b.abs()).max(scale);
    assert!(
        (a - b).abs() <= bound,
        "{a:e} and {b:e} differ by {:e}, more than {bound:e}",
        a - b
    );
}

/// The derivative of `f` at `x` by central differences, extrapolated to fourth order.
fn central_difference(f: impl Fn(f64) -> f64, x: f64, step: f64) -> f64 {
    let slope = |h: f64| (f(x + h) - f(x - h)) / (2.0 * h);
    (4.0 * slope(step) - slope(2.0 * step)) / 3.0
}
