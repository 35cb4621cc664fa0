//! Tone curve of photographs, that of sRGB: v = 1.055 L^(1/2.4) − 0.055 of linear light L, above a short linear toe.
//!
//! A factor of 2^e in linear light, e stops, is v' + 0.055 = g (v + 0.055) in stored values with g = 2^(e/2.4): affine,
//! with one number, and exact above the toe; on it v' = g^2.4 v. Logarithms of g are natural; a stop is 2.4 / ln 2 of
//! them.

/// Offset of the curve.
pub const CURVE_OFFSET: f64 = 0.055;

/// Exponent of the curve.
pub const CURVE_POWER: f64 = 2.4;

/// Slope of the toe: stored value over linear light.
const TOE_SLOPE: f64 = 12.92;

/// Levels of 8 bits from which a value is clipped.
const CLIPPED_HIGH: u8 = 254;

/// Levels of 8 bits up to which a value is clipped.
const CLIPPED_LOW: u8 = 1;

/// Linear light of a stored value (IEC 61966-2-1), with the curve continued above 1.
pub fn srgb_to_linear(value: f64) -> f64 {
    match value <= 0.040_45 {
        true => value / TOE_SLOPE,
        false => ((value + CURVE_OFFSET) / (1.0 + CURVE_OFFSET)).powf(CURVE_POWER),
    }
}

/// Stored value of linear light: the inverse of [`srgb_to_linear`].
pub fn linear_to_srgb(light: f64) -> f64 {
    match light <= 0.003_130_8 {
        true => TOE_SLOPE * light,
        false => (1.0 + CURVE_OFFSET) * light.powf(1.0 / CURVE_POWER) - CURVE_OFFSET,
    }
}

/// Stops in linear light of the logarithm of a gain.
pub fn stops(log_gain: f64) -> f64 {
    log_gain * CURVE_POWER / std::f64::consts::LN_2
}

/// Gain of stored values.
#[derive(Clone, Copy, Debug)]
pub(super) struct ToneGain {
    /// Gain g above the toe.
    gain: f64,
    /// Slope g^2.4 on the toe.
    toe: f64,
}

impl ToneGain {
    pub(super) fn of_log(log_gain: f64) -> ToneGain {
        ToneGain {
            gain: log_gain.exp(),
            toe: (CURVE_POWER * log_gain).exp(),
        }
    }

    /// Level under the gain. A clipped one says nothing of the light, and stays.
    pub(super) fn level(&self, level: u8) -> u8 {
        if level <= CLIPPED_LOW || level >= CLIPPED_HIGH {
            return level;
        }
        let value = f64::from(level) / 255.0;
        let curve = self.gain * (value + CURVE_OFFSET) - CURVE_OFFSET;
        let toe = self.toe * value;
        let exposed = if self.gain >= 1.0 {
            curve.min(toe)
        } else {
            curve.max(toe)
        };
        // The cast clamps.
        (255.0 * exposed).round() as u8
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_and_its_inverse_agree() {
        assert_eq!([0.0, 1.0].map(srgb_to_linear), [0.0, 1.0]);
        assert!((srgb_to_linear(0.5) - 0.214_041_140_5).abs() < 1e-9);
        // On the toe, about its end, and above 1.
        for value in [0.01, 0.040_44, 0.040_46, 0.3, 1.0, 2.5] {
            let again = linear_to_srgb(srgb_to_linear(value));
            assert!((again - value).abs() < 1e-6, "{value} becomes {again}");
        }
    }
}
