//! A depth map laid out for sampling at the voxels of a volume.

use super::depth_map::DepthMap;
use glam::{DVec2, DVec3, Vec4};
use rayon::prelude::*;

/// Pixels along an edge of a tile.
const TILE: usize = 8;
/// Most pixels across of a box whose tiles are read: voxels of a wider one are fewer.
const WIDTH_MAX: f64 = 256.0;

/// A map's surface, and bounds of it.
pub(super) struct SurfaceSampler<'a> {
    pub(super) map: &'a DepthMap,
    width: usize,
    height: usize,
    /// Inverse depth and slope of each pixel; NaN without a surface.
    surface: Vec<[f32; 2]>,
    /// Weight of each pixel.
    weights: Vec<f32>,
    /// Whether a pixel, its right, its lower and its lower right neighbour are on one surface.
    is_smooth: Vec<bool>,
    tiles: Vec<TileBounds>,
}

/// Bounds of a tile's surface.
#[derive(Clone, Copy)]
struct TileBounds {
    /// Least depth; 0 if a pixel is without a surface.
    nearest: f32,
    /// Largest depth; 0 without a surface.
    farthest: f32,
    /// Least distance from the surface per depth.
    slope: f32,
}

impl TileBounds {
    /// Bounds of nothing.
    const NONE: TileBounds = TileBounds {
        nearest: f32::INFINITY,
        farthest: 0.0,
        slope: f32::INFINITY,
    };

    fn with(self, other: TileBounds) -> TileBounds {
        TileBounds {
            nearest: self.nearest.min(other.nearest),
            farthest: self.farthest.max(other.farthest),
            slope: self.slope.min(other.slope),
        }
    }

    fn of_pixel(map: &DepthMap, pixel: usize) -> TileBounds {
        match map.depth[pixel] {
            depth if depth.is_nan() => TileBounds {
                nearest: 0.0,
                ..TileBounds::NONE
            },
            depth => TileBounds {
                nearest: depth,
                farthest: depth,
                slope: map.slope[pixel],
            },
        }
    }
}

/// Position of a box relative to a view's surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Sight {
    /// None of it: it is beside the image, or behind the surface.
    Unseen,
    /// All of it before the surface; the weight of the pixel in the middle.
    Free(f32),
    /// Perhaps the surface.
    Surface,
}

/// Surfaces at four positions in pixels.
pub(super) struct SurfaceSamples {
    /// Depths along the view's z axis, world units; NaN without a surface.
    pub(super) depth: Vec4,
    /// Distances from the surface per depth.
    pub(super) slope: Vec4,
    /// Nearest pixels.
    pub(super) pixel: [usize; 4],
}

