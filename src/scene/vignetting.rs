//! Vignetting: a lens darkens pictures towards their corners.

use super::Camera;
use super::tone::{ToneGain, stops};
use glam::DVec2;

/// Vignetting of a lens: gain of stored values ([`CURVE_OFFSET`](super::CURVE_OFFSET)) by the distance from the
/// principal point, the same in all channels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Vignetting {
    /// Natural logarithm of the gain: coefficients of q and q², where q is the squared distance from the principal
    /// point, 1 at the farthest corner.
    pub coefficients: [f64; 2],
}

impl Vignetting {
    /// q and q² at a place in pixels.
    pub fn powers(camera: &Camera, pixel: DVec2) -> [f64; 2] {
        let q = (pixel - camera.center).length_squared() / farthest_corner(camera);
        [q, q * q]
    }

    /// Natural logarithm of the gain at a place in pixels.
    pub fn log_gain(&self, camera: &Camera, pixel: DVec2) -> f64 {
        let powers = Vignetting::powers(camera, pixel);
        self.coefficients.iter().zip(powers).map(|(a, q)| a * q).sum()
    }

    /// Light in the farthest corner beside that of the middle, stops of linear light; negative where it is darker.
    pub fn corner_stops(&self) -> f64 {
        stops(self.coefficients.iter().sum())
    }

    /// Whether light falls all the way to the corner.
    pub fn falls(&self) -> bool {
        // The slope by q is linear.
        let [linear, square] = self.coefficients;
        linear <= 0.0 && linear + 2.0 * square <= 0.0
    }

    /// Removes the vignetting from the pixels of a photograph of `camera`. Clipped levels (0, 1, 254, 255) stay.
    pub fn remove(&self, rgba: &mut [[u8; 4]], camera: &Camera) {
        let columns = camera.width.max(1) as usize;
        for (y, row) in rgba.chunks_mut(columns).enumerate() {
            for (x, [r, g, b, _]) in row.iter_mut().enumerate() {
                let center = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                let gain = ToneGain::of_log(-self.log_gain(camera, center));
                [r, g, b].into_iter().for_each(|level| *level = gain.level(*level));
            }
        }
    }
}

/// Squared distance of the farthest corner from the principal point, pixels.
fn farthest_corner(camera: &Camera) -> f64 {
    let size = DVec2::new(camera.width.into(), camera.height.into());
    camera.center.max(size - camera.center).length_squared()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec3};

    fn camera() -> Camera {
        Camera {
            width: 12,
            height: 8,
            focal: DVec2::splat(10.0),
            center: DVec2::new(5.0, 4.0),
            rotation: DMat3::IDENTITY,
            position: DVec3::ZERO,
        }
    }

    #[test]
    fn removal_brings_back_linear_light() {
        let vignetting = Vignetting {
            coefficients: [-0.1, -0.12],
        };
        let corner = DVec2::new(12.0, 8.0);
        assert!((vignetting.log_gain(&camera(), corner) + 0.22).abs() < 1e-12);
        assert!((vignetting.corner_stops() + 0.22 * 2.4 / 2_f64.ln()).abs() < 1e-12);
        let light = 0.3_f64;
        let level = |light: f64| (255.0 * (1.055 * light.powf(1.0 / 2.4) - 0.055)).round() as u8;
        let pixels = (0..96).map(|i| DVec2::new(f64::from(i % 12) + 0.5, f64::from(i / 12) + 0.5));
        let pixels = pixels.map(|pixel| {
            let factor = (2.4 * vignetting.log_gain(&camera(), pixel)).exp();
            [level(light * factor), 3, 255, 7]
        });
        let mut rgba: Vec<[u8; 4]> = pixels.collect();
        vignetting.remove(&mut rgba, &camera());
        for [r, g, b, a] in &rgba {
            assert!(r.abs_diff(level(light)) <= 1, "{r}");
            // On the toe, stored values are in proportion to light; clipped ones and alpha stay.
            assert!((3..=4).contains(g) && (*b, *a) == (255, 7), "{g} {b} {a}");
        }
        assert_eq!(rgba[95][1], 4, "3 by 1.47 at the corner's pixel");
    }
}
