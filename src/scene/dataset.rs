//! A data set: views with cameras and photographs, and a sparse point set.

use super::{Camera, Optics, Vignetting};
use glam::{DVec2, DVec3};
use std::path::PathBuf;

/// A coloured point of the sparse reconstruction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// World position; in double precision, as reconstructions of the Earth's surface need it.
    pub position: [f64; 3],
    /// Colour, 0 to 1 (as stored in the photographs, not linearised).
    pub color: [f32; 3],
}

impl Point {
    /// True if position and colour are finite.
    pub fn is_finite(&self) -> bool {
        self.position.iter().all(|v| v.is_finite()) && self.color.iter().all(|v| v.is_finite())
    }
}

/// Subset of a data set's views.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Split {
    /// Views trained on.
    Train,
    /// Views held out.
    Test,
    /// Both.
    All,
}

/// Meaning of a photograph's alpha channel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AlphaMode {
    /// The photograph is composited over the background colour (Blender scenes).
    #[default]
    Composite,
    /// Pixels count in the loss in proportion to alpha.
    Mask,
}

/// A decoded photograph: 8-bit RGBA rows from the top, as stored (display-referred, not linearised).
#[derive(Clone, Debug, PartialEq)]
pub struct Photo {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// `[row][column]` RGBA, alpha 255 if the file has none.
    pub rgba: Vec<[u8; 4]>,
}

impl Photo {
    /// Mean colour of the 3 × 3 pixels about a place in pixels, 0 to 1; `None` beyond the border, or if alpha makes one
    /// background or ignored.
    pub fn patch(&self, pixel: DVec2) -> Option<[f64; 3]> {
        let (column, row) = (pixel.x.floor() as i64, pixel.y.floor() as i64);
        let (width, height) = (i64::from(self.width), i64::from(self.height));
        if !(1..width - 1).contains(&column) || !(1..height - 1).contains(&row) {
            return None;
        }
        let mut sum = [0.0; 3];
        for (dy, dx) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dy, dx))) {
            let [r, g, b, alpha] = self.rgba[((row + dy) * width + column + dx) as usize];
            if alpha < 255 {
                return None;
            }
            let sums = sum.iter_mut().zip([r, g, b]);
            sums.for_each(|(sum, value)| *sum += f64::from(value));
        }
        Some(sum.map(|sum| sum / (9.0 * 255.0)))
    }

    /// The 8-bit level of a colour value of 0 to 1: rounded half up, not truncated, so that levels are unbiased. Values
    /// below 0 and NaN become 0, values above 1 become 255.
    pub fn level(value: f32) -> u8 {
        (value.clamp(0.0, 1.0) * 255.0).round() as u8
    }

    /// An opaque photograph of `width * height` colours, rows from the top.
    pub fn from_rgb(width: u32, height: u32, rgb: &[[f32; 3]]) -> Photo {
        assert_eq!(rgb.len(), width as usize * height as usize);
        let opaque = |c: &[f32; 3]| {
            let [r, g, b] = c.map(Photo::level);
            [r, g, b, 255]
        };
        Photo {
            width,
            height,
            rgba: rgb.iter().map(opaque).collect(),
        }
    }
}

/// Mask of a photograph: white keeps a pixel, black leaves it out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MaskFile {
    /// The image file.
    pub path: PathBuf,
    /// Black keeps.
    pub inverted: bool,
}

/// Source of a photograph.
#[derive(Clone, Debug, PartialEq)]
pub enum PhotoSource {
    /// A file, to be decoded, masked, turned, seen as a pinhole, resized to the view's camera, and freed from
    /// vignetting when it is needed.
    File {
        /// The image file.
        path: PathBuf,
        /// Lens of the photograph, and the pinhole picture wanted of it; `None`: a pinhole took it.
        optics: Option<Box<Optics>>,
        /// Orientation in EXIF data that the camera asks for, 5 to 8; others: the pixels as they are stored.
        orientation: u8,
        /// Mask of the stored pixels, if any.
        mask: Option<MaskFile>,
        /// Vignetting to remove, if any.
        vignetting: Option<Vignetting>,
    },
    /// Already decoded, at the size of the view's camera.
    Memory(Photo),
    /// No photograph: a camera path, for rendering only.
    Absent,
}

