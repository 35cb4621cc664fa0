//! Weights of splats in the views of a scene.

use crate::Result;
use crate::gpu::Gpu;
use crate::scene::{Camera, Splats};
use crate::simplify::{ContributionPass, PassOptions};
use glam::DVec3;
use half::f16;

/// Weight of every splat in some views, and the directions from which they see it.
#[derive(Clone, Debug)]
pub struct Influence {
    /// Positions of the cameras in world units.
    positions: Vec<DVec3>,
    /// By view and splat: square root of the sum of the splat's weights over the pixels.
    roots: Vec<Vec<f16>>,
    /// Mean over splats of the sum of their weights over all views.
    mean: f64,
}

/// Least relative weight of a splat.
const LEAST_WEIGHT: f64 = 0.25;

impl Influence {
    /// Renders the scene from `cameras` and sums the weights of each splat in each view. Stops with `None` once `go_on`
    /// is false.
    ///
    /// # Errors
    /// Those of the device.
    pub fn measure(
        gpu: &Gpu,
        splats: &Splats,
        cameras: &[Camera],
        options: PassOptions,
        mut go_on: impl FnMut() -> bool,
    ) -> Result<Option<Influence>> {
        let mut pass = ContributionPass::new(gpu, splats, options)?;
        let mut roots = Vec::with_capacity(cameras.len());
        for camera in cameras {
            if !go_on() {
                return Ok(None);
            }
            let weights = pass.removal_errors(camera)?;
            // NaN, of splats that are not drawn, becomes 0.
            let root = |weight: f32| f16::from_f32(weight.max(0.0).sqrt());
            roots.push(weights.iter().map(|error| root(error.weight)).collect());
        }
        Ok(Some(Influence::new(cameras, roots)))
    }

    fn new(cameras: &[Camera], roots: Vec<Vec<f16>>) -> Influence {
        let count = roots.first().map_or(0, Vec::len);
        let total: f64 = roots.iter().flatten().map(|&root| f64::from(root).powi(2)).sum();
        Influence {
            positions: cameras.iter().map(|camera| camera.position).collect(),
            roots,
            mean: if count > 0 { total / count as f64 } else { 0.0 },
        }
    }

    /// Sum of a splat's weights over all views, relative to the mean of all splats, but at least a quarter: it may be
    /// seen from elsewhere. 1 without any weight of any splat.
    pub fn of(&self, splat: usize) -> f64 {
        let sum: f64 = self.roots.iter().map(|view| f64::from(view[splat]).powi(2)).sum();
        if self.mean > 0.0 {
            (sum / self.mean).max(LEAST_WEIGHT)
        } else {
            1.0
        }
    }

    /// Views with weight of a splat at `mean`: weight, and direction from the camera.
    pub(super) fn views(&self, splat: usize, mean: [f32; 3]) -> impl Iterator<Item = (f64, DVec3)> {
        let mean = DVec3::from(mean.map(f64::from));
        let views = self.positions.iter().zip(&self.roots);
        views.filter_map(move |(position, roots)| {
            let weight = f64::from(roots[splat]).powi(2);
            let direction = (mean - position).normalize_or(DVec3::Z);
            (weight > 0.0).then_some((weight, direction))
        })
    }

    /// The splats of these indices, in this order.
    pub fn picked(&self, indices: &[usize]) -> Influence {
        let pick = |view: &Vec<f16>| indices.iter().map(|&i| view[i]).collect();
        Influence {
            positions: self.positions.clone(),
            roots: self.roots.iter().map(pick).collect(),
            mean: self.mean,
        }
    }
}

#[cfg(test)]
impl Influence {
    /// Weights by view and splat of cameras at these positions.
    pub(super) fn of_weights(positions: &[DVec3], weights: &[Vec<f32>]) -> Influence {
        let camera = |&position: &DVec3| Camera {
            width: 1,
            height: 1,
            focal: glam::DVec2::ONE,
            center: glam::DVec2::ONE,
            rotation: glam::DMat3::IDENTITY,
            position,
        };
        let cameras: Vec<Camera> = positions.iter().map(camera).collect();
        let root = |view: &Vec<f32>| view.iter().map(|w| f16::from_f32(w.sqrt())).collect();
        Influence::new(&cameras, weights.iter().map(root).collect())
    }
}
