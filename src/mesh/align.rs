//! Alignment of depths: those of each view are moved until its picture agrees with those of other views.

use super::depth_map::DepthMap;
use crate::Result;
use crate::scene::Camera;
use crate::stats::conjugate_gradients::{self, SymmetricSystem};
use crate::stats::quantile;
use glam::{DVec2, DVec3, Mat3A, UVec2, Vec2, Vec3A};
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_4, TAU};

/// Pixels between points of the lattice.
const CELL: u32 = 4;
/// Source views, with which a view is compared.
const SOURCES: usize = 8;
/// Angle at the surface from which on a view is compared, radians: the nearest ones from there, others if there are too
/// few. 10°.
const ANGLE_MIN: f64 = 0.174_533;
/// Largest angle, radians.
const ANGLE_MAX: f64 = FRAC_PI_4;
/// Iterations of Gauss-Newton.
const STEPS: usize = 5;
/// Noise of colours in medians of the difference between views.
const NOISE: f32 = 2.0;
/// Least noise, levels.
const NOISE_MIN: f32 = 0.5;
/// Pixels of a row of which one counts, along diagonals, and of which again one is asked for the noise. Points of the
/// lattice are as far apart.
const STRIDE: usize = 4;
/// Differences from which on a pixel loses weight, in units of the noise.
const OUTLIER: f32 = 3.0;
/// Expected difference between neighbouring points of the lattice, footprints of a pixel: with larger ones, depths
/// follow reflections too.
const ROUGHNESS: f64 = 0.1;
/// Expected movement, footprints of a pixel.
const MOVEMENT: f64 = 2.0;
/// Relative difference of depth between neighbouring pixels, and between points of the lattice, of one surface.
const STEP: f64 = 0.05;
/// Relative difference between the depths of a point by two views that both see it.
const APART: f32 = 0.03;
/// Least coverage of a surface, levels.
const COVERAGE_MIN: u8 = 250;
/// Iterations, and decrease of the squared residual, of a linear solution.
const SOLUTION: (usize, f64) = (200, 1e-6);

/// Relative changes of a view's depths, bilinear between the points of a lattice over its picture.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct DepthCorrection {
    lattice: Lattice,
    /// Change of depth as a share of it, by point.
    change: Vec<f32>,
}

impl DepthCorrection {
    /// Moves the depths of a map of the view, which may have another size.
    pub(super) fn apply(&self, map: &mut DepthMap) {
        let (width, camera) = (map.camera.width as usize, map.camera);
        for (pixel, depth) in map.depth.iter_mut().enumerate() {
            let shares = self.lattice.shares(&camera, pixel % width, pixel / width);
            let change: f64 = shares
                .iter()
                .map(|&(point, share)| share * f64::from(self.change[point]))
                .sum();
            *depth *= 1.0 + change as f32;
        }
    }
}

/// Corrections of all maps: by a smooth change of depth, the differences between the colours of a view's pixels and
/// those of the same points in its source views are least. Pixels on borders of surfaces do not count, since outlines
/// move with the view. Colours of splats are as consistent as the photographs are; their depths need not be, since
/// depths are not trained on.
///
/// `progress` is told each view, and may end the alignment with an error.
pub(super) fn align(maps: &[DepthMap], progress: impl Fn() -> Result<()> + Sync) -> Result<Vec<DepthCorrection>> {
    let surfaces: Vec<Vec<bool>> = maps.par_iter().map(surface).collect();
    let middles: Vec<Option<DVec3>> = maps.iter().map(middle).collect();
    let correct = |view: usize| {
        progress()?;
        let sources = middles[view].map_or(Vec::new(), |at| sources(maps, view, at));
        let source = |other: usize| SourceView::new(&maps[view].camera, &maps[other], &surfaces[other]);
        let alignment = ViewAlignment {
            map: &maps[view],
            pixels: pixels(&maps[view].camera, &surfaces[view]),
            sources: sources.into_iter().map(source).collect(),
            lattice: Lattice::over(&maps[view].camera),
        };
        Ok(alignment.correction())
    };
    (0..maps.len()).into_par_iter().map(correct).collect()
}

/// Point at the median depth along the ray through the middle of the picture.
fn middle(map: &DepthMap) -> Option<DVec3> {
    let mut depths: Vec<f64> = map.depth.iter().filter(|d| !d.is_nan()).map(|&d| d.into()).collect();
    let size = DVec2::new(map.camera.width.into(), map.camera.height.into());
    let depth = quantile(&mut depths, 0.5)?;
    Some(map.camera.position + map.camera.ray_from_pixel(0.5 * size) * depth)
}

