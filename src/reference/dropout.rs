//! Random dropout of splats in a training step (Park et al., "DropGaussian", 2025).

use super::{Real, ScreenSplat};

/// Share of dropped splats and key of the random choice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Dropout {
    /// Share of dropped splats, times 2³².
    pub share: u32,
    /// Key of the step.
    pub key: u32,
}

impl Dropout {
    /// Whether a splat is dropped.
    pub fn drops(self, splat: u32) -> bool {
        pcg(self.key ^ splat) < self.share
    }

    /// Factor of the opacity of the other splats.
    pub fn factor(self) -> f64 {
        1.0 / (1.0 - f64::from(self.share) / 2_f64.powi(32))
    }

    /// A projected splat after dropout; `None` if it is dropped.
    pub fn applied<R: Real>(self, splat: u32, screen: ScreenSplat<R>) -> Option<ScreenSplat<R>> {
        let opacity = screen.opacity * R::of(self.factor());
        (!self.drops(splat)).then_some(ScreenSplat { opacity, ..screen })
    }
}

/// PCG-RXS-M-XS on 32 bits (O'Neill 2014, section 6.3), after one step of its generator.
pub(super) fn pcg(input: u32) -> u32 {
    let state = input.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_share_is_dropped_and_its_opacity_goes_to_the_others() {
        assert!((0..1_000).all(|splat| !Dropout::default().drops(splat)));
        let count = 100_000;
        for key in [0, 1, 0xDEAD_BEEF] {
            let dropout = Dropout { share: 1 << 30, key };
            let dropped = (0..count).filter(|&splat| dropout.drops(splat)).count();
            // Four standard deviations of a binomial distribution.
            let deviation = (f64::from(count) * 0.25 * 0.75).sqrt();
            assert!(
                (dropped as f64 - 0.25 * f64::from(count)).abs() < 4.0 * deviation,
                "{dropped}"
            );
            assert!((dropout.factor() - 4.0 / 3.0).abs() < 1e-12);
        }
    }
}
