//! Relocation formula of MCMC: opacity and size of n coincident copies that look like the original splat.

/// Opacity and scale factor of each of `copies` coincident splats that together look like a single one of this opacity
/// (MCMC, equation 9).
///
/// Their opacity a solves 1 − (1 − a)ⁿ = opacity. Along a line through the centre, n equal Gaussians compose to Σₖ C(n,
/// k) (−1)ᵏ⁺¹ aᵏ / √k times the width of one, k from 1 to n, and a single one to `opacity` times its width, so the
/// factor is the quotient. The published double sum equals this one (hockey-stick identity); there is no cap on n. The
/// terms alternate and grow to at most e^(n a) / √(n a) < 1e6 where the opacity is at most 1 − 1e-6, which costs `f64`
/// six of its sixteen digits.
pub fn relocated(opacity: f64, copies: u32) -> (f64, f64) {
    let opacity = opacity.clamp(0.0, 1.0 - 1e-6);
    if copies <= 1 || opacity == 0.0 {
        return (opacity, 1.0);
    }
    let n = f64::from(copies);
    let each = -((-opacity).ln_1p() / n).exp_m1();
    let mut term = n * each;
    let mut sum = term;
    for k in 1..copies {
        let k = f64::from(k);
        term *= -each * (n - k) / (k + 1.0);
        let next = sum + term / (k + 1.0).sqrt();
        // The terms fall once k exceeds n a: after one without effect, none has any.
        if next == sum {
            break;
        }
        sum = next;
    }
    (each, opacity / sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The published sum, in its own order: i over the copies, k over the binomial.
    fn published(opacity: f64, copies: u32) -> f64 {
        let each = 1.0 - (1.0 - opacity).powf(1.0 / f64::from(copies));
        let mut sum = 0.0;
        for i in 1..=copies {
            let mut binomial = 1.0;
            for k in 0..i {
                let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
                let power = each.powi(k as i32 + 1);
                sum += binomial * sign * power / f64::from(k + 1).sqrt();
                binomial *= f64::from(i - 1 - k) / f64::from(k + 1);
            }
        }
        opacity / sum
    }

    #[test]
    fn the_single_sum_is_the_published_double_sum() {
        for opacity in [0.005, 0.1, 0.5, 0.9, 0.999] {
            for copies in [1, 2, 3, 10, 51] {
                let (_, factor) = relocated(opacity, copies);
                let wanted = published(opacity, copies);
                assert!((factor / wanted - 1.0).abs() < 1e-9, "{opacity} {copies}");
            }
        }
    }

    #[test]
    fn opacity_and_line_integral_are_those_of_the_single_splat() {
        for opacity in [1e-4_f64, 0.3, 0.95, 0.999_999] {
            for copies in [2_u32, 7, 200, 10_000] {
                let (each, factor) = relocated(opacity, copies);
                let together = -(f64::from(copies) * (-each).ln_1p()).exp_m1();
                assert!((together / opacity - 1.0).abs() < 1e-9);
                // ∫ 1 − (1 − a e^(−x²/2))ⁿ dx by the trapezoid rule, spectrally exact here.
                let step = 0.05;
                let line: f64 = (-400..=400)
                    .map(|i| each * (-(f64::from(i) * step).powi(2) / 2.0).exp())
                    .map(|alpha| -(f64::from(copies) * (-alpha).ln_1p()).exp_m1() * step)
                    .sum();
                let single = opacity * std::f64::consts::TAU.sqrt();
                assert!((line * factor / single - 1.0).abs() < 1e-8, "{opacity} {copies}");
            }
        }
    }

    #[test]
    fn extremes_are_finite() {
        assert_eq!(relocated(0.7, 1), (0.7, 1.0));
        assert_eq!(relocated(0.0, 5), (0.0, 1.0));
        let (each, factor) = relocated(1.0, 3);
        assert!(each < 1.0 && factor.is_finite());
    }
}