/// One camera with its photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Name of the photograph in the data set; views are sorted by it (byte order).
    pub name: String,
    /// The (undistorted, possibly downscaled) camera.
    pub camera: Camera,
    /// The photograph.
    pub photo: PhotoSource,
}

impl View {
    /// Whether it is a side of a photograph that was split, and not the whole.
    pub fn is_side(&self) -> bool {
        match &self.photo {
            PhotoSource::File { optics, .. } => optics.as_ref().is_some_and(|optics| optics.is_side()),
            PhotoSource::Memory(_) | PhotoSource::Absent => false,
        }
    }
}

/// Views sorted by name, and points.
#[derive(Clone, Debug, Default)]
pub struct Dataset {
    /// Sorted by name.
    pub views: Vec<View>,
    /// The sparse reconstruction, possibly empty.
    pub points: Vec<Point>,
    /// Indices of the points that each view sees, ascending; empty if the reconstruction does not tell, as in
    /// `transforms.json`.
    pub tracks: Vec<Vec<u32>>,
    /// Every `test_every`-th view, from the first, is a test view; 0: none is.
    pub test_every: usize,
    /// Indices of the test views named by the data set itself (Blender's `transforms_test.json`), ascending;
    /// `test_every` is then not used.
    pub held_out: Vec<usize>,
    /// Meaning of the photographs' alpha channels.
    pub alpha: AlphaMode,
    /// Repairs and omissions on loading, one sentence each.
    pub warnings: Vec<String>,
    /// Origin of all positions, in the coordinates of the files: zero, unless cameras are so far off that single
    /// precision would be too coarse for splats ([`Dataset::distant_origin`]).
    pub origin: DVec3,
}

/// Distance of cameras from the origin, in scene extents, beyond which positions in single precision are too coarse:
/// steps of 2⁻²⁴ of it are 6e-6 extents, several times a late step of training, and thousandths of a pixel.
const DISTANT_EXTENTS: f64 = 100.0;

impl Dataset {
    /// A new origin if the cameras are too far from that of the files: a round number near their mean.
    pub fn distant_origin(&self) -> Option<DVec3> {
        let sum: DVec3 = self.views.iter().map(|v| v.camera.position).sum();
        let mean = sum / self.views.len().max(1) as f64;
        let extent = self.extent();
        // A power of two, so that neither rounding nor the difference loses a bit.
        let unit = extent.log2().floor().exp2();
        let is_distant = mean.length() > DISTANT_EXTENTS * extent;
        is_distant.then(|| self.origin + (mean / unit).round() * unit)
    }

    /// Moves the origin of all positions to `origin`, given in the coordinates of the files.
    pub fn set_origin(&mut self, origin: DVec3) {
        let by = self.origin - origin;
        for view in &mut self.views {
            view.camera.position += by;
        }
        for point in &mut self.points {
            point.position = (DVec3::from(point.position) + by).to_array();
        }
        self.origin = origin;
    }

    /// Replaces the points; which views see them is then not known.
    pub fn set_points(&mut self, points: Vec<Point>) {
        self.points = points;
        self.tracks.clear();
    }

    /// True if view `index` is held out.
    pub fn is_test(&self, index: usize) -> bool {
        if self.held_out.is_empty() {
            self.test_every > 0 && index.is_multiple_of(self.test_every)
        } else {
            self.held_out.binary_search(&index).is_ok()
        }
    }

