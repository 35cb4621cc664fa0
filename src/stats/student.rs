//! Quantiles of Student's t distribution.

/// One-sided 97.5 % quantile for `freedom` ≥ 1 degrees of freedom, to three digits (Abramowitz and Stegun, table 26.10;
/// above 30 degrees by the expansion about the normal quantile, 26.7.5). Infinite for `freedom` 0.
pub fn student_t_975(freedom: usize) -> f64 {
    const TABLE: [f64; 30] = [
        12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131,
        2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042,
    ];
    const NORMAL: f64 = 1.959_964;
    match freedom {
        0 => f64::INFINITY,
        1..=30 => TABLE[freedom - 1],
        _ => {
            let (z, n) = (NORMAL, freedom as f64);
            let second = (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / 96.0;
            let third = 3.0 * z.powi(7) + 19.0 * z.powi(5) + 17.0 * z.powi(3) - 15.0 * z;
            z + (z.powi(3) + z) / (4.0 * n) + second / (n * n) + third / (384.0 * n.powi(3))
        }
    }
}

/// One-sided 95 % quantile for `freedom` ≥ 1 degrees of freedom; above 12 that of 13, an upper bound. Infinite for
/// `freedom` 0.
pub fn student_t_95(freedom: usize) -> f64 {
    const TABLE: [f64; 12] = [
        6.314, 2.920, 2.353, 2.132, 2.015, 1.943, 1.895, 1.860, 1.833, 1.812, 1.796, 1.782,
    ];
    match freedom {
        0 => f64::INFINITY,
        1..=12 => TABLE[freedom - 1],
        _ => 1.771,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_tables() {
        for (freedom, quantile) in [(1, 12.706), (10, 2.228), (30, 2.042), (31, 2.040), (120, 1.980)] {
            assert!((student_t_975(freedom) - quantile).abs() < 1e-3, "{freedom}");
        }
        assert_eq!(
            [student_t_95(1), student_t_95(12), student_t_95(99)],
            [6.314, 1.782, 1.771]
        );
    }
}
