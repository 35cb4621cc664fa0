//! A depth map laid out for sampling at the voxels of a volume.

use super::depth_map::DepthMap;
use glam::{DVec2, DVec3};

/// Pixels along an edge of a tile.
const TILE: usize = 16;

/// A map's surface, and bounds of it.
pub(super) struct SurfaceSampler<'a> {
    pub(super) map: &'a DepthMap,
    width: usize,
    height: usize,
    /// Inverse depth and slope of each pixel; NaN without a surface.
    surface: Vec<[f32; 2]>,
    /// Whether a pixel, its right, its lower and its lower right neighbour are on one surface.
    is_smooth: Vec<bool>,
    /// Largest depth of each tile; 0 without a surface.
    farthest: Vec<f32>,
}

/// A surface at a position in pixels.
#[derive(Clone, Copy)]
pub(super) struct SurfaceSample {
    /// Depth along the view's z axis, world units.
    pub(super) depth: f32,
    /// Distance from the surface per depth.
    pub(super) slope: f32,
    /// Nearest pixel.
    pub(super) pixel: usize,
}

impl<'a> SurfaceSampler<'a> {
    /// Sampler of a map. Four pixels are on one surface if they lie within `apart` of each other along the normal.
    pub(super) fn new(map: &'a DepthMap, apart: f32) -> SurfaceSampler<'a> {
        let (width, height) = (map.camera.width as usize, map.camera.height as usize);
        let texel = |(depth, slope): (&f32, &f32)| [depth.recip(), *slope];
        let mut sampler = SurfaceSampler {
            map,
            width,
            height,
            surface: map.depth.iter().zip(&map.slope).map(texel).collect(),
            is_smooth: vec![false; map.depth.len()],
            farthest: vec![0.0; width.div_ceil(TILE) * height.div_ceil(TILE)],
        };
        for y in 0..height {
            for x in 0..width {
                let pixel = y * width + x;
                let farthest = &mut sampler.farthest[y / TILE * width.div_ceil(TILE) + x / TILE];
                // NaN leaves it as it is.
                *farthest = farthest.max(map.depth[pixel]);
                let has_neighbors = x + 1 < width && y + 1 < height;
                sampler.is_smooth[pixel] = has_neighbors && is_smooth(map, pixel, apart);
            }
        }
        sampler
    }

    /// Surface at a position in pixels, one pixel or more inside the border. Inverse depths are interpolated, which is
    /// exact on a plane, where the four around it are on one surface; otherwise the nearest pixel counts.
    #[inline]
    pub(super) fn sample(&self, x: f32, y: f32) -> Option<SurfaceSample> {
        // Written so that NaN fails.
        if !(x >= 1.0 && y >= 1.0 && x < self.width as f32 - 1.0 && y < self.height as f32 - 1.0) {
            return None;
        }
        let pixel = y as u32 as usize * self.width + x as u32 as usize;
        let (left, top) = ((x - 0.5) as u32, (y - 0.5) as u32);
        let corner = top as usize * self.width + left as usize;
        let [inverse, slope] = if self.is_smooth[corner] {
            let (u, v) = (x - 0.5 - left as f32, y - 0.5 - top as f32);
            let upper = &self.surface[corner..corner + 2];
            let lower = &self.surface[corner + self.width..corner + self.width + 2];
            lerp(lerp(upper[0], upper[1], u), lerp(lower[0], lower[1], u), v)
        } else {
            self.surface[pixel]
        };
        (inverse > 0.0).then(|| SurfaceSample {
            depth: inverse.recip(),
            slope,
            pixel,
        })
    }

    /// Whether all of a sphere, in view coordinates, is farther than the surface by more than `behind` along z.
    pub(super) fn hides(&self, center: DVec3, radius: f64, behind: f64) -> bool {
        let nearest = center.z - radius;
        if nearest <= 0.0 {
            return false;
        }
        let camera = &self.map.camera;
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for z in [nearest, center.z + radius] {
            for side in [-radius, radius] {
                let at = camera.focal * (center.truncate() + side) / z + camera.center;
                (low, high) = (low.min(at), high.max(at));
            }
        }
        // A sample reads a pixel beyond.
        let tiles = |low: f64, high: f64, length: usize| {
            let tile = |pixel: f64| (pixel.max(0.0) as usize).min(length - 1) / TILE;
            tile(low - 1.0)..=tile(high + 1.0)
        };
        let columns = self.width.div_ceil(TILE);
        let is_behind = |tile: usize| f64::from(self.farthest[tile]) + behind < nearest;
        tiles(low.y, high.y, self.height)
            .all(|row| tiles(low.x, high.x, self.width).all(|column| is_behind(row * columns + column)))
    }
}

/// Linear interpolation from `a` to `b`.
fn lerp(a: [f32; 2], b: [f32; 2], share: f32) -> [f32; 2] {
    [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])]
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
        let sampler = SurfaceSampler::new(&map, 0.1);
        let at = |x, y| sampler.sample(x, y).map(|sample| sample.depth);
        let on_plane = at(10.3, 17.8).unwrap();
        assert!((on_plane - plane(10.3, 17.8)).abs() < 1e-5, "{on_plane}");
        // Pixel 39 is the last of the plane.
        assert_eq!([39.9, 40.1].map(|x| at(x, 17.5)), [Some(plane(39.5, 17.5)), Some(5.0)]);
        assert_eq!(
            sampler.sample(40.1, 17.5).map(|sample| sample.pixel),
            Some(17 * 64 + 40)
        );
        for [x, y] in [[22.0, 32.0], [0.9, 9.0], [9.0, 47.1], [63.5, 9.0], [f32::NAN, 9.0]] {
            assert!(at(x, y).is_none(), "{x} {y}");
        }
    }

    #[test]
    fn hidden_spheres_are_behind_every_sample() {
        let map = map();
        let (camera, sampler, behind) = (map.camera, SurfaceSampler::new(&map, 0.1), 0.2);
        let mut hidden = 0;
        let mut random = SplitMix64(5);
        let mut signed = || DVec3::from([0; 3].map(|_| 2.0 * random.unit() - 1.0));
        for _ in 0..2_000 {
            let center = signed() * DVec3::new(2.0, 1.5, 3.0) + DVec3::new(0.0, 0.0, 3.0);
            let radius = 0.3 * signed().x.abs();
            if !sampler.hides(center, radius, behind) {
                continue;
            }
            hidden += 1;
            for _ in 0..20 {
                let point = center + radius / 3f64.sqrt() * signed();
                let pixel = camera.focal * point.truncate() / point.z + camera.center;
                let sample = sampler.sample(pixel.x as f32, pixel.y as f32);
                assert!(sample.is_none_or(|sample| f64::from(sample.depth) + behind < point.z));
            }
        }
        assert!((300..1_700).contains(&hidden), "{hidden}");
        assert!(!sampler.hides(DVec3::new(0.0, 0.0, 0.1), 0.3, behind));
    }
}
