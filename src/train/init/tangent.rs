//! First rotations and thicknesses of splats: each lies in the plane of its point's neighbours, and is as flat as they
//! are.

use crate::scene::eigen;
use crate::train::knn::neighbors;
use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;

/// Neighbours that span a plane: enough to average the noise of points, few enough for their curvature.
const NEIGHBORS: usize = 12;

/// Plane of a point's neighbours.
#[derive(Clone, Copy, Debug)]
pub(super) struct LocalPlane {
    /// Rotation `world_from_local`, w, x, y, z: the third axis is the direction in which the neighbours vary least.
    pub(super) rotation: [f32; 4],
    /// Standard deviation of the neighbours along that axis, in those along the others: 0 to 1.
    pub(super) thickness: f64,
}

impl LocalPlane {
    /// Of points that are all in one place.
    const NONE: LocalPlane = LocalPlane {
        rotation: [1.0, 0.0, 0.0, 0.0],
        thickness: 1.0,
    };
}

/// Plane of each point's neighbours.
pub(super) fn local_planes(points: &[[f32; 3]]) -> Vec<LocalPlane> {
    let plane = |(point, near): (&[f32; 3], &Vec<u32>)| {
        let place = |p: &[f32; 3]| DVec3::from(p.map(f64::from));
        let offsets: Vec<DVec3> = near
            .iter()
            .map(|&i| place(&points[i as usize]) - place(point))
            .collect();
        let reach = offsets.iter().map(|d| d.length()).fold(0.0, f64::max);
        if reach == 0.0 {
            return LocalPlane::NONE;
        }
        // In units of their reach, squares stay in range.
        let moments: DMat3 = offsets
            .iter()
            .map(|&d| square(d / reach))
            .fold(DMat3::ZERO, |sum, m| sum + m);
        plane_of_moments(moments)
    };
    points
        .par_iter()
        .zip(&neighbors(points, NEIGHBORS))
        .map(plane)
        .collect()
}

fn square(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

/// Plane across the direction of the least eigenvalue.
fn plane_of_moments(moments: DMat3) -> LocalPlane {
    let (values, axes) = eigen(moments);
    let values = values.to_array();
    let least = (0..3).fold(0, |m, i| if values[i] < values[m] { i } else { m });
    // A turn of the axes in their order keeps the rotation proper.
    let [u, v] = [1, 2].map(|step| axes.col((least + step) % 3));
    let q = DQuat::from_mat3(&DMat3::from_cols(u, v, axes.col(least))).normalize();
    let others = 0.5 * (values.iter().sum::<f64>() - values[least]);
    LocalPlane {
        rotation: [q.w, q.x, q.y, q.z].map(|x| x as f32),
        thickness: (values[least].max(0.0) / others).sqrt().min(1.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(i: usize, k: f64) -> f64 {
        (i as f64 * k).sin()
    }

    #[test]
    fn planes_are_those_of_their_points() {
        let normal = DVec3::new(1.0, -2.0, 0.5).normalize();
        let [u, v] = [
            normal.any_orthonormal_vector(),
            normal.cross(normal.any_orthonormal_vector()),
        ];
        let point = |i| 1e3 * (u * wave(i, 1.3) + v * wave(i, 2.9)) + 7.0 * normal;
        let points: Vec<[f32; 3]> = (0..200).map(|i| point(i).as_vec3().to_array()).collect();
        for plane in local_planes(&points) {
            let [w, x, y, z] = plane.rotation.map(f64::from);
            let q = DQuat::from_xyzw(x, y, z, w);
            assert!((q.length() - 1.0).abs() < 1e-6);
            assert!((q * DVec3::Z).dot(normal).abs() > 1.0 - 1e-6);
            assert!(plane.thickness < 1e-5, "{}", plane.thickness);
        }
    }

    #[test]
    fn points_that_fill_space_have_no_thin_plane() {
        let point = |i| {
            DVec3::new(wave(i, 1.3), wave(i, 2.9), wave(i, 4.1))
                .as_vec3()
                .to_array()
        };
        let points: Vec<[f32; 3]> = (0..1_000).map(point).collect();
        let planes = local_planes(&points);
        let mean = planes.iter().map(|plane| plane.thickness).sum::<f64>() / 1e3;
        assert!((0.3..0.8).contains(&mean), "{mean}");
        assert!(planes.iter().all(|plane| (0.0..=1.0).contains(&plane.thickness)));
    }

    #[test]
    fn none_one_and_equal_points_have_planes() {
        for points in [vec![], vec![[1.0; 3]], vec![[2.0; 3]; 30], vec![[0.0; 3], [1e30; 3]]] {
            let planes = local_planes(&points);
            assert_eq!(planes.len(), points.len());
            for plane in planes {
                assert!(plane.rotation.iter().all(|q| q.is_finite()));
                assert!((0.0..=1.0).contains(&plane.thickness), "{plane:?}");
            }
        }
    }
}