/// Source views of a view, by their angles at a point in sight.
fn sources(maps: &[DepthMap], view: usize, at: DVec3) -> Vec<usize> {
    let own = maps[view].camera.position - at;
    let angle = |other: usize| {
        let camera = &maps[other].camera;
        let angle = own.angle_between(camera.position - at);
        let counts = other != view && camera.sees(at) && angle <= ANGLE_MAX;
        // After the others, the largest first.
        let place = if angle < ANGLE_MIN { TAU - angle } else { angle };
        counts.then_some((place, other))
    };
    let mut places: Vec<(f64, usize)> = (0..maps.len()).filter_map(angle).collect();
    places.sort_by(|a, b| a.0.total_cmp(&b.0));
    places.into_iter().take(SOURCES).map(|(_, other)| other).collect()
}

/// Whether a pixel and its eight neighbours are covered and of one surface, by pixel.
fn surface(map: &DepthMap) -> Vec<bool> {
    let (width, height) = (map.camera.width as usize, map.camera.height as usize);
    let covers = |pixel: usize, of: f32| {
        let ratio = f64::from(map.depth[pixel] / of);
        map.color[pixel][3] >= COVERAGE_MIN && (ratio - 1.0).abs() <= STEP
    };
    let inside = |pixel: usize| {
        let (x, y) = (pixel % width, pixel / width);
        let is_border = x == 0 || y == 0 || x + 1 == width || y + 1 == height;
        let mut around = [-1, 0, 1].into_iter().flat_map(|dy| [-1, 0, 1].map(|dx| (dx, dy)));
        !is_border
            && around.all(|(dx, dy)| {
                let there = y.wrapping_add_signed(dy) * width + x.wrapping_add_signed(dx);
                covers(there, map.depth[pixel])
            })
    };
    (0..width * height).map(inside).collect()
}

/// Pixels of a view that count.
fn pixels(camera: &Camera, surface: &[bool]) -> Vec<usize> {
    let width = camera.width as usize;
    let is_on_diagonal = |pixel: &usize| (pixel % width + pixel / width).is_multiple_of(STRIDE);
    let pixels = (0..surface.len()).filter(is_on_diagonal);
    pixels.filter(|&pixel| surface[pixel]).collect()
}

/// Points over a picture, four around each pixel, at the same rays for all sizes of the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Lattice {
    columns: usize,
    rows: usize,
    /// Points in a focal length.
    density: DVec2,
}

impl Lattice {
    fn over(camera: &Camera) -> Lattice {
        // A column and a row more for the rest of a larger picture.
        let points = |pixels: u32| pixels.div_ceil(CELL) as usize + 2;
        Lattice {
            columns: points(camera.width),
            rows: points(camera.height),
            density: camera.focal / f64::from(CELL),
        }
    }

    /// Points around a pixel, and their shares in it.
    fn shares(&self, camera: &Camera, x: usize, y: usize) -> [(usize, f64); 4] {
        let place = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) / camera.focal * self.density;
        let first = place.y as usize * self.columns + place.x as usize;
        let (across, down) = (place.x.fract(), place.y.fract());
        [
            (first, (1.0 - across) * (1.0 - down)),
            (first + 1, across * (1.0 - down)),
            (first + self.columns, (1.0 - across) * down),
            (first + self.columns + 1, across * down),
        ]
    }
}

/// Source view of multi-view stereo: another view, in the coordinates of the view to be aligned.
struct SourceView<'a> {
    map: &'a DepthMap,
    surface: &'a [bool],
    focal: Vec2,
    center: Vec2,
    /// View coordinates of a point at a depth along a ray: `rotation * ray * depth + offset`.
    rotation: Mat3A,
    offset: Vec3A,
}

/// A point in a source view.
struct Correspondence {
    /// Own colour less that of the source view, levels.
    difference: Vec3A,
    /// Derivative of the source view's colour by the logarithm of the depth, levels.
    slope: Vec3A,
}

