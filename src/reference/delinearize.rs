//! Stored depths from distances: the opposite of `linearize`.

use super::linearize::Code;

/// Mean depth of a pixel from the sum of weight times depth; infinite where the coverage is below 1/2.
pub fn mean_depth(sum: f64, transmittance: f64) -> f64 {
    match transmittance <= 0.5 {
        true => sum / (1.0 - transmittance),
        false => f64::INFINITY,
    }
}

/// Value of a distance along z, of two the nearer; the code's empty value if both are infinite.
pub fn stored(z: f64, limit: f64, code: &Code) -> f64 {
    let nearest = z.min(limit);
    match (nearest.is_infinite(), code.is_linear) {
        (true, _) => code.empty,
        (false, true) => code.a + code.b * nearest,
        (false, false) => code.a + code.b / nearest,
    }
}
