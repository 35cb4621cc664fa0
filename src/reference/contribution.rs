//! Contribution of each splat to a pixel: its share of the pixel's colour.

/// Contribution of a splat over some pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loss {
    /// Maximum over pixels of (weight + budget already spent); 0 if the splat has no weight anywhere.
    pub most: f64,
    /// Sum of the weights.
    pub sum: f64,
    /// Minimum limit of its pixels; infinite if the splat has no weight anywhere.
    pub limit: f64,
}

impl Loss {
    /// Contribution of a splat without weight.
    pub const NOTHING: Loss = Loss {
        most: 0.0,
        sum: 0.0,
        limit: f64::INFINITY,
    };

    /// Adds a pixel.
    pub fn and(self, weight: f64, spent: f64, limit: f64) -> Loss {
        Loss {
            most: self.most.max(spent + weight),
            sum: self.sum + weight,
            limit: self.limit.min(limit),
        }
    }
}
