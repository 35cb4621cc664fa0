//! Codes of single values: nearest code of a value, and value of a code.
//!
//! Formulas are those of the `spz` library, but that codes are nearest: its encoder rounds harmonics twice, and lets
//! positions beyond the range wrap around.

use std::f32::consts::FRAC_1_SQRT_2;

/// Colour of a harmonic of degree 0: 0.5 + 0.15 · coefficient, so that colours beyond 0 and 1 have codes.
const COLOR_SCALE: f32 = 0.15;
/// Steps of a logarithm of scale in 1, and the logarithm of code 0.
const SCALE_STEPS: f32 = 16.0;
const SCALE_LEAST: f32 = -10.0;
/// Code of a harmonic of zero, and codes in 1.
const SH_ZERO: i32 = 128;
/// Largest code of a quaternion's component, for √½: no other component exceeds that beside the largest.
const COMPONENT_MAX: f32 = 511.0;

/// Least and greatest code of a position, 24 bits in two's complement.
const POSITION_MIN: i32 = -(1 << 23);
const POSITION_MAX: i32 = (1 << 23) - 1;

/// Steps of positions in a world unit.
fn position_steps(fractional_bits: u32) -> f32 {
    (1u32 << fractional_bits) as f32
}

/// Whether the nearest code of a position is within the range.
pub(super) fn position_fits(position: f32, fractional_bits: u32) -> bool {
    let code = (position * position_steps(fractional_bits)).round();
    (POSITION_MIN as f32..=POSITION_MAX as f32).contains(&code)
}

/// Whether a code is within the range.
pub(super) fn is_position(code: i32) -> bool {
    (POSITION_MIN..=POSITION_MAX).contains(&code)
}

/// Nearest code of a position; of NaN, that of zero.
pub(super) fn position_code(position: f32, fractional_bits: u32) -> i32 {
    let code = (position * position_steps(fractional_bits)).round() as i32;
    code.clamp(POSITION_MIN, POSITION_MAX)
}

pub(super) fn position(code: i32, fractional_bits: u32) -> f32 {
    code as f32 / position_steps(fractional_bits)
}

/// Position code of its three bytes, little-endian.
pub(super) fn position_of_bytes([a, b, c]: [u8; 3]) -> i32 {
    // Shifted down from the top, so that the sign follows.
    i32::from_le_bytes([0, a, b, c]) >> 8
}

pub(super) fn alpha_code(logit: f32) -> u8 {
    (255.0 / (1.0 + (-logit).exp())).round() as u8
}

pub(super) fn color_code(coefficient: f32) -> u8 {
    (255.0 * (COLOR_SCALE * coefficient + 0.5)).round() as u8
}

pub(super) fn color(code: u8) -> f32 {
    (f32::from(code) / 255.0 - 0.5) / COLOR_SCALE
}

pub(super) fn scale_code(log_scale: f32) -> u8 {
    (SCALE_STEPS * (log_scale - SCALE_LEAST)).round() as u8
}

pub(super) fn scale(code: u8) -> f32 {
    f32::from(code) / SCALE_STEPS + SCALE_LEAST
}

/// Nearest code of a harmonic among the multiples of 2^(8 − `bits`); ties away from zero, so that signs do not matter.
pub(super) fn sh_code(coefficient: f32, bits: u32) -> u8 {
    let step = 1 << (8 - bits);
    let steps = (coefficient * SH_ZERO as f32 / step as f32).round() as i32;
    let most = SH_ZERO / step;
    (SH_ZERO + steps.clamp(-most, most - 1) * step) as u8
}

pub(super) fn sh(code: u8) -> f32 {
    (i32::from(code) - SH_ZERO) as f32 / SH_ZERO as f32
}

/// Code of a rotation of any length: in the top two bits the index of the largest component of x, y, z, w; then the
/// others in this order, 10 bits each, a sign and the magnitude in √½ / 511. Zero and NaN become no rotation.
pub(super) fn rotation_code([w, x, y, z]: [f32; 4]) -> u32 {
    let q = [x, y, z, w].map(f64::from);
    let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
    let q = match length > 0.0 && length.is_finite() {
        true => q.map(|v| (v / length) as f32),
        false => [0.0, 0.0, 0.0, 1.0],
    };
    let mut largest = 0;
    for i in 1..4 {
        if q[i].abs() > q[largest].abs() {
            largest = i;
        }
    }
    let mut code = largest as u32;
    for value in (0..4).filter(|i| *i != largest).map(|i| q[i]) {
        let magnitude = (COMPONENT_MAX * value.abs() / FRAC_1_SQRT_2).round().min(COMPONENT_MAX) as u32;
        // −q is the same rotation as q: the largest component is not negative. Zero has a single code.
        let negative = (value < 0.0) != (q[largest] < 0.0) && magnitude > 0;
        code = code << 10 | u32::from(negative) << 9 | magnitude;
    }
    code
}

