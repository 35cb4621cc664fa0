//! Displacement of a photograph against a rendering about a pixel, by the inverse compositional Lucas–Kanade method
//! (Baker and Matthews 2004) on pyramids.

use glam::{DMat2, DVec2};

/// Distance of a window's middle from the border of a picture, pixels.
pub(super) const BORDER: u32 = 8;
/// Distance of a window's middle from its sides, pixels.
const RADIUS: i32 = 5;
/// Levels of a pyramid.
const LEVELS: usize = 3;
/// Iterations at each level.
const ITERATIONS: usize = 8;
/// Longest step of an iteration, and the length below which a level ends, pixels of the level.
const STEP_MAX: f64 = 2.0;
const STEP_MIN: f64 = 0.005;
/// Correlation of a window's pixels that counts as a match.
const CORRELATION_MIN: f64 = 0.8;
/// Contrast of a rendering's window, standard deviation of 0 to 1.
const CONTRAST_MIN: f64 = 0.01;
/// Error of a displacement besides that of the pixels' differences, pixels: renderings displace textures themselves.
const FLOOR: f64 = 0.1;

/// Grey values, row by row from the top.
struct Gray {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Gray {
    /// Value at a place in pixels, bilinear between the pixels' centres, at borders that of the nearest pixel.
    fn at(&self, place: DVec2) -> f64 {
        let most = DVec2::new(self.width as f64 - 1.0, self.height as f64 - 1.0);
        let place = (place - 0.5).clamp(DVec2::ZERO, most);
        let (x, y) = (place.x as usize, place.y as usize);
        let (u, v) = (place.x - x as f64, place.y - y as f64);
        let (right, below) = ((x + 1).min(self.width - 1), (y + 1).min(self.height - 1));
        let value = |x: usize, y: usize| f64::from(self.values[y * self.width + x]);
        let upper = value(x, y) * (1.0 - u) + value(right, y) * u;
        let lower = value(x, below) * (1.0 - u) + value(right, below) * u;
        upper * (1.0 - v) + lower * v
    }

    /// The same at half the width and height, each pixel the mean of four.
    fn halved(&self) -> Gray {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let value = |x: usize, y: usize| self.values[y.min(self.height - 1) * self.width + x.min(self.width - 1)];
        let mean = |i: usize| {
            let (x, y) = (2 * (i % width), 2 * (i / width));
            0.25 * (value(x, y) + value(x + 1, y) + value(x, y + 1) + value(x + 1, y + 1))
        };
        Gray {
            width,
            height,
            values: (0..width * height).map(mean).collect(),
        }
    }
}

/// Grey values at falling sizes, the first whole.
pub(super) struct Pyramid(Vec<Gray>);

impl Pyramid {
    /// Of colours, row by row.
    pub(super) fn of(rgb: &[[f32; 3]], width: u32) -> Pyramid {
        let luma = |[r, g, b]: &[f32; 3]| 0.299 * r + 0.587 * g + 0.114 * b;
        let width = width as usize;
        let mut levels = vec![Gray {
            width,
            height: rgb.len() / width.max(1),
            values: rgb.iter().map(luma).collect(),
        }];
        for level in 1..LEVELS {
            levels.push(levels[level - 1].halved());
        }
        Pyramid(levels)
    }
}

/// Displacement of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Displacement {
    /// From the rendering to the photograph, pixels.
    pub(super) pixels: DVec2,
    /// Square root of its information, 1/pixels: the length of its product with an error is in standard deviations.
    pub(super) whitening: DMat2,
}

/// A rendering's window at a level: values less their mean, and slopes.
struct Template {
    values: Vec<f64>,
    slopes: Vec<DVec2>,
    /// Σ slope slopeᵀ.
    moments: DMat2,
}

/// Places of a window's pixels from its middle.
fn offsets() -> impl Iterator<Item = DVec2> {
    let side = 2 * RADIUS + 1;
    (0..side * side).map(move |i| DVec2::new((i % side - RADIUS).into(), (i / side - RADIUS).into()))
}

