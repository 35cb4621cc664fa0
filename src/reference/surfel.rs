//! Surfel at a pixel: the pixel's ray meets the surfel's plane where three linear equations hold, solved by
//! elimination.
//!
//! With the mean c, the scaled axes a and b in the view and the ray r = ((x − cx)/fx, (y − cy)/fy, 1), the hit is
//! z r = c + u a + v b; alpha is opacity · exp(−½ (u² + v²)). Nothing is projected to find it.

use super::Real;
use super::linear::{Vec3, dot, matrix, rotation, scale, transform, transpose};
use crate::scene::{Camera, ScreenFilter};

/// Cosine between line of sight and normal below which a surfel is edge-on: it has no hits.
pub const EDGE_COSINE: f64 = 1e-3;

/// Radius of a surfel in standard deviations, up to which its depth is that of its plane: where alpha is 1/255 at an
/// opacity of 1, and a little more for rounding.
pub const RADIUS: f64 = 3.34;

/// A surfel in front of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfelDisc<R> {
    /// Mean in the view, world units.
    pub mean: Vec3<R>,
    /// First and second axis in the view, as long as the standard deviations.
    pub axes: [Vec3<R>; 2],
    /// Unit normal in the view; either sign.
    pub normal: Vec3<R>,
    /// Focal length and principal point, pixels.
    pub lens: [f64; 4],
    /// Depth of the nearest hits, world units.
    pub near: f64,
    /// Whether the surfel counts as a round spot of half a squared pixel where that is larger (2DGS, section 4.2).
    pub has_spot: bool,
    /// Whether the surfel is edge-on: it has no hits.
    pub is_edge_on: bool,
}

/// Hit of a ray: coordinates in standard deviations, and depth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfelHit<R> {
    /// Along the first axis.
    pub u: R,
    /// Along the second axis.
    pub v: R,
    /// Depth along the view's z axis, world units.
    pub depth: R,
}

impl<R: Real> SurfelDisc<R> {
    /// The surfel with a mean in the view, a rotation and log-scales; `near` and `has_spot` as in the fields.
    pub fn of(
        mean: Vec3<R>,
        (quaternion, log_scale): ([R; 4], Vec3<R>),
        camera: &Camera,
        near: f64,
        has_spot: bool,
    ) -> SurfelDisc<R> {
        let axes = transpose(rotation(quaternion));
        let in_view = |axis: Vec3<R>| transform(matrix(camera.rotation), axis);
        let normal = in_view(axes[2]);
        let values = |v: Vec3<R>| v.map(R::value);
        let (n, c) = (values(normal), values(mean));
        SurfelDisc {
            mean,
            axes: [0, 1].map(|i| scale(log_scale[i].exp(), in_view(axes[i]))),
            normal,
            lens: [camera.focal.x, camera.focal.y, camera.center.x, camera.center.y],
            near,
            has_spot,
            is_edge_on: dot(n, c).abs() < EDGE_COSINE * dot(c, c).sqrt(),
        }
    }

    /// Hit of the ray through a position (pixels) and the plane, in front of the near plane.
    pub fn hit(&self, position: [f64; 2]) -> Option<SurfelHit<R>> {
        let [fx, fy, cx, cy] = self.lens;
        let ray = [(position[0] - cx) / fx, (position[1] - cy) / fy, 1.0].map(R::of);
        let [a, b] = self.axes;
        let columns = [ray, a.map(|x| -x), b.map(|x| -x)];
        let [depth, u, v] = solve(transpose(columns), self.mean)?;
        let is_seen = !self.is_edge_on && depth.value() >= self.near;
        is_seen.then_some(SurfelHit { u, v, depth })
    }

    /// Depths between which the surfel lies, within its radius and in front of the near plane.
    pub fn depth_range(&self) -> [f64; 2] {
        let reach = self.axes.map(|axis| axis[2].value().powi(2));
        let reach = RADIUS * (reach[0] + reach[1]).sqrt();
        let z = self.mean[2].value();
        [(z - reach).max(self.near), z + reach]
    }

    /// 1 / z where the ray through a position (pixels) meets the plane.
    fn inverse_depth(&self, position: [R; 2]) -> R {
        let [fx, fy, cx, cy] = self.lens.map(R::of);
        let ray = [(position[0] - cx) / fx, (position[1] - cy) / fy, R::of(1.0)];
        dot(self.normal, ray) / dot(self.normal, self.mean)
    }

