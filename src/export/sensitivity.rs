//! Effect of an attribute's errors on the pictures of a scene.

use super::influence::Influence;
use super::pictures::Pictures;
use crate::Result;
use crate::io::spz::CodeCosts;
use crate::scene::{Splats, logit, sigmoid};
use std::f64::consts::PI;

/// Mean squared error of the pictures for a mean of 1 of the splats' squared errors, weighted.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sensitivity {
    position: f64,
    rotation: f64,
    color: f64,
    opacity: f64,
}

/// Steps by which attributes are rounded to learn their effects, far above those of formats. Positions: of the mean of
/// the splat's two larger scales.
const POSITION_STEP: f32 = 1.0 / 8.0;
const ROTATION_STEP: f32 = 1.0 / 64.0;
const COLOR_STEP: f32 = 1.0 / 8.0;
const OPACITY_STEP: f32 = 1.0 / 32.0;

impl Sensitivity {
    /// Rounds one attribute after another and compares the pictures. `None` if they show nothing of the scene.
    ///
    /// # Errors
    /// Those of the device.
    pub(super) fn measure(
        splats: &Splats,
        influence: &Influence,
        pictures: &mut Pictures<'_>,
    ) -> Result<Option<Sensitivity>> {
        let mut effect = |change: &dyn Fn(&mut Splats, usize) -> f64| {
            let mut changed = splats.clone();
            let squares = (0..splats.len()).map(|i| influence.of(i) * change(&mut changed, i));
            let mean = squares.sum::<f64>() / splats.len() as f64;
            // Without any change there is none of the pictures.
            let error = pictures.error(&changed)?.mean_squared;
            Ok::<_, crate::Error>(error / mean.max(f64::MIN_POSITIVE))
        };
        let stride = splats.sh_stride();
        let found = Sensitivity {
            position: effect(&|s, i| {
                let shift = ShapeFactors::new(s.log_scale[i]).shift;
                round(&mut s.mean[i], POSITION_STEP / shift.sqrt() as f32) * shift
            })?,
            rotation: effect(&|s, i| {
                let q = &mut s.quaternion[i];
                let length = q.iter().map(|v| v * v).sum::<f32>().sqrt();
                q.iter_mut().for_each(|v| *v /= length.max(f32::MIN_POSITIVE));
                round(q, ROTATION_STEP) * ShapeFactors::new(s.log_scale[i]).turn
            })?,
            color: effect(&|s, i| round(&mut s.sh[i * stride..][..3], COLOR_STEP))?,
            opacity: effect(&|s, i| {
                let mut opacity = [sigmoid(s.opacity_logit[i].into()) as f32];
                let square = round(&mut opacity, OPACITY_STEP);
                s.opacity_logit[i] = logit(f64::from(opacity[0]).clamp(1e-6, 1.0 - 1e-6)) as f32;
                square
            })?,
        };
        Ok((found.color > 0.0).then_some(found))
    }

    /// Costs of a splat of this weight and log-scales, in the unit of [`round_harmonics`](super::round_harmonics), in
    /// which a harmonic of degree 0 has 1/2π.
    pub(super) fn costs(&self, weight: f64, log_scale: [f32; 3], bit: f64) -> CodeCosts {
        let shape = ShapeFactors::new(log_scale);
        let relative = |effect: f64| weight * effect / self.color / (2.0 * PI);
        CodeCosts {
            position: relative(self.position) * shape.shift,
            rotation: relative(self.rotation) * shape.turn,
            color: relative(self.color),
            opacity: relative(self.opacity),
            bit,
        }
    }
}

/// Effects of a splat's errors by its two larger scales.
struct ShapeFactors {
    /// Of a shift: in units of the splat's extent.
    shift: f64,
    /// Of a turn: more for needles.
    turn: f64,
}

/// Largest magnitude of a log-scale that counts: flat splats have one of −∞.
const LOG_SCALE_MAX: f64 = 20.0;

impl ShapeFactors {
    fn new(log_scale: [f32; 3]) -> ShapeFactors {
        let mut sorted = log_scale.map(|v| f64::from(v).clamp(-LOG_SCALE_MAX, LOG_SCALE_MAX));
        sorted.sort_by(f64::total_cmp);
        let [_, middle, largest] = sorted;
        ShapeFactors {
            shift: (-middle - largest).exp(),
            turn: (largest - middle).exp(),
        }
    }
}

/// Rounds values to multiples of a step; the sum of the squared errors.
fn round(values: &mut [f32], step: f32) -> f64 {
    let errors = values.iter_mut().map(|value| {
        let old = *value;
        *value = (old / step).round() * step;
        f64::from(*value - old).powi(2)
    });
    errors.sum()
}
