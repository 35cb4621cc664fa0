//! Stored depths from distances: the opposite of `linearize`.

use super::linearize::Code;

/// Value of a distance along z, of two the nearer; the code's empty value if both are infinite.
pub fn stored(z: f64, limit: f64, code: &Code) -> f64 {
    let nearest = z.min(limit);
    match (nearest.is_infinite(), code.is_linear) {
        (true, _) => code.empty,
        (false, true) => code.a + code.b * nearest,
        (false, false) => code.a + code.b / nearest,
    }
}
