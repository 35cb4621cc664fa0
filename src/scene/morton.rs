//! Order of splats in memory along a Morton curve: neighbours in space become neighbours in memory, and the splats of a
//! tile lie close together.

use glam::Vec3;

/// Bits per axis of a Morton code.
const AXIS_BITS: u32 = 10;

/// Rows in Morton order of their positions: `order[i]` is the `i`-th row. Equal codes keep the order of their rows;
/// rows without a finite position come last.
pub fn morton_order(positions: &[[f32; 3]]) -> Vec<u32> {
    let finite = || positions.iter().map(|&p| Vec3::from(p)).filter(|p| p.is_finite());
    let low = finite().fold(Vec3::INFINITY, Vec3::min);
    let high = finite().fold(Vec3::NEG_INFINITY, Vec3::max);
    let mut keyed: Vec<(u32, u32)> = positions
        .iter()
        .zip(0..)
        .map(|(&p, row)| (code(Vec3::from(p), low, high), row))
        .collect();
    // The row is part of the key, so that keys are unique and an unstable sort suffices.
    keyed.sort_unstable();
    keyed.into_iter().map(|(_, row)| row).collect()
}

fn code(position: Vec3, low: Vec3, high: Vec3) -> u32 {
    if !position.is_finite() {
        return u32::MAX;
    }
    let cells = ((1 << AXIS_BITS) - 1) as f32;
    let size = high / 2.0 - low / 2.0;
    let bits = (0..3).map(|axis| {
        // Halved before the subtraction, so that even the extremes of f32 do not overflow.
        let offset = position[axis] / 2.0 - low[axis] / 2.0;
        let share = if size[axis] > 0.0 { offset / size[axis] } else { 0.0 };
        spread((share * cells) as u32) << axis
    });
    bits.sum()
}

/// Moves bit `i` of ten to bit `3 i`.
fn spread(cell: u32) -> u32 {
    (0..AXIS_BITS).map(|bit| ((cell >> bit) & 1) << (3 * bit)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_of_a_cube_come_in_curve_order() {
        let corner = |i: usize| [(i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2 & 1) as f32];
        let shuffled: Vec<[f32; 3]> = [5, 2, 7, 0, 3, 6, 1, 4].map(corner).to_vec();
        let order = morton_order(&shuffled);
        let sorted: Vec<[f32; 3]> = order.iter().map(|&row| shuffled[row as usize]).collect();
        assert_eq!(sorted, (0..8).map(corner).collect::<Vec<_>>());
    }

    #[test]
    fn equal_and_broken_positions_keep_their_order() {
        assert!(morton_order(&[]).is_empty());
        assert_eq!(morton_order(&[[1.0; 3]; 3]), [0, 1, 2]);
        let nan = [f32::NAN, 0.0, 0.0];
        assert_eq!(morton_order(&[nan, [2.0; 3], nan, [1.0; 3]]), [3, 1, 0, 2]);
        assert_eq!(morton_order(&[[f32::MAX; 3], [f32::MIN; 3]]), [1, 0]);
    }
}
