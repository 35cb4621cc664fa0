//! Sparse volume of signed distances: blocks of 8 × 8 × 8 voxels near surfaces.

use super::depth_map::DepthMap;
use super::sampler::{Sight, SurfaceSampler};
use glam::{DMat3, DVec2, DVec3, Vec3, Vec4};
use rayon::prelude::*;
use std::collections::HashMap;

/// Voxels along an edge of a block.
pub(super) const SIDE: usize = 8;
/// Voxels of a block.
pub(super) const VOXELS: usize = SIDE * SIDE * SIDE;
/// Voxels along an edge of an octant of a block.
const HALF: usize = SIDE / 2;
/// Voxels of an octant.
const OCTANT: usize = HALF * HALF * HALF;
/// Bytes of a block.
pub(super) const BLOCK_BYTES: u64 = (VOXELS * size_of::<VoxelSums>() + size_of::<[FreeSums; 8]>()) as u64;

/// Index of a block: that of its first voxel divided by [`SIDE`].
pub(super) type Key = [i32; 3];

/// A voxel that enough views saw.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Voxel {
    /// Mean distance to the surface in units of the truncation, positive before it, at most 1.
    pub distance: f32,
    /// Mean colour of the surface near it.
    pub color: Option<Vec3>,
}

/// Sums over the views of a voxel.
#[derive(Clone, Copy, Debug, Default)]
struct VoxelSums {
    /// Weighted distances.
    distance: f32,
    /// Weights.
    weight: f32,
    /// Weighted colours of views that are near the surface.
    color: Vec3,
    /// Weights of these.
    color_weight: f32,
    views: u32,
}

impl VoxelSums {
    /// Adds a view that has the surface at a distance in units of the truncation, with the colour of a pixel.
    fn add(&mut self, distance: f32, weight: f32, color: impl FnOnce() -> Vec3) {
        self.weight += weight;
        self.distance += weight * distance.min(1.0);
        self.views += 1;
        if distance <= 1.0 {
            self.color_weight += weight;
            self.color += weight * color();
        }
    }
}

/// Sums over the views that have all of an octant before their surface by the truncation or more.
#[derive(Clone, Copy, Debug, Default)]
struct FreeSums {
    weight: f32,
    views: u32,
}

impl FreeSums {
    fn add(&mut self, weight: f32) {
        self.weight += weight;
        self.views += 1;
    }
}

/// Voxels of a block.
#[derive(Clone, Copy, Debug)]
pub(super) struct VoxelBlock<'a> {
    /// Octant by octant, x fastest in both.
    voxels: &'a [VoxelSums],
    /// By octant.
    free: &'a [FreeSums; 8],
}

impl VoxelBlock<'_> {
    /// The voxel at a place, x fastest, if at least `views_min` views saw it.
    pub(super) fn voxel(self, place: usize, views_min: u32) -> Option<Voxel> {
        let at = [place % SIDE, place / SIDE % SIDE, place / (SIDE * SIDE)];
        let index = |side: usize, of: fn(usize) -> usize| of(at[0]) + side * (of(at[1]) + side * of(at[2]));
        let octant = index(2, |k| k / HALF);
        let sums = &self.voxels[OCTANT * octant + index(HALF, |k| k % HALF)];
        let free = self.free[octant];
        let weight = sums.weight + free.weight;
        let is_known = sums.views + free.views >= views_min && weight > 0.0;
        is_known.then(|| Voxel {
            distance: (sums.distance + free.weight) / weight,
            color: (sums.color_weight > 0.0).then(|| sums.color / sums.color_weight),
        })
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
    /// Block by block, in one allocation, which goes back to the system as a whole.
    voxels: Vec<VoxelSums>,
    /// By block and octant.
    free: Vec<[FreeSums; 8]>,
    place_from_key: HashMap<Key, usize>,
}

impl Volume {
    /// Unseen blocks under keys in ascending order.
    pub(super) fn new(voxel: f64, truncation: f64, keys: Vec<Key>) -> Volume {
        Volume {
            voxel,
            truncation,
            voxels: vec![VoxelSums::default(); VOXELS * keys.len()],
            free: vec![[FreeSums::default(); 8]; keys.len()],
            place_from_key: keys.iter().enumerate().map(|(i, key)| (*key, i)).collect(),
            keys,
        }
    }

