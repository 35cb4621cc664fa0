//! By what exponentials alphas are computed.

/// By what exponentials compositing turns distances into alphas: `2ˣ` exactly, or by a polynomial of what is left of the
/// whole number below x, whose power goes into the bits of a float's exponent.
///
/// Of alphas αᵢ that are off by the share ε each, a picture is off by at most ε Σ αᵢ Tᵢ times the range of its colours:
/// no more than ε of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Exponential {
    /// As exact as the device's `exp2`.
    #[default]
    Exact,
    /// By a polynomial of degree 3.
    Cubic,
    /// By a polynomial of degree 2.
    Quadratic,
}

/// Roundings of `f32` in a polynomial of degree 3, relatively: Horner's scheme has a product and a sum a degree, the
/// coefficients are rounded, all terms are positive, and so is what is left of x, itself rounded once.
const ROUNDING: f64 = 10.0 / (1 << 24) as f64;

impl Exponential {
    /// What shaders are told.
    pub(super) fn degree(self) -> u32 {
        match self {
            Exponential::Exact => 0,
            Exponential::Cubic => 3,
            Exponential::Quadratic => 2,
        }
    }

    /// The most by which alphas are off, as a share of themselves; of [`Exponential::Exact`] the rounding is the
    /// device's and not counted.
    pub fn alpha_error(self) -> f64 {
        match self {
            Exponential::Exact => 0.0,
            Exponential::Cubic => 7.4785e-5 + ROUNDING,
            Exponential::Quadratic => 1.724_77e-3 + ROUNDING,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHADER: &str = include_str!("../../glsl/shared/exponential.glsl");

    /// The shader's coefficients of a polynomial, the constant last.
    fn coefficients(degree: usize) -> Vec<f64> {
        let lines = SHADER.lines();
        let line = lines.filter(|line| line.contains("* f +")).nth(degree - 2);
        let words = line
            .unwrap_or_default()
            .split(|c: char| !c.is_ascii_digit() && c != '.');
        words
            .filter(|word| word.contains('.'))
            .filter_map(|word| word.parse().ok())
            .collect()
    }

    /// The largest relative error of a polynomial on a grid of [0, 1], and the most that it may be off between two of
    /// its points: an error's second derivative, 2⁻ᶠ (p″ − 2 ln 2 · p′ + ln² 2 · p), is below 2.
    fn largest(coefficients: &[f64]) -> f64 {
        let points = 20_000;
        let error = |i: usize| {
            let f = i as f64 / f64::from(points);
            let p = coefficients.iter().fold(0.0, |sum, c| sum * f + c);
            (p * (-f).exp2() - 1.0).abs()
        };
        let between = f64::from(points).powi(-2);
        (0..=points as usize).map(error).fold(0.0, f64::max) + between
    }

    #[test]
    fn polynomials_keep_to_the_error_that_is_stated() {
        for (exponential, degree) in [(Exponential::Cubic, 3), (Exponential::Quadratic, 2)] {
            let coefficients = coefficients(degree);
            assert_eq!(coefficients.len(), degree + 1, "{SHADER}");
            let (found, stated) = (largest(&coefficients), exponential.alpha_error() - ROUNDING);
            assert!(
                found <= stated && found > 0.999 * stated,
                "{found:e}, not {stated:e}"
            );
            // One digit of one coefficient would show.
            let mut wrong = coefficients;
            wrong[0] += 1e-3;
            assert!(largest(&wrong) > stated);
        }
        assert_eq!(Exponential::default().alpha_error(), 0.0);
    }
}
