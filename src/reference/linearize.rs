//! Depths of a host's surfaces from its stored depths.

/// Code of a stored depth: `a + b / z`, or `a + b · z` if linear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Code {
    /// Constant term.
    pub a: f64,
    /// Factor of 1 / z, or of z.
    pub b: f64,
    /// True for values linear in z.
    pub is_linear: bool,
    /// Value without a surface.
    pub empty: f64,
}

/// Distance along z that a value stands for: infinite without a surface and for surfaces that are not before the
/// camera.
pub fn limit(value: f64, code: &Code) -> f64 {
    // Solved for z, or for 1 / z.
    let solution = (value - code.a) / code.b;
    let z = if code.is_linear { solution } else { solution.recip() };
    match value != code.empty && z >= 0.0 {
        true => z,
        false => f64::INFINITY,
    }
}