/// Values less their mean.
fn centred(mut values: Vec<f64>) -> Vec<f64> {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    values.iter_mut().for_each(|value| *value -= mean);
    values
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Template {
    fn new(gray: &Gray, at: DVec2) -> Template {
        let slope = |offset: DVec2| {
            let along = |axis: DVec2| 0.5 * (gray.at(at + offset + axis) - gray.at(at + offset - axis));
            DVec2::new(along(DVec2::X), along(DVec2::Y))
        };
        let slopes: Vec<DVec2> = offsets().map(slope).collect();
        let outer = |s: &DVec2| DMat2::from_cols(*s * s.x, *s * s.y);
        Template {
            values: centred(offsets().map(|offset| gray.at(at + offset)).collect()),
            moments: slopes.iter().map(outer).fold(DMat2::ZERO, |sum, m| sum + m),
            slopes,
        }
    }

    /// Differences of the photograph's window from the template, at the gain that fits best.
    fn compare(&self, gray: &Gray, at: DVec2) -> Comparison {
        let window = centred(offsets().map(|offset| gray.at(at + offset)).collect());
        let (square, product) = (dot(&window, &window), dot(&window, &self.values));
        let gain = product / square;
        Comparison {
            differences: window.iter().zip(&self.values).map(|(p, r)| gain * p - r).collect(),
            correlation: product / (square * dot(&self.values, &self.values)).sqrt(),
        }
    }

    /// Step of the photograph's window toward the template.
    fn step(&self, differences: &[f64]) -> DVec2 {
        let slopes = differences.iter().zip(&self.slopes).map(|(d, slope)| *d * *slope);
        -(self.moments.inverse() * slopes.sum::<DVec2>())
    }

    /// Standard deviation of the values.
    fn contrast(&self) -> f64 {
        (dot(&self.values, &self.values) / self.values.len() as f64).sqrt()
    }
}

/// Photograph's window beside a template.
struct Comparison {
    differences: Vec<f64>,
    correlation: f64,
}

/// Displacement of the photograph about a place of the rendering; `None` where windows do not match.
pub(super) fn displacement(rendering: &Pyramid, photo: &Pyramid, place: DVec2) -> Option<Displacement> {
    let mut moved = DVec2::ZERO;
    for level in (0..LEVELS).rev() {
        let scale = 0.5_f64.powi(level as i32);
        let template = Template::new(&rendering.0[level], place * scale);
        for _ in 0..ITERATIONS {
            let comparison = template.compare(&photo.0[level], (place + moved) * scale);
            let step = template.step(&comparison.differences).clamp_length_max(STEP_MAX);
            if !step.is_finite() {
                return None;
            }
            moved += step / scale;
            if step.length() < STEP_MIN {
                break;
            }
        }
    }
    let template = Template::new(&rendering.0[0], place);
    let comparison = template.compare(&photo.0[0], place + moved);
    let is_match = comparison.correlation >= CORRELATION_MIN && template.contrast() >= CONTRAST_MIN;
    let variance = dot(&comparison.differences, &comparison.differences) / comparison.differences.len() as f64;
    let whitening = whitening(template.moments.inverse() * variance);
    let is_finite = whitening.is_finite() && moved.is_finite();
    (is_match && is_finite).then_some(Displacement {
        pixels: moved,
        whitening,
    })
}

/// Cholesky's factor of the information, of a covariance and [`FLOOR`].
fn whitening(covariance: DMat2) -> DMat2 {
    let information = (covariance + DMat2::from_diagonal(DVec2::splat(FLOOR * FLOOR))).inverse();
    let a = information.x_axis.x.sqrt();
    let b = information.x_axis.y / a;
    let c = (information.y_axis.y - b * b).sqrt();
    DMat2::from_cols(DVec2::new(a, 0.0), DVec2::new(b, c))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: u32 = 80;

    /// Waves, displaced by so many pixels.
    fn waves(displacement: DVec2, gain: f32, offset: f32) -> Pyramid {
        let value = |i: u32| {
            let at = DVec2::new(f64::from(i % SIZE), f64::from(i / SIZE)) - displacement;
            let value = (0.31 * at.x).sin() * (0.23 * at.y + 1.0).cos() + 0.5 * (0.17 * (at.x + at.y)).sin();
            [gain * (0.5 + 0.2 * value as f32) + offset; 3]
        };
        Pyramid::of(&(0..SIZE * SIZE).map(value).collect::<Vec<_>>(), SIZE)
    }

    #[test]
    fn displacements_are_found_in_other_exposures_too() {
        let rendering = waves(DVec2::ZERO, 1.0, 0.0);
        for wanted in [DVec2::new(0.3, -0.2), DVec2::new(-2.6, 1.7), DVec2::new(4.0, 5.0)] {
            let photo = waves(wanted, 0.6, 0.1);
            let found = displacement(&rendering, &photo, DVec2::new(37.0, 41.5)).unwrap();
            assert!(found.pixels.distance(wanted) < 0.02, "{found:?}, {wanted} wanted");
        }
    }

    #[test]
    fn other_pictures_and_grey_ones_do_not_match() {
        let rendering = waves(DVec2::ZERO, 1.0, 0.0);
        let noise = |i: u32| [((7.7 * f64::from(i)).sin() * 4e4).fract().abs() as f32; 3];
        let noise = Pyramid::of(&(0..SIZE * SIZE).map(noise).collect::<Vec<_>>(), SIZE);
        let place = DVec2::new(40.0, 40.0);
        assert_eq!(displacement(&rendering, &noise, place), None);
        let grey = waves(DVec2::ZERO, 0.0, 0.5);
        assert_eq!(displacement(&grey, &grey, place), None);
    }

    #[test]
    fn whitened_errors_are_standard_deviations() {
        let covariance = DMat2::from_cols(DVec2::new(0.09, 0.02), DVec2::new(0.02, 0.04));
        let factor = whitening(covariance);
        let all = covariance + DMat2::from_diagonal(DVec2::splat(FLOOR * FLOOR));
        let product = factor * all * factor.transpose();
        assert!(product.abs_diff_eq(DMat2::IDENTITY, 1e-12), "{product}");
    }
}
