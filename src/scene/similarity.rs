//! Similarity transforms: rotation, uniform scale, translation.

use crate::{Error, Result};
use glam::{DMat3, DMat4, DVec3};

/// Largest deviation of a rotation from orthonormality, as hosts compute with 32-bit floats.
const DEVIATION_MAX: f64 = 1e-5;

/// Similarity transform: x ↦ scale · rotation · x + translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// Rotation, orthonormal with determinant 1.
    pub rotation: DMat3,
    /// Uniform scale, positive.
    pub scale: f64,
    /// Translation in units of the result.
    pub translation: DVec3,
}

impl Default for Similarity {
    fn default() -> Similarity {
        Similarity::IDENTITY
    }
}

impl Similarity {
    /// Identity.
    pub const IDENTITY: Similarity = Similarity {
        rotation: DMat3::IDENTITY,
        scale: 1.0,
        translation: DVec3::ZERO,
    };

    /// Similarity of an affine matrix (columns as of GLSL).
    ///
    /// # Errors
    /// [`Error::Config`] for a matrix that is not finite, mirrors, shears, scales unevenly, or has a projective row.
    pub fn of_matrix(matrix: &DMat4) -> Result<Similarity> {
        let linear = DMat3::from_mat4(*matrix);
        let determinant = linear.determinant();
        let fault = match () {
            () if !matrix.is_finite() => Some("it is not finite"),
            () if matrix.row(3) != glam::DVec4::W => Some("its last row is not 0, 0, 0, 1"),
            () if determinant == 0.0 => Some("it is singular"),
            () if determinant < 0.0 => Some("it mirrors"),
            () => None,
        };
        if let Some(fault) = fault {
            return Err(refusal(fault));
        }
        let scale = determinant.cbrt();
        let similarity = Similarity {
            rotation: linear * scale.recip(),
            scale,
            translation: matrix.w_axis.truncate(),
        };
        similarity.check()?;
        Ok(similarity)
    }

    /// Checks the fields.
    ///
    /// # Errors
    /// [`Error::Config`] for a field that is not finite, a scale that is not positive, a matrix that is no rotation.
    pub fn check(&self) -> Result<()> {
        let Similarity {
            rotation,
            scale,
            translation,
        } = self;
        let deviation = *rotation * rotation.transpose() - DMat3::IDENTITY;
        let largest = deviation
            .to_cols_array()
            .into_iter()
            .fold(0.0, |m: f64, d| m.max(d.abs()));
        let fault = match () {
            () if !rotation.is_finite() || !scale.is_finite() || !translation.is_finite() => "it is not finite".into(),
            () if *scale <= 0.0 => format!("its scale is {scale}"),
            () if largest > DEVIATION_MAX => "it shears or scales unevenly".into(),
            () if rotation.determinant() < 0.0 => "it mirrors".into(),
            () => return Ok(()),
        };
        Err(refusal(&fault))
    }

    /// Image of a point.
    pub fn point(&self, point: DVec3) -> DVec3 {
        self.scale * (self.rotation * point) + self.translation
    }

    /// Preimage of a point.
    pub fn point_before(&self, point: DVec3) -> DVec3 {
        (self.rotation.transpose() * (point - self.translation)) / self.scale
    }

    /// The map of `first` and then this one.
    pub fn after(&self, first: &Similarity) -> Similarity {
        Similarity {
            rotation: self.rotation * first.rotation,
            scale: self.scale * first.scale,
            translation: self.point(first.translation),
        }
    }

    /// As an affine matrix.
    pub fn matrix(&self) -> DMat4 {
        let mut matrix = DMat4::from_mat3(self.rotation * self.scale);
        matrix.w_axis = self.translation.extend(1.0);
        matrix
    }
}

fn refusal(fault: &str) -> Error {
    Error::Config(format!("a transform that is no similarity: {fault}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec4};

    fn turned() -> Similarity {
        Similarity {
            rotation: DMat3::from_quat(DQuat::from_xyzw(0.1, -0.7, 0.3, 0.5).normalize()),
            scale: 2.5,
            translation: DVec3::new(1.0, -2.0, 0.5),
        }
    }

    #[test]
    fn matrices_and_points_agree() {
        let similarity = turned();
        let found = Similarity::of_matrix(&similarity.matrix()).unwrap();
        assert!((found.scale - 2.5).abs() < 1e-15, "{found:?}");
        let point = DVec3::new(0.3, 0.2, -4.0);
        let placed = similarity.point(point);
        assert!((similarity.matrix().transform_point3(point) - placed).length() < 1e-14);
        assert!((found.point(point) - placed).length() < 1e-14);
        assert!((found.point_before(placed) - point).length() < 1e-14);
        assert_eq!(Similarity::of_matrix(&DMat4::IDENTITY).unwrap(), Similarity::IDENTITY);
        let other = Similarity {
            scale: 0.5,
            translation: DVec3::new(-3.0, 0.0, 7.0),
            ..similarity
        };
        let both = other.after(&similarity).point(point);
        assert!((both - other.point(placed)).length() < 1e-14, "{both}");
    }

    #[test]
    fn other_matrices_are_refused_by_name() {
        let refused = |matrix: DMat4| Similarity::of_matrix(&matrix).unwrap_err().to_string();
        let scaled = |x, y, z| turned().matrix() * DMat4::from_scale(DVec3::new(x, y, z));
        assert!(refused(scaled(-1.0, 1.0, 1.0)).contains("mirrors"));
        assert!(refused(scaled(-1.0, -1.0, -1.0)).contains("mirrors"));
        assert!(refused(scaled(1.0, 1.001, 1.0)).contains("unevenly"));
        assert!(refused(scaled(0.0, 1.0, 1.0)).contains("singular"));
        assert!(refused(DMat4::IDENTITY * f64::NAN).contains("not finite"));
        let mut sheared = DMat4::IDENTITY;
        sheared.y_axis.x = 0.25;
        assert!(refused(sheared).contains("shears"));
        let mut projective = DMat4::IDENTITY;
        projective.x_axis = DVec4::new(1.0, 0.0, 0.0, 0.5);
        assert!(refused(projective).contains("last row"));
        let refused = |similarity: Similarity| similarity.check().unwrap_err().to_string();
        assert!(
            refused(Similarity {
                scale: -1.0,
                ..turned()
            })
            .contains("scale is -1")
        );
        let flipped = Similarity {
            rotation: -turned().rotation,
            ..turned()
        };
        assert!(refused(flipped).contains("mirrors"));
        let lost = Similarity {
            translation: DVec3::INFINITY,
            ..turned()
        };
        assert!(refused(lost).contains("not finite"));
    }
}
