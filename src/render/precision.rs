//! Storage precision of a scene on the device (f32 or f16).

use crate::layout::{GEOMETRY_PLANES, HALF_GEOMETRY_PLANES};
use crate::scene::{Splats, sh_coefficient_count};
use half::f16;

/// Storage precision of a scene on the device: halves take less memory and bandwidth.
///
/// Halves are rounded to nearest; subnormals become 0, so that devices need not support them, and magnitudes above the
/// maximum become 65,504. Means are always f32: as halves they would be off by pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// 32-bit floats.
    #[default]
    Full,
    /// SH as halves.
    HalfHarmonics,
    /// All but means as halves: rotations to 8e-4 rad, scales to half a percent.
    Half,
}

impl Precision {
    /// Planes of vec4 of splats of a degree.
    pub const fn plane_count(self, sh_degree: u32) -> usize {
        let numbers = sh_coefficient_count(sh_degree) * 3;
        match self {
            Precision::Full => GEOMETRY_PLANES as usize + numbers.div_ceil(4),
            Precision::HalfHarmonics => GEOMETRY_PLANES as usize + numbers.div_ceil(8),
            Precision::Half => HALF_GEOMETRY_PLANES as usize + numbers.div_ceil(8),
        }
    }

    /// Bytes of a splat of a degree.
    pub const fn splat_bytes(self, sh_degree: u32) -> usize {
        16 * self.plane_count(sh_degree)
    }

    /// Value of the shaders' `PRECISION`.
    pub(super) fn code(self) -> u32 {
        match self {
            Precision::Full => 0,
            Precision::HalfHarmonics => 1,
            Precision::Half => 2,
        }
    }

    /// The scene as drawn: each number rounded to its stored value.
    pub fn rounded(self, splats: &Splats) -> Splats {
        let mut rounded = splats.clone();
        let round = |value: &mut f32| *value = half(*value).to_f32();
        if self != Precision::Full {
            rounded.sh.iter_mut().for_each(round);
        }
        if self == Precision::Half {
            rounded.quaternion.as_flattened_mut().iter_mut().for_each(round);
            rounded.log_scale.as_flattened_mut().iter_mut().for_each(round);
            rounded.opacity_logit.iter_mut().for_each(round);
        }
        rounded
    }

    /// Planes of the splats `some`, one after the other, with SH up to `degree`.
    pub(super) fn planes_of(self, splats: &Splats, some: &[u32], degree: u32) -> Vec<[f32; 4]> {
        let mut planes = Vec::with_capacity(some.len() * self.plane_count(degree));
        let all = || some.iter().map(|&i| i as usize);
        let (mean, logit) = (&splats.mean, &splats.opacity_logit);
        let (quaternion, log_scale) = (&splats.quaternion, &splats.log_scale);
        if self == Precision::Half {
            planes.extend(all().map(|i| [mean[i][0], mean[i][1], mean[i][2], 0.0]));
            planes.extend(all().map(|i| {
                let (q, s) = (quaternion[i], log_scale[i]);
                [
                    pair(q[0], q[1]),
                    pair(q[2], q[3]),
                    pair(s[0], s[1]),
                    pair(s[2], logit[i]),
                ]
            }));
        } else {
            planes.extend(all().map(|i| [mean[i][0], mean[i][1], mean[i][2], logit[i]]));
            planes.extend(all().map(|i| quaternion[i]));
            planes.extend(all().map(|i| [log_scale[i][0], log_scale[i][1], log_scale[i][2], 0.0]));
        }
        let (stride, numbers) = (splats.sh_stride(), 3 * sh_coefficient_count(degree));
        let row = |i: usize| &splats.sh[i * stride..][..numbers];
        let at = |i: usize, k: usize| row(i).get(k).copied().unwrap_or(0.0);
        match self {
            Precision::Full => {
                for start in (0..numbers).step_by(4) {
                    planes.extend(all().map(|i| [0, 1, 2, 3].map(|k| at(i, start + k))));
                }
            }
            _ => {
                for start in (0..numbers).step_by(8) {
                    let two = |i, k| pair(at(i, start + k), at(i, start + k + 1));
                    planes.extend(all().map(|i| [0, 2, 4, 6].map(|k| two(i, k))));
                }
            }
        }
        planes
    }
}

/// Stored half of a number. NaN and infinities are kept: such splats are not drawn.
fn half(value: f32) -> f16 {
    let nearest = f16::from_f32(value);
    match () {
        () if value.is_finite() && nearest.is_infinite() => f16::MAX.copysign(nearest),
        () if nearest.is_normal() || !value.is_finite() => nearest,
        () => f16::ZERO,
    }
}

/// Two halves packed as the bits of a float, the first in the low bits.
fn pair(first: f32, second: f32) -> f32 {
    let [low, high] = [first, second].map(|value| u32::from(half(value).to_bits()));
    f32::from_bits(low | high << 16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_become_the_nearest_halves() {
        for (value, stored) in [
            (1.0, 1.0),
            (-0.333_333_34, -0.333_251_95),
            (1e6, 65_504.0),
            (-1e9, -65_504.0),
            (1e-5, 0.0),
            (f32::INFINITY, f32::INFINITY),
        ] {
            assert_eq!(half(value).to_f32(), stored, "{value}");
        }
        assert!(half(f32::NAN).is_nan());
        let bits = pair(1.0, -2.0).to_bits();
        assert_eq!(bits, 0xc000_3c00);
    }

    #[test]
    fn halves_take_what_they_say() {
        let bytes = [Precision::Full, Precision::HalfHarmonics, Precision::Half];
        assert_eq!(bytes.map(|p| p.splat_bytes(3)), [240, 144, 128]);
        assert_eq!(bytes.map(|p| p.splat_bytes(0)), [64, 64, 48]);
    }
}
