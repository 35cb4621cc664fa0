//! Sparse volume of signed distances: blocks of 8 × 8 × 8 voxels near surfaces.

use super::depth_map::DepthMap;
use super::sampler::SurfaceSampler;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::array::from_fn;
use std::collections::HashMap;

/// Voxels along an edge of a block.
pub(super) const SIDE: usize = 8;
/// Voxels of a block.
pub(super) const VOXELS: usize = SIDE * SIDE * SIDE;
/// Bytes of a block.
pub(super) const BLOCK_BYTES: u64 = (VOXELS * size_of::<Voxel>()) as u64;

/// Index of a block: that of its first voxel divided by [`SIDE`].
pub(super) type Key = [i32; 3];

/// Sums over the views of a voxel.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Voxel {
    /// Mean distance to the surface in units of the truncation, positive before it, at most 1.
    pub distance: f32,
    /// Sum of weights; 0: never seen before or near a surface.
    pub weight: f32,
    /// Weighted sum of colours seen near the surface.
    pub color: [f32; 3],
    /// Sum of their weights.
    pub color_weight: f32,
    /// Views.
    pub views: u32,
}

impl Voxel {
    /// Adds a view that sees a surface at a distance in units of the truncation.
    fn add(&mut self, distance: f32, weight: f32, color: [f32; 3]) {
        self.weight += weight;
        self.distance += (weight / self.weight) * (distance.min(1.0) - self.distance);
        self.views += 1;
        if distance <= 1.0 {
            self.color_weight += weight;
            for (sum, c) in self.color.iter_mut().zip(color) {
                *sum += weight * c;
            }
        }
    }

    /// True if at least `views_min` views saw it.
    pub(super) fn is_known(&self, views_min: u32) -> bool {
        self.views >= views_min && self.weight > 0.0
    }
}

/// Blocks of voxels. Voxel (i, j, k) lies at (i, j, k) times the voxel's size in the world.
#[derive(Debug)]
pub(super) struct Volume {
    /// Edge of a voxel, world units.
    pub voxel: f64,
    /// Distance at which distances end, world units.
    pub truncation: f64,
    /// Keys in ascending order.
    pub keys: Vec<Key>,
    /// Voxels of each block; x fastest.
    pub blocks: Vec<Box<[Voxel]>>,
    place_from_key: HashMap<Key, usize>,
}

impl Volume {
    /// Unseen blocks under keys in ascending order.
    pub(super) fn new(voxel: f64, truncation: f64, keys: Vec<Key>) -> Volume {
        let empty = || vec![Voxel::default(); VOXELS].into_boxed_slice();
        Volume {
            voxel,
            truncation,
            blocks: keys.iter().map(|_| empty()).collect(),
            place_from_key: keys.iter().enumerate().map(|(i, key)| (*key, i)).collect(),
            keys,
        }
    }

    /// The block under a key.
    pub(super) fn block(&self, key: Key) -> Option<&[Voxel]> {
        self.place_from_key.get(&key).map(|&place| &*self.blocks[place])
    }

    /// Adds a view. `depth_median` is the depth at which a view seen frontally has the weight 1.
    pub(super) fn add(&mut self, map: &DepthMap, depth_median: f32) {
        let (voxel, truncation) = (self.voxel, self.truncation);
        let sampler = SurfaceSampler::new(map, truncation as f32);
        let blocks = self.blocks.par_iter_mut().zip(&self.keys);
        blocks.for_each(|(block, key)| add_view(block, *key, &sampler, voxel, truncation, depth_median));
    }
}

