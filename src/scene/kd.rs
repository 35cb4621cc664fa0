//! Order of positions by halves of space.

/// Rows in the order of a k-d tree of their positions, cut across the longest side of their extent, at a multiple of
/// `block` rows as long as there are more: rows of each block of `block` are near each other, whatever their density.
/// Equal positions keep the order of their rows; those with NaN or an infinity come first or last of their side.
///
/// # Panics
/// If `block` is 0.
pub fn kd_order(positions: &[[f32; 3]], block: usize) -> Vec<u32> {
    let mut order: Vec<u32> = (0..).take(positions.len()).collect();
    sort(positions, block, &mut order);
    order
}

fn sort(positions: &[[f32; 3]], block: usize, rows: &mut [u32]) {
    if rows.len() < 2 {
        return;
    }
    let axis = longest_side(positions, rows);
    let key = |&row: &u32| (positions[row as usize][axis], row);
    let half = match rows.len() > block {
        true => rows.len().div_ceil(2).next_multiple_of(block),
        false => rows.len() / 2,
    };
    rows.select_nth_unstable_by(half, |a, b| {
        let ((a, first), (b, second)) = (key(a), key(b));
        a.total_cmp(&b).then(first.cmp(&second))
    });
    let (low, high) = rows.split_at_mut(half);
    rayon::join(|| sort(positions, block, low), || sort(positions, block, high));
}

/// Axis of the greatest extent of the finite coordinates.
fn longest_side(positions: &[[f32; 3]], rows: &[u32]) -> usize {
    let mut range = [[f32::INFINITY, f32::NEG_INFINITY]; 3];
    for &row in rows {
        for (range, &x) in range.iter_mut().zip(&positions[row as usize]) {
            if x.is_finite() {
                *range = [range[0].min(x), range[1].max(x)];
            }
        }
    }
    // Halved before the subtraction, so that even the extremes of f32 do not overflow.
    let side = |axis: usize| range[axis][1] / 2.0 - range[axis][0] / 2.0;
    (1..3).fold(
        0,
        |longest, axis| if side(axis) > side(longest) { axis } else { longest },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_lie_side_by_side() {
        // A line of eleven, shuffled, and blocks of four.
        let positions: Vec<[f32; 3]> = (0..11).map(|i| [1.0, (i * 7 % 11) as f32, 2.0]).collect();
        let order = kd_order(&positions, 4);
        let places: Vec<f32> = order.iter().map(|&row| positions[row as usize][1]).collect();
        assert_eq!(places, (0..11).map(|i| i as f32).collect::<Vec<_>>());
    }

    #[test]
    fn an_outlier_leaves_the_blocks_of_the_others_small() {
        let mut positions: Vec<[f32; 3]> = (0..64).map(|i| [(i * 37 % 64) as f32, 0.0, 0.0]).collect();
        positions[5] = [1e30, 0.0, 0.0];
        let order = kd_order(&positions, 16);
        for block in order.chunks(16).take(3) {
            let x = |row: &u32| positions[*row as usize][0];
            let range = block
                .iter()
                .map(x)
                .fold([f32::MAX, f32::MIN], |r, x| [r[0].min(x), r[1].max(x)]);
            assert!(range[1] - range[0] <= 16.0, "{range:?}");
        }
    }

    #[test]
    fn every_row_is_there_once() {
        let nan = [f32::NAN, f32::INFINITY, 0.0];
        let mut order = kd_order(&[nan, [2.0; 3], [2.0; 3], [f32::MAX; 3], [f32::MIN; 3], nan], 2);
        order.sort_unstable();
        assert_eq!(order, [0, 1, 2, 3, 4, 5]);
        assert!(kd_order(&[], 256).is_empty());
    }
}
