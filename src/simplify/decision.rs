//! Record of the count controller's decisions, as reports show them.

use serde::{Deserialize, Serialize};

/// Use of photographs at half width and height.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HalfResolution {
    /// Iteration after which photographs have full size; 0: from the first on.
    pub until: u32,
    /// Highest PSNR of the held-out views that half resolution allows, decibels; `None`: no limit.
    pub limit_db: Option<f64>,
    /// Upper bound of the share of the mean squared error at that iteration that half resolution hides.
    pub hidden_share: Option<f64>,
}

/// Decision of the count controller, with the scene before it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Decision {
    /// Steps of training done.
    pub iteration: u32,
    /// Action in words.
    pub act: String,
    /// Splats before the action.
    pub splats: usize,
    /// Mean PSNR of the held-out views before the action, decibels.
    pub psnr_db: f64,
    /// Splats without the pruned or proposed ones, and the PSNR after equally many steps (at once if there were none).
    pub without: Option<(usize, f64)>,
    /// Estimated gain of a tenth more splats and its lower 95 % bound, decibels.
    pub gain_db: Option<[f64; 2]>,
}
