//! Points on a mesh's surface, for a mesh as the start of training.

use crate::scene::{Mesh, Point};
use crate::train::rng::{self, Stream};
use glam::DVec3;

/// `count` points spread over the mesh in proportion to area, colours interpolated (grey where the
/// mesh has none); none if the mesh has no area.
pub fn points_on_mesh(mesh: &Mesh, count: usize, seed: u64) -> Vec<Point> {
    let mut total = 0.0;
    let area_up_to: Vec<f64> = (0..mesh.triangles.len())
        .map(|i| {
            let [a, b, c] = mesh.corners(i).map(|p| DVec3::from(p.map(f64::from)));
            total += (b - a).cross(c - a).length() / 2.0;
            total
        })
        .collect();
    if !(total > 0.0 && total.is_finite()) {
        return Vec::new();
    }
    let point = |i: usize| {
        let [u, v, w, _] = rng::uniform(seed, 0, i as u32, Stream::RandomInit).map(f64::from);
        // One sample in each of `count` equal shares of the area: no bare patches.
        let target = (i as f64 + w) / count as f64 * total;
        let triangle = area_up_to.partition_point(|&area| area < target);
        // Rounding may push the last target past the last sum.
        sample(mesh, triangle.min(mesh.triangles.len() - 1), u.sqrt(), v)
    };
    (0..count).map(point).collect()
}

/// The point of a triangle for two numbers: `root` is the square root of a uniform one, so that area,
/// not height, is covered evenly.
fn sample(mesh: &Mesh, triangle: usize, root: f64, v: f64) -> Point {
    let weights = [1.0 - root, root * (1.0 - v), root * v];
    let blend = |corners: [[f32; 3]; 3]| {
        let terms = corners.iter().zip(weights);
        let sum = terms.map(|(&c, w)| DVec3::from(c.map(f64::from)) * w);
        sum.sum::<DVec3>().as_vec3().to_array()
    };
    let color = match mesh.colors.is_empty() {
        true => [0.5; 3],
        false => blend(mesh.triangles[triangle].map(|vertex| mesh.colors[vertex as usize])),
    };
    Point {
        position: blend(mesh.corners(triangle)),
        color,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_cover_area_evenly_and_carry_colours() {
        let mesh = Mesh {
            positions: vec![
                [0.0; 3],
                [4.0, 0.0, 0.0],
                [0.0, 4.0, 0.0],
                [0.0; 3],
                [0.0, 0.0, 2.0],
            ],
            colors: vec![[1.0, 0.0, 0.0]; 5],
            triangles: vec![[0, 1, 2], [3, 3, 3], [0, 1, 4]],
        };
        let points = points_on_mesh(&mesh, 3_000, 1);
        let upright = points.iter().filter(|p| p.position[2] > 0.0).count();
        assert!(upright.abs_diff(1_000) <= 1, "{upright}");
        let low = points.iter().filter(|p| p.position[2] == 0.0);
        let mean: f32 = low.clone().map(|p| p.position[0]).sum::<f32>() / low.count() as f32;
        assert!((mean - 4.0 / 3.0).abs() < 0.1, "{mean}");
        assert!(points.iter().all(|p| (p.color[0] - 1.0).abs() < 1e-6));
    }

    #[test]
    fn a_mesh_without_area_has_no_points() {
        assert!(points_on_mesh(&Mesh::default(), 10, 1).is_empty());
        let flat = Mesh {
            positions: vec![[1.0; 3]; 3],
            colors: vec![],
            triangles: vec![[0, 1, 2]],
        };
        assert!(points_on_mesh(&flat, 10, 1).is_empty());
    }
}