    /// The block under a key.
    pub(super) fn block(&self, key: Key) -> Option<VoxelBlock<'_>> {
        self.place_from_key.get(&key).map(|&place| VoxelBlock {
            voxels: &self.voxels[VOXELS * place..][..VOXELS],
            free: &self.free[place],
        })
    }

    /// Adds a view. `depth_median` is the depth at which a view seen frontally has the weight 1.
    pub(super) fn add(&mut self, map: &DepthMap, depth_median: f32) {
        let view = VolumeView::new(
            self.voxel,
            self.truncation,
            SurfaceSampler::new(map, self.truncation as f32, depth_median),
        );
        let blocks = self.voxels.par_chunks_mut(VOXELS).zip(&mut self.free);
        blocks
            .zip(&self.keys)
            .for_each(|((voxels, free), key)| view.add_to(voxels, free, *key));
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

/// A view that is added to a volume.
struct VolumeView<'a> {
    sampler: SurfaceSampler<'a>,
    voxel: f64,
    truncation: f32,
    /// Steps from a voxel to the next along each axis, view coordinates.
    axes: DMat3,
    /// Extent of a cube of voxels along the view's axes, per step.
    extent: DVec3,
}

impl<'a> VolumeView<'a> {
    fn new(voxel: f64, truncation: f64, sampler: SurfaceSampler<'a>) -> VolumeView<'a> {
        let axes = sampler.map.camera.rotation * voxel;
        VolumeView {
            sampler,
            voxel,
            truncation: truncation as f32,
            axes,
            extent: axes.x_axis.abs() + axes.y_axis.abs() + axes.z_axis.abs(),
        }
    }

    /// Adds the view to a block: as a whole where it lies before or behind the surface, else by octants or voxels.
    fn add_to(&self, voxels: &mut [VoxelSums], free: &mut [FreeSums; 8], key: Key) {
        let corner = DVec3::from(key.map(|k| f64::from(k) * SIDE as f64 * self.voxel));
        let first = self.sampler.map.camera.view_from_world(corner);
        match self.sight(first, SIDE) {
            Sight::Unseen => return,
            Sight::Free(weight) => return free.iter_mut().for_each(|free| free.add(weight)),
            Sight::Surface => {}
        }
        let octants = voxels.as_chunks_mut::<OCTANT>().0.iter_mut().zip(free);
        for (i, (voxels, free)) in octants.enumerate() {
            let step = DVec3::new((i % 2) as f64, (i / 2 % 2) as f64, (i / 4) as f64) * HALF as f64;
            let first = first + self.axes * step;
            match self.sight(first, HALF) {
                Sight::Unseen => {}
                Sight::Free(weight) => free.add(weight),
                Sight::Surface => self.add_to_voxels(voxels, first.as_vec3()),
            }
        }
    }

    /// Sight of a cube with so many voxels along an edge, from its first one, view coordinates.
    fn sight(&self, first: DVec3, side: usize) -> Sight {
        let half = 0.5 * (side - 1) as f64;
        let middle = first + self.axes * DVec3::splat(half);
        self.sampler.sight(middle, half * self.extent, self.truncation)
    }

    /// Adds the view to the voxels of an octant whose first one is at `first`, view coordinates.
    fn add_to_voxels(&self, octant: &mut [VoxelSums; OCTANT], first: Vec3) {
        let (sampler, camera) = (&self.sampler, &self.sampler.map.camera);
        let axes = [self.axes.x_axis, self.axes.y_axis, self.axes.z_axis].map(|axis| axis.as_vec3());
        let (focal, center) = (camera.focal.as_vec2(), camera.center.as_vec2());
        let along = Vec4::new(0.0, 1.0, 2.0, 3.0);
        for (row, voxels) in octant.as_chunks_mut::<HALF>().0.iter_mut().enumerate() {
            let start = first + axes[1] * (row % HALF) as f32 + axes[2] * (row / HALF) as f32;
            let [x, y, z] = [0, 1, 2].map(|axis| start[axis] + axes[0][axis] * along);
            let (x, y) = (x / z, y / z);
            let ray = (x * x + y * y + 1.0).map(f32::sqrt);
            let samples = sampler.sample(focal.x * x + center.x, focal.y * y + center.y);
            let ahead = samples.depth - z;
            // From the point to the plane: a grazing ray passes voxels that are near the surface, far before its hit.
            let distance = ahead * samples.slope / self.truncation;
            // Behind the hit by the length of the ray: a grazing ray soon leaves what it entered. NaN is unseen.
            let is_seen = z.cmpgt(Vec4::ZERO) & (ahead * ray).cmpge(Vec4::splat(-self.truncation));
            for (i, voxel) in voxels.iter_mut().enumerate().filter(|(i, _)| is_seen.test(*i)) {
                let pixel = samples.pixel[i];
                voxel.add(distance[i], sampler.weight(pixel), || sampler.map.rgb(pixel));
            }
        }
    }
}