/// Keys of the blocks within the truncation of a map's surface, along its rays; ascending.
pub(super) fn keys_near(map: &DepthMap, voxel: f64, truncation: f64) -> Vec<Key> {
    let camera = &map.camera;
    let width = camera.width as usize;
    let block = voxel * SIDE as f64;
    let row = |y: usize| {
        let mut keys: Vec<Key> = Vec::new();
        for x in 0..width {
            let i = y * width + x;
            let depth = f64::from(map.depth[i]);
            if depth.is_nan() {
                continue;
            }
            let ray = camera.ray_from_pixel(DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
            // A voxel beyond, so that cubes at the ends have all corners.
            let reach = (truncation + voxel) / f64::from(map.slope[i]);
            let steps = (2.0 * reach * ray.length() / (0.5 * block)).ceil() as u32;
            for step in 0..=steps {
                let along = depth - reach + 2.0 * reach * f64::from(step) / f64::from(steps.max(1));
                let point = (camera.position + ray * along) / block;
                let key = point.floor().as_ivec3().to_array();
                if keys.last() != Some(&key) {
                    keys.push(key);
                }
            }
        }
        keys.sort_unstable();
        keys.dedup();
        keys
    };
    let rows: Vec<Vec<Key>> = (0..camera.height as usize).into_par_iter().map(row).collect();
    let mut keys = rows.concat();
    keys.par_sort_unstable();
    keys.dedup();
    keys
}

fn add_view(
    block: &mut [Voxel],
    key: Key,
    sampler: &SurfaceSampler<'_>,
    voxel: f64,
    truncation: f64,
    depth_median: f32,
) {
    let (map, camera) = (sampler.map, &sampler.map.camera);
    let corner = DVec3::from(key.map(|k| f64::from(k) * SIDE as f64 * voxel));
    let first = camera.rotation * (corner - camera.position);
    let radius = 0.5 * (SIDE - 1) as f64 * voxel * 3f64.sqrt();
    let center = first + camera.rotation * DVec3::splat(0.5 * (SIDE - 1) as f64 * voxel);
    if !in_sight(map, center, radius) || sampler.hides(center, radius, truncation) {
        return;
    }
    let axes = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| (camera.rotation * (axis * voxel)).as_vec3());
    let (first, truncation) = (first.as_vec3(), truncation as f32);
    let (focal, middle) = (camera.focal.as_vec2(), camera.center.as_vec2());
    for (row, voxels) in block.as_chunks_mut::<SIDE>().0.iter_mut().enumerate() {
        let start = first + axes[1] * (row % SIDE) as f32 + axes[2] * (row / SIDE) as f32;
        // By rows, so that the compiler can compute all but the samples in vectors.
        let [x, y, z] = [0, 1, 2].map(|axis| from_fn::<f32, SIDE, _>(|i| start[axis] + axes[0][axis] * i as f32));
        let [x, y] = [x, y].map(|across| from_fn::<f32, SIDE, _>(|i| across[i] / z[i]));
        let ray: [f32; SIDE] = from_fn(|i| (1.0 + x[i] * x[i] + y[i] * y[i]).sqrt());
        for (i, voxel) in voxels.iter_mut().enumerate() {
            let [u, v] = [focal.x * x[i] + middle.x, focal.y * y[i] + middle.y];
            let Some(sample) = sampler.sample(u, v).filter(|_| z[i] > 0.0) else {
                continue;
            };
            let ahead = sample.depth - z[i];
            // Behind the hit by the length of the ray: a grazing ray soon leaves what it entered.
            if ahead * ray[i] < -truncation {
                continue;
            }
            let [red, green, blue, coverage] = map.color[sample.pixel].map(|c| f32::from(c) / 255.0);
            let cosine = sample.slope / ray[i];
            let weight = coverage * coverage * cosine * (depth_median / sample.depth).powi(2);
            // From the point to the plane: a grazing ray passes voxels that are near the surface, far before its hit.
            voxel.add(ahead * sample.slope / truncation, weight, [red, green, blue]);
        }
    }
}

/// False if a sphere in view coordinates is behind the camera or beside the image.
fn in_sight(map: &DepthMap, center: DVec3, radius: f64) -> bool {
    let camera = &map.camera;
    let low = -camera.center / camera.focal;
    let high = (DVec2::new(camera.width.into(), camera.height.into()) - camera.center) / camera.focal;
    // Distance beyond a side plane through the camera, x = slope · z.
    let beyond = |x: f64, slope: f64, sign: f64| sign * (x - slope * center.z) / (1.0 + slope * slope).sqrt();
    center.z > -radius
        && beyond(center.x, high.x, 1.0) < radius
        && beyond(center.x, low.x, -1.0) < radius
        && beyond(center.y, high.y, 1.0) < radius
        && beyond(center.y, low.y, -1.0) < radius
}
