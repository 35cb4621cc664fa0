//! Coarse to fine: reduced photographs at the start of a run.

use super::TrainConfig;

/// Fewest pixels of a reduced photograph, on average, of large photographs.
const PIXELS_MIN: f64 = 65_536.0;

/// The same of small photographs: below, a step saves little by fewer pixels.
const PIXELS_MIN_SMALL: f64 = 16_384.0;

/// Share of the run with reduced photographs.
const SHARE: f64 = 0.5;

/// Most iterations with reduced photographs if these are small: half of a long run costs detail.
const UNTIL_SMALL: u32 = 300;

impl TrainConfig {
    /// The same run, for photographs of so many pixels on average: large ones are reduced for its first half, small
    /// ones for at most 300 iterations of it, tiny ones stay whole.
    ///
    /// Splats find their places and sizes on few pixels as well, and steps take less time.
    pub fn coarse_to_fine(mut self, pixels: f64) -> TrainConfig {
        let reduced = std::iter::successors(Some(pixels / 4.0), |pixels| Some(pixels / 4.0));
        let halvings = reduced.take_while(|&pixels| pixels >= PIXELS_MIN).take(8).count() as u32;
        let half = (f64::from(self.iterations) * SHARE) as u32;
        self.coarse_halvings = halvings.max(1);
        self.coarse_until = match halvings {
            0 if pixels / 4.0 >= PIXELS_MIN_SMALL => half.min(UNTIL_SMALL),
            0 => 0,
            _ => half,
        };
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_photographs_are_halved_while_enough_is_left() {
        let of = |pixels: f64| {
            let config = TrainConfig::for_iterations(1_000).coarse_to_fine(pixels);
            assert!(config.validate().is_ok());
            (config.coarse_halvings, config.coarse_until)
        };
        assert_eq!(of(192.0 * 144.0), (1, 0));
        assert_eq!(of(270.0 * 480.0), (1, 300));
        assert_eq!(of(960.0 * 540.0), (1, 500));
        assert_eq!(of(1_600.0 * 1_200.0), (2, 500));
        assert_eq!(of(8_192.0 * 5_464.0), (4, 500));
        assert_eq!([of(0.0), of(f64::NAN)], [(1, 0); 2]);
        assert_eq!(of(1e18).0, 8);
    }
}