    /// z₀ / z at a distance (pixels) from the mean, under the screen's filter of a variance (px²), by the dilated
    /// covariance.
    fn filtered_inverse(&self, covariance: Vec3<R>, filter: f64, mean: [R; 2], d: [R; 2]) -> R {
        let one = R::of(1.0);
        let beside = |x: f64, y: f64| self.inverse_depth([mean[0] + R::of(x), mean[1] + R::of(y)]);
        let tilt = [beside(1.0, 0.0), beside(0.0, 1.0)].map(|inverse| inverse * self.mean[2] - one);
        let [x, y] = filtered(tilt, covariance, filter);
        one + x * d[0] + y * d[1]
    }

    /// Depth at a position: that of the plane, but not beyond the surfel, whose range is a constant share of its mean's
    /// depth. Without a filter.
    pub fn depth(&self, position: [f64; 2]) -> R {
        let [nearest, farthest] = self.depth_range();
        let mean = self.mean[2];
        if self.is_edge_on {
            return mean;
        }
        let end = |depth: f64| match depth == self.near {
            true => R::of(depth),
            false => R::of(depth) + (mean - R::of(mean.value())) * R::of(depth / mean.value()),
        };
        // Behind the horizon of the plane there is no hit; nearby the depth grows without limit.
        let inverse = self.inverse_depth(position.map(R::of));
        let free = R::of(1.0) / inverse;
        if inverse.value() <= 0.0 || free.value() > farthest {
            end(farthest)
        } else if free.value() < nearest {
            end(nearest)
        } else {
            free
        }
    }
}

/// Half the squared distance of a position (pixels) from a surfel's mean, in standard deviations; infinite where the
/// ray does not meet it. Mean and covariance are those of its projection.
pub fn power<R: Real>(disc: &SurfelDisc<R>, mean: [R; 2], covariance: Vec3<R>, position: [f64; 2]) -> R {
    let half = R::of(0.5);
    let d = [0, 1].map(|i| R::of(position[i]) - mean[i]);
    let none = R::of(f64::INFINITY);
    if disc.has_spot {
        let flat = disc.hit(position);
        let flat = flat.map_or(none, |hit| half * (hit.u.squared() + hit.v.squared()));
        let spot = d[0].squared() + d[1].squared();
        return if flat.value() <= spot.value() { flat } else { spot };
    }
    // The dilated ellipse at the mean, in the perspective of its plane under the filter.
    let inverse = disc.filtered_inverse(covariance, ScreenFilter::Mip.dilation(), mean, d);
    if disc.is_edge_on || inverse.value() <= 0.0 || (disc.mean[2] / inverse).value() < disc.near {
        return none;
    }
    let [xx, xy, yy] = covariance;
    let form = yy * d[0].squared() - R::of(2.0) * xy * d[0] * d[1] + xx * d[1].squared();
    half * form / (xx * yy - xy * xy) / inverse.squared()
}

/// Tilt of a plane under the screen's filter of a variance (px²): (S + k)⁻¹ S times the tilt, with the dilated
/// covariance S + k.
pub fn filtered<R: Real>(tilt: [R; 2], [xx, xy, yy]: Vec3<R>, filter: f64) -> [R; 2] {
    let k = R::of(filter);
    let x = (xx - k) * tilt[0] + xy * tilt[1];
    let y = xy * tilt[0] + (yy - k) * tilt[1];
    let det = xx * yy - xy * xy;
    [(yy * x - xy * y) / det, (xx * y - xy * x) / det]
}

/// Solution of three linear equations by elimination with the largest pivots; `None` if there is none of finite size.
fn solve<R: Real>(mut rows: [[R; 3]; 3], mut right: Vec3<R>) -> Option<Vec3<R>> {
    for column in 0..3 {
        let size = |row: &usize| rows[*row][column].value().abs();
        let pivot = (column..3).max_by(|a, b| size(a).total_cmp(&size(b)))?;
        rows.swap(column, pivot);
        right.swap(column, pivot);
        for row in column + 1..3 {
            let factor = rows[row][column] / rows[column][column];
            let (pivot, below) = (rows[column], rows[row]);
            rows[row] = [0, 1, 2].map(|k| below[k] - factor * pivot[k]);
            right[row] = right[row] - factor * right[column];
        }
    }
    let mut solution = [R::of(0.0); 3];
    for row in (0..3).rev() {
        let known: R = (row + 1..3).map(|k| rows[row][k] * solution[k]).sum();
        solution[row] = (right[row] - known) / rows[row][row];
    }
    solution.iter().all(|x| x.value().is_finite()).then_some(solution)
}

/// Unit normal toward the camera.
pub fn normal_toward<R: Real>(normal: Vec3<R>, mean: Vec3<R>) -> Vec3<R> {
    scale(R::of(-dot(normal, mean).value().signum()), normal)
}