    /// Extent of the scene in world units, for step sizes and the near plane: 1.1 times the largest distance of a
    /// training camera from their mean (3DGS, `getNerfppNorm`). If all cameras stand in one place it is 1.1 times the
    /// median distance of the points from there, and 1 if there are no points either.
    pub fn extent(&self) -> f64 {
        let centers: Vec<DVec3> = self
            .split(Split::Train)
            .into_iter()
            .map(|i| self.views[i].camera.position)
            .collect();
        if centers.is_empty() {
            return 1.0;
        }
        let mean = centers.iter().sum::<DVec3>() / centers.len() as f64;
        let radius = centers.iter().map(|c| c.distance(mean)).fold(0.0, f64::max);
        // Rounding of the mean leaves a little distance between equal centres.
        if radius > 1e-9 * (1.0 + mean.length()) {
            return 1.1 * radius;
        }
        let mut distances: Vec<f64> = self
            .points
            .iter()
            .map(|p| DVec3::from(p.position).distance(mean))
            .filter(|d| *d > 0.0 && d.is_finite())
            .collect();
        if distances.is_empty() {
            return 1.0;
        }
        let middle = distances.len() / 2;
        1.1 * *distances.select_nth_unstable_by(middle, f64::total_cmp).1
    }

    /// Median number of training views whose image holds a point, over at most 10,000 points; the number of training
    /// views if there are no points.
    pub fn views_per_point(&self) -> f64 {
        let cameras: Vec<&Camera> = self
            .split(Split::Train)
            .iter()
            .map(|&view| &self.views[view].camera)
            .collect();
        let step = self.points.len().div_ceil(10_000).max(1);
        let seen_by = |point: &Point| {
            let position = DVec3::from(point.position);
            cameras.iter().filter(|camera| camera.sees(position)).count()
        };
        let mut counts: Vec<usize> = self.points.iter().step_by(step).map(seen_by).collect();
        if counts.is_empty() {
            return cameras.len() as f64;
        }
        let middle = counts.len() / 2;
        *counts.select_nth_unstable(middle).1 as f64
    }

    /// Mean number of pixels of a training view; 0 without any.
    pub fn mean_pixels(&self) -> f64 {
        let views = self.split(Split::Train);
        let pixels = |&view: &usize| {
            let Camera { width, height, .. } = self.views[view].camera;
            f64::from(width) * f64::from(height)
        };
        views.iter().map(pixels).sum::<f64>() / views.len().max(1) as f64
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

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec2};

    /// A view from a place on the x axis, 1 wide and high at a distance of 1.
    fn view(x: f64) -> View {
        let camera = Camera {
            width: 10,
            height: 10,
            focal: DVec2::splat(10.0),
            center: DVec2::splat(5.0),
            rotation: DMat3::IDENTITY,
            position: DVec3::new(x, 0.0, 0.0),
        };
        View {
            name: format!("{x}"),
            camera,
            photo: PhotoSource::Memory(Photo::from_rgb(1, 1, &[[0.0; 3]])),
        }
    }

    #[test]
    fn mean_pixels_are_those_of_training_views() {
        let mut dataset = Dataset {
            views: [0.0, 0.1, 0.2].map(view).to_vec(),
            test_every: 2,
            ..Dataset::default()
        };
        // Views 0 and 2 are held out.
        dataset.views[1].camera.width = 30;
        assert_eq!(dataset.mean_pixels(), 300.0);
        assert_eq!(Dataset::default().mean_pixels(), 0.0);
    }

    #[test]
    fn the_median_point_tells_how_many_training_views_see_a_place() {
        let point = |x: f64| Point {
            position: [x, 0.0, 1.0],
            color: [0.0; 3],
        };
        let mut dataset = Dataset {
            views: [0.0, 0.1, 0.2, 5.0].map(view).to_vec(),
            test_every: 0,
            ..Dataset::default()
        };
        // No points: all views.
        assert_eq!(dataset.views_per_point(), 4.0);
        // Seen by three, by three and by one; the fourth lies behind all cameras.
        dataset.points = vec![point(0.0), point(0.1), point(5.0)];
        assert_eq!(dataset.views_per_point(), 3.0);
        dataset.points[0].position[2] = -1.0;
        assert_eq!(dataset.views_per_point(), 1.0);
        dataset.points.truncate(2);
        // Views that are held out do not count.
        dataset.test_every = 4;
        assert_eq!(dataset.views_per_point(), 2.0);
    }
}
