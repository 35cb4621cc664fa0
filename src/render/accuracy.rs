//! Thresholds of compositing that save work at an error bounded beforehand.
//!
//! With C = Σ cᵢ αᵢ Tᵢ + T_end · background, omitting a set S of contributions changes a pixel by at most Σ_S αᵢ Tᵢ
//! times its colour range, with the weights of the full picture: removed from the back, each replaces αᵢ Tᵢ of its
//! colour by a mixture of those behind it.

use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// Thresholds of compositing. The default is that of drawing and training.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Accuracy {
    /// Transmittance below which a pixel is finished: 1e-4 (3DGS). The splat that brings it below still counts, so that
    /// the error is at most this share of the colour range.
    pub transmittance_min: f32,
    /// Smallest alpha composited: 1/255 (3DGS). The error is at most Σ α T of the omitted contributions, times the
    /// colour range.
    pub alpha_min: f32,
}

impl Default for Accuracy {
    fn default() -> Accuracy {
        Accuracy {
            transmittance_min: 1e-4,
            alpha_min: 1.0 / 255.0,
        }
    }
}

impl Accuracy {
    /// Checks the ranges of the thresholds.
    ///
    /// # Errors
    /// [`Error::Config`] with the name of the first field out of range.
    pub fn validate(&self) -> Result<()> {
        for (name, value, least, most) in [
            ("transmittance_min", self.transmittance_min, 1e-9, 0.5),
            ("alpha_min", self.alpha_min, 1e-6, 0.5),
        ] {
            if !(least..=most).contains(&value) {
                return Err(Error::Config(format!(
                    "accuracy.{name} is {value}, but must be from {least} to {most}"
                )));
            }
        }
        Ok(())
    }

    /// The constant `LOG2_ALPHA_MIN` of the kernels.
    pub(crate) fn log2_alpha_min(&self) -> f32 {
        f64::from(self.alpha_min).log2() as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::{expand, project, rasterize, rasterize_backward};

    #[test]
    fn the_default_changes_no_kernel() {
        let same = Accuracy::default();
        let log2_alpha_min = [
            project::Spec::default().log2_alpha_min,
            expand::Spec::default().log2_alpha_min,
            rasterize::Spec::default().log2_alpha_min,
            rasterize_backward::Spec::default().log2_alpha_min,
        ];
        assert_eq!([same.log2_alpha_min(); 4], log2_alpha_min);
        assert_eq!(same.transmittance_min, rasterize::Spec::default().t_min);
    }

    #[test]
    fn what_cannot_be_drawn_by_is_refused_by_name() {
        let message = |change: fn(&mut Accuracy)| {
            let mut accuracy = Accuracy::default();
            change(&mut accuracy);
            accuracy.validate().map_err(|error| error.to_string())
        };
        assert_eq!(message(|_| {}), Ok(()));
        assert_eq!(
            message(|a| a.alpha_min = 0.0),
            Err("accuracy.alpha_min is 0, but must be from 0.000001 to 0.5".into())
        );
        assert!(message(|a| a.transmittance_min = f32::NAN).is_err());
    }
}
