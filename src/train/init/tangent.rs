//! First rotations of surfels: each lies in the plane of its point's neighbours.

use crate::scene::eigen;
use crate::train::knn::neighbors;
use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;

/// Neighbours that span a plane: enough to average the noise of points, few enough for their curvature.
const NEIGHBORS: usize = 12;

/// Rotation `world_from_local` of each point, w, x, y, z: the third axis is the direction in which its neighbours vary
/// least. No rotation where they do not span a plane.
pub(super) fn tangent_rotations(points: &[[f32; 3]]) -> Vec<[f32; 4]> {
    let rotation = |(point, near): (&[f32; 3], &Vec<u32>)| {
        let place = |p: &[f32; 3]| DVec3::from(p.map(f64::from));
        let offsets: Vec<DVec3> = near
            .iter()
            .map(|&i| place(&points[i as usize]) - place(point))
            .collect();
        let reach = offsets.iter().map(|d| d.length()).fold(0.0, f64::max);
        if reach == 0.0 {
            return [1.0, 0.0, 0.0, 0.0];
        }
        // In units of their reach, squares stay in range.
        let of_plane: DMat3 = offsets
            .iter()
            .map(|&d| square(d / reach))
            .fold(DMat3::ZERO, |sum, m| sum + m);
        rotation_across(of_plane)
    };
    points
        .par_iter()
        .zip(&neighbors(points, NEIGHBORS))
        .map(rotation)
        .collect()
}

fn square(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

/// Rotation whose third axis is the direction of the least eigenvalue.
fn rotation_across(moments: DMat3) -> [f32; 4] {
    let (values, axes) = eigen(moments);
    let values = values.to_array();
    let least = (0..3).fold(0, |m, i| if values[i] < values[m] { i } else { m });
    // A turn of the axes in their order keeps the rotation proper.
    let [u, v] = [1, 2].map(|step| axes.col((least + step) % 3));
    let q = DQuat::from_mat3(&DMat3::from_cols(u, v, axes.col(least))).normalize();
    [q.w, q.x, q.y, q.z].map(|x| x as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surfels_lie_in_the_plane_of_their_points() {
        let normal = DVec3::new(1.0, -2.0, 0.5).normalize();
        let [u, v] = [
            normal.any_orthonormal_vector(),
            normal.cross(normal.any_orthonormal_vector()),
        ];
        let wave = |i: usize, k: f64| (i as f64 * k).sin();
        let point = |i| 1e3 * (u * wave(i, 1.3) + v * wave(i, 2.9)) + 7.0 * normal;
        let points: Vec<[f32; 3]> = (0..200).map(|i| point(i).as_vec3().to_array()).collect();
        for [w, x, y, z] in tangent_rotations(&points) {
            let q = DQuat::from_xyzw(x.into(), y.into(), z.into(), w.into());
            assert!((q.length() - 1.0).abs() < 1e-6);
            assert!((q * DVec3::Z).dot(normal).abs() > 1.0 - 1e-6);
        }
    }

    #[test]
    fn none_one_and_equal_points_have_rotations() {
        for points in [vec![], vec![[1.0; 3]], vec![[2.0; 3]; 30], vec![[0.0; 3], [1e30; 3]]] {
            let rotations = tangent_rotations(&points);
            assert_eq!(rotations.len(), points.len());
            assert!(rotations.as_flattened().iter().all(|q| q.is_finite()));
        }
    }
}
