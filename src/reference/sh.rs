//! Real spherical harmonics from the Legendre recurrence, and the colour of a splat.
//!
//! The sign convention is that of the 3DGS files: the Condon–Shortley phase (−1)^m is part of the basis.

use super::Real;
use super::linear::Vec3;
use std::f64::consts::{PI, SQRT_2};

/// Basis functions up to `degree` at the unit vector `direction`, in file order: degree by degree,
/// order −l to l within one.
pub fn basis<R: Real>(degree: u32, direction: Vec3<R>) -> Vec<R> {
    let mut functions = Vec::new();
    for l in 0..=i64::from(degree) {
        for m in -l..=l {
            functions.push(function(l, m, direction));
        }
    }
    functions
}

/// SH function of degree `l` and order `m`.
fn function<R: Real>(l: i64, m: i64, [x, y, z]: Vec3<R>) -> R {
    let order = m.abs();
    // sin^|m| θ (cos |m|φ + i sin |m|φ) = (x + iy)^|m|
    let (mut cosine, mut sine) = (R::of(1.0), R::of(0.0));
    for _ in 0..order {
        (cosine, sine) = (cosine * x - sine * y, cosine * y + sine * x);
    }
    let factorial = |n: i64| (1..=n).map(|k| k as f64).product::<f64>();
    let norm = (2 * l + 1) as f64 / (4.0 * PI) * factorial(l - order) / factorial(l + order);
    let phase = if order % 2 == 0 { 1.0 } else { -1.0 };
    let around = match m {
        0 => R::of(1.0),
        1.. => R::of(SQRT_2 * phase) * cosine,
        _ => R::of(SQRT_2 * phase) * sine,
    };
    R::of(norm.sqrt()) * legendre(l, order, z) * around
}

/// Associated Legendre function of `z = cos θ` without its factor sin^m θ and without phase.
fn legendre<R: Real>(l: i64, m: i64, z: R) -> R {
    let of = |n: i64| R::of(n as f64);
    let mut below = R::of(0.0);
    let mut here = (1..=m).fold(R::of(1.0), |p, k| p * of(2 * k - 1));
    for n in m + 1..=l {
        let next = (z * of(2 * n - 1) * here - of(n + m - 1) * below) / of(n - m);
        (below, here) = (here, next);
    }
    here
}

/// `0.5 + Σ coefficient · basis`, before the clamp. `coefficients` may hold more than `degree` needs.
pub fn unclamped_color<R: Real>(degree: u32, coefficients: &[Vec3<R>], direction: Vec3<R>) -> Vec3<R> {
    let mut color = [R::of(0.5); 3];
    for (function, coefficient) in basis(degree, direction).iter().zip(coefficients) {
        for channel in 0..3 {
            color[channel] = color[channel] + *function * coefficient[channel];
        }
    }
    color
}
