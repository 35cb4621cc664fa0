//! Scenes rounded for files: as few bytes as the picture needs.
//!
//! A format rounds every number by itself. A picture depends on sums of them: a splat's colour in a direction is a sum
//! of harmonics, its light a product of opacity and scales. [`round_harmonics`] chooses harmonics of the format's grid
//! together, so that colours are right in the directions of the views; the format's own rounding then leaves them as
//! they are, and any reader decodes them.
//!
//! [`Influence`] holds the weights of splats in views, [`Pictures`] the views in which a rounded scene is compared with
//! its original, and [`Ladder`] finds the cheapest setting of a format within a loss or a number of bytes.

mod choose;
mod geometry;
mod harmonics;
mod influence;
mod pictures;
mod sensitivity;
mod setting;

pub use choose::{Budget, EncodedScene, ExportSource, Ladder, Measurement};
pub use geometry::round_light;
pub use harmonics::{HarmonicGrid, round_harmonics};
pub use influence::Influence;
pub use pictures::{PictureError, Pictures};
pub use setting::{ExportFormat, Setting};