impl<'a> SurfaceSampler<'a> {
    /// Sampler of a map. Four pixels are on one surface if they lie within `apart` of each other along the normal. A
    /// frontal pixel at the depth `depth_median` has the weight 1.
    pub(super) fn new(map: &'a DepthMap, apart: f32, depth_median: f32) -> SurfaceSampler<'a> {
        let (width, height) = (map.camera.width as usize, map.camera.height as usize);
        let texel = |(depth, slope): (&f32, &f32)| [depth.recip(), *slope];
        let is_smooth = |pixel: usize| {
            let has_neighbors = pixel % width + 1 < width && pixel / width + 1 < height;
            has_neighbors && is_smooth(map, pixel, apart)
        };
        let columns = width.div_ceil(TILE);
        let tile = |tile: usize| {
            let (left, top) = (tile % columns * TILE, tile / columns * TILE);
            let rows = top..(top + TILE).min(height);
            let pixels = rows.flat_map(|y| (left..(left + TILE).min(width)).map(move |x| y * width + x));
            pixels.fold(TileBounds::NONE, |bounds, pixel| {
                bounds.with(TileBounds::of_pixel(map, pixel))
            })
        };
        let pixels = (0..width * height).into_par_iter();
        SurfaceSampler {
            map,
            width,
            height,
            surface: map.depth.iter().zip(&map.slope).map(texel).collect(),
            weights: pixels.clone().map(|pixel| weight(map, pixel, depth_median)).collect(),
            is_smooth: pixels.map(is_smooth).collect(),
            tiles: (0..columns * height.div_ceil(TILE)).into_par_iter().map(tile).collect(),
        }
    }

    /// Surfaces at four positions in pixels, one pixel or more inside the border. Where the four pixels around are on
    /// one surface, inverse depths are interpolated, which is exact on a plane; otherwise the nearest pixel counts.
    #[inline]
    pub(super) fn sample(&self, x: Vec4, y: Vec4) -> SurfaceSamples {
        let [right, bottom] = [self.width, self.height].map(|length| Vec4::splat(length as f32 - 1.0));
        // Written so that NaN is outside.
        let is_inside = x.cmpge(Vec4::ONE) & x.cmplt(right) & y.cmpge(Vec4::ONE) & y.cmplt(bottom);
        let [left, top] = [(x, right), (y, bottom)].map(|(at, end)| at.max(Vec4::ONE).min(end) - 0.5);
        let [column, row] = [left, top].map(Vec4::as_uvec4);
        let [u, v] = [left - column.as_vec4(), top - row.as_vec4()].map(|share| share.to_array());
        let (mut inverse, mut slope, mut pixel) = (Vec4::NAN, Vec4::NAN, [0; 4]);
        for i in 0..4 {
            let corner = row[i] as usize * self.width + column[i] as usize;
            pixel[i] = corner + usize::from(u[i] >= 0.5) + usize::from(v[i] >= 0.5) * self.width;
            [inverse[i], slope[i]] = match self.is_smooth[corner] {
                true => self.between(corner, u[i], v[i]),
                false => self.surface[pixel[i]],
            };
        }
        SurfaceSamples {
            depth: Vec4::select(is_inside, inverse.recip(), Vec4::NAN),
            slope,
            pixel,
        }
    }

    /// Inverse depth and slope at shares `u` and `v` from a pixel to its right and to its lower neighbour.
    #[inline]
    fn between(&self, pixel: usize, u: f32, v: f32) -> [f32; 2] {
        let pair = |first: usize| Vec4::from_slice(self.surface[first..first + 2].as_flattened());
        let [a, b, c, d] = pair(pixel).lerp(pair(pixel + self.width), v).to_array();
        [a + u * (c - a), b + u * (d - b)]
    }

    /// Weight of a pixel.
    pub(super) fn weight(&self, pixel: usize) -> f32 {
        self.weights[pixel]
    }

    /// Sight of a box, given in view coordinates. Points are behind the surface from `truncation` on along z, and
    /// before it from `truncation` on along the normal.
    pub(super) fn sight(&self, middle: DVec3, half: DVec3, truncation: f32) -> Sight {
        let [near, far] = [middle.z - half.z, middle.z + half.z];
        if far <= 0.0 {
            return Sight::Unseen;
        }
        if near <= 0.0 {
            return Sight::Surface;
        }
        let camera = &self.map.camera;
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for z in [near, far] {
            for corner in [middle - half, middle + half] {
                let at = camera.pixel_from_view(corner.truncate().extend(z));
                (low, high) = (low.min(at), high.max(at));
            }
        }
        let size = DVec2::new(self.width as f64, self.height as f64);
        if high.cmplt(DVec2::ONE).any() || low.cmpge(size - 1.0).any() {
            return Sight::Unseen;
        }
        if (high - low).max_element() > WIDTH_MAX {
            return Sight::Surface;
        }
        let bounds = self.bounds(low, high);
        if f64::from(bounds.farthest + truncation) < near {
            return Sight::Unseen;
        }
        let is_inside = low.cmpge(DVec2::ONE).all() && high.cmplt(size - 1.0).all();
        if is_inside && f64::from(bounds.nearest - truncation / bounds.slope) >= far {
            let at = camera.pixel_from_view(middle);
            return Sight::Free(self.weights[at.y as usize * self.width + at.x as usize]);
        }
        Sight::Surface
    }

    /// Bounds of all samples in a rectangle of the image.
    fn bounds(&self, low: DVec2, high: DVec2) -> TileBounds {
        // A sample reads a pixel beyond.
        let tiles = |low: f64, high: f64, length: usize| {
            let tile = |pixel: f64| (pixel.max(0.0) as usize).min(length - 1) / TILE;
            tile(low - 1.0)..=tile(high + 1.0)
        };
        let columns = self.width.div_ceil(TILE);
        let mut bounds = TileBounds::NONE;
        for row in tiles(low.y, high.y, self.height) {
            for column in tiles(low.x, high.x, self.width) {
                bounds = bounds.with(self.tiles[row * columns + column]);
            }
        }
        bounds
    }
}

/// Weight of a pixel: of splats that cover it, of a surface seen frontally, and of its size there.
fn weight(map: &DepthMap, pixel: usize, depth_median: f32) -> f32 {
    let (camera, width) = (&map.camera, map.camera.width as usize);
    let at = DVec2::new((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
    let ray = ((at - camera.center) / camera.focal).extend(1.0).length() as f32;
    let coverage = f32::from(map.color[pixel][3]) / 255.0;
    coverage * coverage * (map.slope[pixel] / ray) * (depth_median / map.depth[pixel]).powi(2)
}

/// Whether a pixel, its right, its lower and its lower right neighbour lie within `apart` along the normal.
fn is_smooth(map: &DepthMap, pixel: usize, apart: f32) -> bool {
    let width = map.camera.width as usize;
    let four = [pixel, pixel + 1, pixel + width, pixel + width + 1];
    let depths = four.map(|i| map.depth[i]);
    let least = depths.into_iter().fold(f32::INFINITY, f32::min);
    let most = depths.into_iter().fold(0.0, f32::max);
    let steepest = four.into_iter().map(|i| map.slope[i]).fold(f32::INFINITY, f32::min);
    // NaN stays out of least and most.
    !depths.iter().sum::<f32>().is_nan() && (most - least) * steepest <= apart
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Camera;
    use crate::stats::SplitMix64;
    use glam::DMat3;

    /// A tilted plane about 2 before the camera on the left, a wall at 5 on the right, and a hole.
    fn map() -> DepthMap {
        let camera = Camera {
            width: 64,
            height: 48,
            focal: DVec2::new(50.0, 60.0),
            center: DVec2::new(31.0, 25.0),
            rotation: DMat3::IDENTITY,
            position: DVec3::ZERO,
        };
        let depth = |i: usize| match (i % 64, i / 64) {
            (20..24, 30..34) => f32::NAN,
            (x, y) if x < 40 => plane(x as f32 + 0.5, y as f32 + 0.5),
            _ => 5.0,
        };
        DepthMap {
            camera,
            depth: (0..64 * 48).map(depth).collect(),
            slope: vec![0.9; 64 * 48],
            color: vec![[255; 4]; 64 * 48],
        }
    }

    /// Depths of a plane have an inverse that is linear in pixels.
    fn plane(x: f32, y: f32) -> f32 {
        1.0 / (0.5 + 0.001 * x - 0.002 * y)
    }

    #[test]
    fn samples_are_exact_on_a_plane_and_never_between_surfaces() {
        let map = map();
        let sampler = SurfaceSampler::new(&map, 0.1, 1.0);
        let depth = |x, y| {
            let depth = sampler.sample(Vec4::splat(x), Vec4::splat(y)).depth;
            assert!(depth == Vec4::splat(depth.w) || depth.is_nan_mask().all());
            (!depth.is_nan()).then_some(depth.x)
        };
        let on_plane = depth(10.3, 17.8).unwrap();
        assert!((on_plane - plane(10.3, 17.8)).abs() < 1e-5, "{on_plane}");
        // Pixel 39 is the last of the plane.
        assert_eq!(
            [39.9, 40.1].map(|x| depth(x, 17.5)),
            [Some(plane(39.5, 17.5)), Some(5.0)]
        );
        assert_eq!(
            sampler.sample(Vec4::splat(40.1), Vec4::splat(17.5)).pixel,
            [17 * 64 + 40; 4]
        );
        for [x, y] in [[22.0, 32.0], [0.9, 9.0], [9.0, 47.1], [63.5, 9.0], [f32::NAN, 9.0]] {
            assert!(depth(x, y).is_none(), "{x} {y}");
        }
    }

    #[test]
    fn unseen_boxes_have_no_sample_near_and_free_ones_only_samples_behind() {
        let map = map();
        let truncation = 0.2;
        let (camera, sampler) = (map.camera, SurfaceSampler::new(&map, 0.1, 1.0));
        let mut counts = [0; 3];
        let mut random = SplitMix64(5);
        let mut signed = || DVec3::from([0; 3].map(|_| 2.0 * random.unit() - 1.0));
        for _ in 0..8_000 {
            let middle = signed() * DVec3::new(1.5, 1.2, 3.0) + DVec3::new(0.0, 0.0, 3.0);
            let half = 0.2 * signed().abs();
            let sight = sampler.sight(middle, half, truncation);
            counts[match sight {
                Sight::Unseen => 0,
                Sight::Free(_) => 1,
                Sight::Surface => 2,
            }] += 1;
            for _ in 0..20 {
                let point = middle + half * signed();
                let pixel = camera.pixel_from_view(point);
                let sample = sampler.sample(Vec4::splat(pixel.x as f32), Vec4::splat(pixel.y as f32));
                let (depth, z) = (sample.depth.x, point.z as f32);
                match sight {
                    Sight::Unseen => assert!(depth.is_nan() || z <= 0.0 || depth + truncation < z),
                    Sight::Free(weight) => assert!(weight > 0.0 && (depth - z) * sample.slope.x >= truncation),
                    Sight::Surface => {}
                }
            }
        }
        assert!(counts.iter().all(|count| *count > 400), "{counts:?}");
        assert_eq!(
            sampler.sight(DVec3::new(0.0, 0.0, 0.1), DVec3::splat(0.3), truncation),
            Sight::Surface
        );
    }
}
