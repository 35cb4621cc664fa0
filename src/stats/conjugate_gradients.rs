//! Conjugate gradients with a preconditioner (Hestenes and Stiefel 1952).

/// Symmetric system of equations without negative eigenvalues.
pub(crate) trait SymmetricSystem {
    /// Product of the matrix with a vector.
    fn product(&self, vector: &[f64]) -> Vec<f64>;

    /// Product of an approximate inverse of the matrix with a vector.
    fn precondition(&self, vector: &[f64]) -> Vec<f64>;
}

/// Moves `solution`, whose residual is given, until the squared residual in the preconditioner's norm is at most
/// `enough` of the first one, or for so many iterations.
pub(crate) fn improve(
    system: &impl SymmetricSystem,
    solution: &mut [f64],
    mut residual: Vec<f64>,
    enough: impl Fn(f64) -> f64,
    iterations: usize,
) {
    let mut direction = system.precondition(&residual);
    let mut energy = dot(&residual, &direction);
    let end = enough(energy);
    for _ in 0..iterations {
        if energy.is_nan() || energy <= end {
            return;
        }
        let image = system.product(&direction);
        let curvature = dot(&direction, &image);
        if curvature <= 0.0 {
            return;
        }
        let step = energy / curvature;
        solution.iter_mut().zip(&direction).for_each(|(x, d)| *x += step * d);
        residual.iter_mut().zip(&image).for_each(|(r, i)| *r -= step * i);
        let preconditioned = system.precondition(&residual);
        let next = dot(&residual, &preconditioned);
        let ratio = next / energy;
        let pairs = direction.iter_mut().zip(&preconditioned);
        pairs.for_each(|(d, p)| *d = p + ratio * *d);
        energy = next;
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
