//! Quantiles of samples.

/// Value at a share of the ascending values, the nearest one (0.5: the median, the upper one of two in the middle);
/// reorders them. `None` if there are none.
///
/// # Panics
/// If `share` is above 1.
pub fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    let rank = (share * last as f64).round() as usize;
    Some(*values.select_nth_unstable_by(rank, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_values_at_the_nearest_rank() {
        let of = |values: &[f64], share| quantile(&mut values.to_vec(), share);
        assert_eq!(of(&[], 0.5), None);
        assert_eq!(of(&[3.0, 1.0], 0.5), Some(3.0));
        let five = [5.0, 1.0, 4.0, 2.0, 3.0];
        let shares = [0.0, 0.1, 0.2, 0.5, 0.95, 1.0];
        assert_eq!(
            shares.map(|share| of(&five, share)),
            [1.0, 1.0, 2.0, 3.0, 5.0, 5.0].map(Some)
        );
    }
}
