//! A data set: views with cameras and photographs, and a sparse point set.

use super::Camera;
use std::path::PathBuf;

/// A coloured point of the sparse reconstruction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// World position.
    pub position: [f32; 3],
    /// Colour, 0 to 1 (as stored in the photographs, not linearised).
    pub color: [f32; 3],
}

/// Which views of a data set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Split {
    /// Views trained on.
    Train,
    /// Views held out.
    Test,
    /// Both.
    All,
}

/// What the alpha channel of a photograph means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AlphaMode {
    /// The photograph is composited over the background colour (Blender scenes).
    #[default]
    Composite,
    /// Pixels count in the loss in proportion to alpha.
    Mask,
}

/// Lens distortion of a photograph, OpenCV's radial–tangential model.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distortion {
    /// Radial, second order.
    pub k1: f64,
    /// Radial, fourth order.
    pub k2: f64,
    /// Tangential.
    pub p1: f64,
    /// Tangential.
    pub p2: f64,
}

/// A decoded photograph: 8-bit RGBA rows from the top, as stored (display-referred, not linearised).
#[derive(Clone, Debug, PartialEq)]
pub struct Photo {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// `[row][column]` RGBA, alpha 255 where the file has none.
    pub rgba: Vec<[u8; 4]>,
}

/// Where a photograph comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum PhotoSource {
    /// A file, to be decoded, undistorted and resized to the view's camera when it is needed.
    File {
        /// The image file.
        path: PathBuf,
        /// The distorted camera at the file's own size, where it differs from a plain resize of the
        /// view's camera.
        distortion: Option<Distortion>,
    },
    /// Already decoded, at the size of the view's camera.
    Memory(Photo),
    /// None: a camera path, fit for rendering only.
    Absent,
}

/// One camera with its photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// The photograph's name as the data set has it; views are sorted by it (byte order).
    pub name: String,
    /// The (undistorted, possibly downscaled) camera.
    pub camera: Camera,
    /// The photograph.
    pub photo: PhotoSource,
}

/// Views sorted by name, and points.
#[derive(Clone, Debug, Default)]
pub struct Dataset {
    /// Sorted by name.
    pub views: Vec<View>,
    /// The sparse reconstruction, possibly empty.
    pub points: Vec<Point>,
    /// Every `test_every`-th view, from the first, is a test view; 0: none is.
    pub test_every: usize,
    /// What was repaired or left out on loading, one sentence each.
    pub warnings: Vec<String>,
}

impl Dataset {
    /// Whether view `index` is held out.
    pub fn is_test(&self, index: usize) -> bool {
        self.test_every > 0 && index.is_multiple_of(self.test_every)
    }

    /// Indices of the views of a split, ascending.
    pub fn split(&self, split: Split) -> Vec<usize> {
        (0..self.views.len())
            .filter(|&i| match split {
                Split::All => true,
                Split::Test => self.is_test(i),
                Split::Train => !self.is_test(i),
            })
            .collect()
    }
}