impl<'a> SourceView<'a> {
    fn new(own: &Camera, map: &'a DepthMap, surface: &'a [bool]) -> SourceView<'a> {
        let camera = &map.camera;
        SourceView {
            map,
            surface,
            focal: camera.focal.as_vec2(),
            center: camera.center.as_vec2(),
            rotation: (camera.rotation * own.rotation.transpose()).as_mat3().into(),
            offset: camera.view_from_world(own.position).as_vec3a(),
        }
    }

    /// The point of a colour at a depth along a ray of the own view, if it is on a surface here.
    fn find(&self, ray: Vec3A, depth: f32, own: Vec3A) -> Option<Correspondence> {
        let along = self.rotation * ray * depth;
        let at = along + self.offset;
        let slope = Vec2::new(at.x, at.y) / at.z;
        let pixel = self.focal * slope + self.center;
        let size = UVec2::new(self.map.camera.width, self.map.camera.height).as_vec2();
        // Written so that NaN fails.
        if !(at.z > 0.0 && pixel.cmpge(Vec2::ZERO).all() && pixel.cmplt(size).all()) {
            return None;
        }
        let index = pixel.y as usize * self.map.camera.width as usize + pixel.x as usize;
        let apart = self.map.depth[index] / at.z - 1.0;
        if !self.surface[index] || apart.abs() > APART {
            return None;
        }
        let (color, across, down) = self.sample(pixel);
        let motion = self.focal * (Vec2::new(along.x, along.y) - slope * along.z) / at.z;
        Some(Correspondence {
            difference: own - color,
            slope: across * motion.x + down * motion.y,
        })
    }

    /// Bilinear colour at a place with pixels on all sides, and its derivatives along both axes; levels.
    fn sample(&self, pixel: Vec2) -> (Vec3A, Vec3A, Vec3A) {
        let place = pixel - 0.5;
        let width = self.map.camera.width as usize;
        let (column, row) = (place.x as usize, place.y as usize);
        let share = place - Vec2::new(column as f32, row as f32);
        let first = row * width + column;
        let [a, b, c, d] = [first, first + 1, first + width, first + width + 1].map(|pixel| levels(self.map, pixel));
        let (top, bottom) = (a.lerp(b, share.x), c.lerp(d, share.x));
        (top.lerp(bottom, share.y), (b - a).lerp(d - c, share.y), bottom - top)
    }
}

/// Colour of a pixel, levels.
fn levels(map: &DepthMap, pixel: usize) -> Vec3A {
    let [red, green, blue, _] = map.color[pixel].map(f32::from);
    Vec3A::new(red, green, blue)
}

/// Place of a pixel in the lattice.
struct LatticePlace {
    /// Points around it, and their shares.
    shares: [(usize, f64); 4],
    /// Movement of its depth, footprints.
    moved: f64,
}

/// A view to be aligned, with its source views.
struct ViewAlignment<'a> {
    map: &'a DepthMap,
    /// Pixels that count.
    pixels: Vec<usize>,
    sources: Vec<SourceView<'a>>,
    lattice: Lattice,
}