/// Rotation w, x, y, z of a code.
pub(super) fn rotation(code: u32) -> [f32; 4] {
    let largest = (code >> 30) as usize;
    let mut q = [0.0f32; 4];
    let mut rest = code;
    for i in (0..4).rev().filter(|i| *i != largest) {
        let magnitude = (rest & 0x1ff) as f32 / COMPONENT_MAX * FRAC_1_SQRT_2;
        q[i] = if rest & 0x200 == 0 { magnitude } else { -magnitude };
        rest >>= 10;
    }
    q[largest] = (1.0 - q.iter().map(|v| v * v).sum::<f32>()).max(0.0).sqrt();
    let [x, y, z, w] = q;
    [w, x, y, z]
}

/// Lowest bits of the three components in the code of a rotation.
pub(super) const ROTATION_SHIFTS: [u32; 3] = [20, 10, 0];

/// Codes of a rotation with the component of a shift up to `reach` steps away.
pub(super) fn rotations_near(code: u32, shift: u32, reach: i32) -> impl Iterator<Item = u32> {
    let component = code >> shift & 0x3ff;
    let magnitude = (component & 0x1ff) as i32;
    let steps = if component & 0x200 == 0 { magnitude } else { -magnitude };
    let codes = (steps - reach..=steps + reach).filter(|steps| steps.abs() <= COMPONENT_MAX as i32);
    codes.map(move |steps| {
        let component = u32::from(steps < 0) << 9 | steps.unsigned_abs();
        code & !(0x3ff << shift) | component << shift
    })
}

/// Rotation w, x, y, z of the bytes of x, y, z in versions 1 and 2.
pub(super) fn rotation_of_bytes(bytes: [u8; 3]) -> [f32; 4] {
    let [x, y, z] = bytes.map(|b| f32::from(b) / 127.5 - 1.0);
    [(1.0 - (x * x + y * y + z * z)).max(0.0).sqrt(), x, y, z]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_is_the_nearest_to_its_own_value() {
        for code in 0..=255u8 {
            assert_eq!(color_code(color(code)), code);
            assert_eq!(scale_code(scale(code)), code);
            assert_eq!(sh_code(sh(code), 8), code);
        }
        for code in [POSITION_MIN, -1, 0, 1, 4097, POSITION_MAX] {
            for bits in [0, 12, 24] {
                assert_eq!(position_code(position(code, bits), bits), code);
            }
            let [a, b, c, _] = code.to_le_bytes();
            assert_eq!(position_of_bytes([a, b, c]), code);
        }
        assert!(position_fits(-2048.0, 12) && !position_fits(2048.0, 12) && position_fits(2048.0, 11));
    }

    #[test]
    fn harmonics_have_the_nearest_allowed_code() {
        for bits in 1..=8 {
            let allowed: Vec<u8> = (0..=255u8).filter(|code| code % (1 << (8 - bits)) as u8 == 0).collect();
            let allowed = if bits == 8 { (0..=255).collect() } else { allowed };
            for i in -300..300 {
                let value = i as f32 / 199.0;
                let found = sh_code(value, bits);
                assert!(allowed.contains(&found), "{found} of {bits} bits");
                let least = allowed.iter().map(|code| (sh(*code) - value).abs());
                let least = least.fold(f32::MAX, f32::min);
                assert!(
                    (sh(found) - value).abs() <= least + 1e-6,
                    "{value} has {found} of {bits} bits"
                );
            }
        }
        // Ties are symmetric: half a step of 4 bits is 8 codes.
        assert_eq!((sh_code(8.0 / 128.0, 4), sh_code(-8.0 / 128.0, 4)), (144, 112));
    }

    #[test]
    fn rotations_keep_each_component_and_sign() {
        for largest in 0..4 {
            for sign in [1.0, -1.0] {
                let mut q = [0.1, -0.2, 0.3, -0.15f32];
                q[largest] = 0.8 * sign;
                let length = q.iter().map(|v| v * v).sum::<f32>().sqrt();
                let found = rotation(rotation_code(q.map(|v| 3.0 * v)));
                for (found, wanted) in found.iter().zip(q) {
                    // Others are within half a step, and the largest within what follows from them.
                    assert!((found - sign * wanted / length).abs() < 1.5e-3, "{q:?}: {found}");
                }
            }
        }
        assert_eq!(rotation(rotation_code([0.0; 4])), [1.0, 0.0, 0.0, 0.0]);
        assert_eq!(rotation(rotation_code([f32::NAN; 4])), [1.0, 0.0, 0.0, 0.0]);
        // A sign without a magnitude, and all components at their largest.
        assert_eq!(rotation(0xc000_0000 | 0x200), [1.0, 0.0, 0.0, 0.0]);
        assert!(rotation(u32::MAX).iter().all(|v| v.is_finite()));
    }
}