impl ViewAlignment<'_> {
    fn correction(&self) -> DepthCorrection {
        let mut equations = LatticeEquations::new(self.map, self.lattice);
        // In footprints: the change of depth times the focal length.
        let mut movement = vec![0.0; equations.pixels.len()];
        for _ in 0..STEPS {
            let mut residual = equations.start(&movement);
            self.add_pixels(&mut equations, &mut residual, &movement);
            let mut step = vec![0.0; movement.len()];
            let (iterations, decrease) = SOLUTION;
            conjugate_gradients::improve(&equations, &mut step, residual, |energy| decrease * energy, iterations);
            movement.iter_mut().zip(&step).for_each(|(moved, step)| *moved += step);
        }
        DepthCorrection {
            lattice: self.lattice,
            change: movement.iter().map(|moved| (moved / self.focal()) as f32).collect(),
        }
    }

    fn focal(&self) -> f64 {
        self.map.camera.focal.max_element()
    }

    /// Adds what the pixels of the view ask for.
    fn add_pixels(&self, equations: &mut LatticeEquations, residual: &mut [f64], movement: &[f64]) {
        let noise = self.noise(movement);
        for &pixel in &self.pixels {
            let place = self.place(pixel, movement);
            let (mut curvature, mut slope) = (0.0, 0.0);
            for found in self.correspondences(pixel, place.moved) {
                let difference = found.difference / noise;
                let by_movement = found.slope / (noise * (self.focal() + place.moved) as f32);
                // Cauchy loss: pixels that differ for other reasons than depth count little. Each stands for a stride.
                let weight = STRIDE as f32 / (1.0 + difference.length_squared() / OUTLIER.powi(2));
                curvature += weight * by_movement.length_squared();
                slope += weight * by_movement.dot(difference);
            }
            for (point, share) in place.shares {
                equations.pixels[point] += share * f64::from(curvature);
                residual[point] += share * f64::from(slope);
            }
        }
    }

    /// Noise of colours, levels: by the median, since most differences are not those of wrong depths.
    fn noise(&self, movement: &[f64]) -> f32 {
        let pixels = self.pixels.iter().step_by(STRIDE);
        let found = pixels.flat_map(|&pixel| self.correspondences(pixel, self.place(pixel, movement).moved));
        let mut differences: Vec<f64> = found.map(|found| found.difference.length().into()).collect();
        quantile(&mut differences, 0.5).map_or(NOISE_MIN, |median| NOISE_MIN.max(NOISE * median as f32))
    }

    /// Place of a pixel, with its movement.
    fn place(&self, pixel: usize, movement: &[f64]) -> LatticePlace {
        let (camera, width) = (&self.map.camera, self.map.camera.width as usize);
        let shares = self.lattice.shares(camera, pixel % width, pixel / width);
        let moved = shares.iter().map(|&(point, share)| share * movement[point]).sum();
        LatticePlace { shares, moved }
    }

    /// A moved pixel in the source views that see it.
    fn correspondences(&self, pixel: usize, moved: f64) -> impl Iterator<Item = Correspondence> {
        let (camera, width) = (&self.map.camera, self.map.camera.width as usize);
        let place = DVec2::new((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
        let ray = ((place - camera.center) / camera.focal).extend(1.0).as_vec3a();
        let depth = self.map.depth[pixel] * (1.0 + moved / self.focal()) as f32;
        let color = levels(self.map, pixel);
        self.sources
            .iter()
            .filter_map(move |source| source.find(ray, depth, color))
    }
}

/// Normal equations of a lattice. The pixels' part is lumped, summed by rows to its diagonal: exact for even movements,
/// and steps are too short for uneven ones.
struct LatticeEquations {
    /// Weights of the pixels, by point.
    pixels: Vec<f64>,
    /// Neighbouring points of one surface.
    links: Vec<[usize; 2]>,
}

impl LatticeEquations {
    fn new(map: &DepthMap, lattice: Lattice) -> LatticeEquations {
        let inverse = inverse_depths(map, lattice);
        let points = inverse.len();
        let right = (0..points).filter(|point| (point + 1) % lattice.columns > 0);
        let below = 0..points - lattice.columns;
        let pairs = right.map(|a| [a, a + 1]).chain(below.map(|a| [a, a + lattice.columns]));
        LatticeEquations {
            pixels: vec![0.0; points],
            // Written so that NaN is no surface.
            links: pairs
                .filter(|&[a, b]| (inverse[a] / inverse[b] - 1.0).abs() <= STEP)
                .collect(),
        }
    }

    /// Forgets the pixels; the residual of the other terms.
    fn start(&mut self, movement: &[f64]) -> Vec<f64> {
        self.pixels.fill(0.0);
        self.product(movement).iter().map(|term| -term).collect()
    }

    /// Entries of the diagonal but for the links.
    fn own(&self) -> impl Iterator<Item = f64> {
        self.pixels.iter().map(|pixels| MOVEMENT.powi(-2) + pixels)
    }
}

/// Mean inverse depth around each point of a lattice; NaN without a surface.
fn inverse_depths(map: &DepthMap, lattice: Lattice) -> Vec<f64> {
    let width = map.camera.width as usize;
    let mut sums = vec![(0.0, 0.0); lattice.columns * lattice.rows];
    for (pixel, &depth) in map.depth.iter().enumerate().filter(|(_, depth)| !depth.is_nan()) {
        for (point, share) in lattice.shares(&map.camera, pixel % width, pixel / width) {
            sums[point].0 += share / f64::from(depth);
            sums[point].1 += share;
        }
    }
    sums.iter().map(|(sum, shares)| sum / shares).collect()
}

impl SymmetricSystem for LatticeEquations {
    fn product(&self, vector: &[f64]) -> Vec<f64> {
        let mut product: Vec<f64> = self.own().zip(vector).map(|(entry, x)| entry * x).collect();
        for &[a, b] in &self.links {
            let pull = (vector[a] - vector[b]) / ROUGHNESS.powi(2);
            product[a] += pull;
            product[b] -= pull;
        }
        product
    }

    fn precondition(&self, vector: &[f64]) -> Vec<f64> {
        let mut diagonal: Vec<f64> = self.own().collect();
        for &point in self.links.as_flattened() {
            diagonal[point] += ROUGHNESS.powi(-2);
        }
        vector.iter().zip(&diagonal).map(|(x, entry)| x / entry).collect()
    }
}
