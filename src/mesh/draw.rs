//! Pictures of a mesh, on the processor: the nearest triangle at each pixel's centre.

use crate::scene::{Camera, Mesh};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Picture of a mesh, row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshPicture {
    /// Colours of the vertices, interpolated; display-referred. Grey for a mesh without; the background beside it.
    pub rgb: Vec<[f32; 3]>,
    /// Depth along the view's z axis, world units; infinite beside the mesh.
    pub depth: Vec<f32>,
    /// Unit normal in the world, toward the camera; NaN beside the mesh. That of the triangle for a mesh without.
    pub normal: Vec<[f32; 3]>,
}

/// Colour of meshes without colours.
pub(super) const GREY: [f32; 3] = [0.7; 3];
/// Rows that a task draws.
const BAND: usize = 16;
/// Triangles that a task assigns to bands.
const CHUNK: usize = 1 << 14;

/// Draws a mesh from both sides. Triangles are cut at the near plane (world units, above 0); of several at one depth,
/// the first counts.
pub fn draw(mesh: &Mesh, camera: &Camera, near: f64, background: [f32; 3]) -> MeshPicture {
    let points = visible_points(mesh, camera, near);
    let shade = |point: &Option<VisiblePoint>| match point {
        None => (background, (f32::INFINITY, [f32::NAN; 3])),
        Some(point) => {
            let normal = normal(mesh, camera, point).as_vec3().to_array();
            (color(mesh, point), (point.depth as f32, normal))
        }
    };
    let (rgb, (depth, normal)) = points.par_iter().map(shade).unzip();
    MeshPicture { rgb, depth, normal }
}

/// Nearest point of a mesh at each pixel's centre, row by row from the top.
pub(super) fn visible_points(mesh: &Mesh, camera: &Camera, near: f64) -> Vec<Option<VisiblePoint>> {
    let [width, height] = [camera.width as usize, camera.height as usize];
    let projected = ProjectedMesh::new(mesh, camera, near);
    let bands = height.div_ceil(BAND);
    // Triangles of each band, of each chunk of triangles.
    let list = |(chunk, triangles): (usize, &[[u32; 3]])| {
        let mut lists: Vec<Vec<u32>> = vec![Vec::new(); bands];
        for triangle in (CHUNK * chunk) as u32..(CHUNK * chunk + triangles.len()) as u32 {
            projected.with_pieces(triangle, |piece| {
                if let Some((first, last)) = piece.rows(width, height) {
                    lists[first / BAND..=last / BAND]
                        .iter_mut()
                        .for_each(|list| list.push(triangle));
                }
            });
        }
        lists
    };
    let chunks = mesh.triangles.par_chunks(CHUNK).enumerate();
    let lists: Vec<Vec<Vec<u32>>> = chunks.map(list).collect();
    let rows = (0..bands).into_par_iter().map(|band| {
        let rows = band * BAND..(band * BAND + BAND).min(height);
        let mut nearest: Vec<Option<VisiblePoint>> = vec![None; rows.len() * width];
        for &triangle in lists.iter().flat_map(|lists| &lists[band]) {
            projected.with_pieces(triangle, |piece| {
                let Some((top, bottom)) = piece.rows(width, height) else {
                    return;
                };
                for y in top.max(rows.start)..(bottom + 1).min(rows.end) {
                    fill(piece, y, &mut nearest[(y - rows.start) * width..][..width]);
                }
            });
        }
        nearest
    });
    rows.flatten().collect()
}

/// A mesh through a camera.
struct ProjectedMesh<'a> {
    mesh: &'a Mesh,
    camera: &'a Camera,
    near: f64,
    vertices: Vec<ProjectedVertex>,
}

#[derive(Clone, Copy)]
struct ProjectedVertex {
    /// View coordinates.
    view: DVec3,
    /// Pixels; of no meaning before the near plane.
    at: DVec2,
}

impl<'a> ProjectedMesh<'a> {
    fn new(mesh: &'a Mesh, camera: &'a Camera, near: f64) -> ProjectedMesh<'a> {
        let vertex = |position: &[f32; 3]| {
            let view = camera.view_from_world(DVec3::from(position.map(f64::from)));
            ProjectedVertex {
                view,
                at: camera.pixel_from_view(view),
            }
        };
        ProjectedMesh {
            mesh,
            camera,
            near,
            vertices: mesh.positions.par_iter().map(vertex).collect(),
        }
    }

    /// Calls `with` with the parts of a triangle behind the near plane: none, one, or two.
    #[inline]
    fn with_pieces(&self, triangle: u32, mut with: impl FnMut(&ClippedTriangle)) {
        let corners = self.mesh.triangles[triangle as usize].map(|vertex| self.vertices[vertex as usize]);
        match corners.iter().filter(|corner| corner.view.z >= self.near).count() {
            0 => {}
            3 => with(&ClippedTriangle {
                triangle,
                at: corners.map(|corner| corner.at),
                inverse: corners.map(|corner| corner.view.z.recip()),
                weights: AXES,
            }),
            _ => self.clip(triangle, corners.map(|corner| corner.view), &mut with),
        }
    }

    #[cold]
    fn clip(&self, triangle: u32, corners: [DVec3; 3], with: &mut dyn FnMut(&ClippedTriangle)) {
        let mut polygon = Vec::with_capacity(4);
        for i in 0..3 {
            let (a, b) = ((corners[i], AXES[i]), (corners[(i + 1) % 3], AXES[(i + 1) % 3]));
            if a.0.z >= self.near {
                polygon.push(a);
            }
            if (a.0.z >= self.near) != (b.0.z >= self.near) {
                let share = (self.near - a.0.z) / (b.0.z - a.0.z);
                polygon.push((a.0.lerp(b.0, share), a.1.lerp(b.1, share)));
            }
        }
        for pair in polygon[1..].windows(2) {
            let fan = [polygon[0], pair[0], pair[1]];
            with(&ClippedTriangle {
                triangle,
                at: fan.map(|(view, _)| self.camera.pixel_from_view(view)),
                inverse: fan.map(|(view, _)| view.z.recip()),
                weights: fan.map(|(_, weights)| weights),
            });
        }
    }
}

/// Weights of a triangle's corners at its corners.
const AXES: [DVec3; 3] = [DVec3::X, DVec3::Y, DVec3::Z];

/// Part of a triangle behind the near plane, in pixels.
#[derive(Clone, Copy)]
struct ClippedTriangle {
    triangle: u32,
    at: [DVec2; 3],
    /// Inverse depths of the corners.
    inverse: [f64; 3],
    /// Weights of the triangle's corners in each of the piece's.
    weights: [DVec3; 3],
}

impl ClippedTriangle {
    /// First and last row with pixel centres within the piece's bounds.
    fn rows(&self, width: usize, height: usize) -> Option<(usize, usize)> {
        range(self.at.map(|at| at.x), width)?;
        range(self.at.map(|at| at.y), height)
    }
}

/// Pixels with centres between the least and the largest of three coordinates.
fn range(values: [f64; 3], count: usize) -> Option<(usize, usize)> {
    let least = values[0].min(values[1]).min(values[2]);
    let most = values[0].max(values[1]).max(values[2]);
    let first = (least - 0.5).ceil().max(0.0);
    let last = (most - 0.5).floor().min(count as f64 - 1.0);
    (first <= last).then_some((first as usize, last as usize))
}

/// Nearest point of a mesh at a pixel.
#[derive(Clone, Copy)]
pub(super) struct VisiblePoint {
    /// Depth along the view's z axis, world units.
    pub(super) depth: f64,
    pub(super) triangle: usize,
    /// Weights of the triangle's corners, of sum 1.
    pub(super) weights: DVec3,
}

/// Keeps the piece where it is the nearest in a row.
fn fill(piece: &ClippedTriangle, y: usize, line: &mut [Option<VisiblePoint>]) {
    let [a, b, c] = piece.at;
    let twice_area = (b - a).perp_dot(c - a);
    let Some((left, right)) = range(piece.at.map(|at| at.x), line.len()) else {
        return;
    };
    if twice_area == 0.0 {
        return;
    }
    for (x, nearest) in (left..).zip(&mut line[left..=right]) {
        let at = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
        let edges = [(b, c), (c, a), (a, b)].map(|(from, to)| (to - from).perp_dot(at - from) / twice_area);
        if edges.iter().any(|&share| share < 0.0) {
            continue;
        }
        // Perspective: shares over depth are linear in the image.
        let shares = [0, 1, 2].map(|i| edges[i] * piece.inverse[i]);
        let depth = shares.iter().sum::<f64>().recip();
        if nearest.is_none_or(|known| depth < known.depth) {
            let weights = shares.iter().zip(piece.weights);
            *nearest = Some(VisiblePoint {
                depth,
                triangle: piece.triangle as usize,
                weights: weights.map(|(share, of)| share * depth * of).sum(),
            });
        }
    }
}

/// Mean of the corners' values at a point.
fn interpolated(mesh: &Mesh, values: &[[f32; 3]], point: &VisiblePoint) -> DVec3 {
    let corners = mesh.triangles[point.triangle].map(|vertex| DVec3::from(values[vertex as usize].map(f64::from)));
    let weights = point.weights.to_array();
    corners.iter().zip(weights).map(|(value, weight)| weight * *value).sum()
}

fn color(mesh: &Mesh, point: &VisiblePoint) -> [f32; 3] {
    match mesh.colors.is_empty() {
        true => GREY,
        false => interpolated(mesh, &mesh.colors, point).as_vec3().to_array(),
    }
}

fn normal(mesh: &Mesh, camera: &Camera, point: &VisiblePoint) -> DVec3 {
    let [a, b, c] = mesh
        .corners(point.triangle)
        .map(|corner| DVec3::from(corner.map(f64::from)));
    let of_triangle = (b - a).cross(c - a).normalize();
    let normal = match mesh.normals.is_empty() {
        true => of_triangle,
        false => interpolated(mesh, &mesh.normals, point).normalize(),
    };
    let is_away = of_triangle.dot(a - camera.position) > 0.0;
    if is_away { -normal } else { normal }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;

    fn camera() -> Camera {
        Camera {
            width: 40,
            height: 37,
            focal: DVec2::new(30.0, 34.0),
            center: DVec2::new(19.0, 20.0),
            rotation: DMat3::from_rotation_y(0.4) * DMat3::from_rotation_x(-0.2),
            position: DVec3::new(0.3, -0.2, -3.0),
        }
    }

    /// Triangles of numbers without order, some through the camera's plane and some behind it.
    fn mesh() -> Mesh {
        let mut state = 12_345_u64;
        let mut next = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1 << 24) as f32
        };
        let mut triples = |low: f32, high: f32| {
            let one = |_| [0; 3].map(|_| low + (high - low) * next());
            (0..120).map(one).collect::<Vec<[f32; 3]>>()
        };
        // Corners around centres.
        let (centers, offsets) = (triples(-4.0, 4.0), triples(-1.5, 1.5));
        let corner = |i: usize| [0, 1, 2].map(|axis| centers[i / 3][axis] + offsets[i][axis]);
        Mesh {
            positions: (0..120).map(corner).collect(),
            colors: triples(0.0, 1.0),
            normals: Vec::new(),
            triangles: (0..40).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
        }
    }

    /// Depth and corner weights where a pixel's ray meets a triangle, by the inverse of its matrix of corners; and the
    /// distance of the weights from the edges.
    fn hit(camera: &Camera, corners: [DVec3; 3], pixel: DVec2) -> (f64, DVec3) {
        let ray = ((pixel - camera.center) / camera.focal).extend(1.0);
        let seen = corners.map(|corner| camera.view_from_world(corner));
        // Weights w with Σ w corner = z ray and Σ w = 1.
        let scaled = DMat3::from_cols_array_2d(&seen.map(|corner| corner.to_array())).inverse() * ray;
        let z = (scaled.x + scaled.y + scaled.z).recip();
        (z, z * scaled)
    }

    #[test]
    fn pixels_are_those_of_rays_through_triangles() {
        let (camera, mesh, near) = (camera(), mesh(), 0.25);
        let background = [0.1, 0.2, 0.3];
        let picture = draw(&mesh, &camera, near, background);
        let (mut drawn, mut compared) = (0, 0);
        for i in 0..picture.rgb.len() {
            let pixel = DVec2::new((i % 40) as f64 + 0.5, (i / 40) as f64 + 0.5);
            let mut nearest: Option<(f64, DVec3, usize)> = None;
            let mut is_at_edge = false;
            for index in 0..mesh.triangles.len() {
                let corners = mesh.corners(index).map(|corner| DVec3::from(corner.map(f64::from)));
                let (z, weights) = hit(&camera, corners, pixel);
                is_at_edge |= weights.min_element().abs() < 1e-9 || (z - near).abs() < 1e-9;
                let is_hit = weights.min_element() >= 0.0 && z >= near;
                if is_hit && nearest.is_none_or(|(known, ..)| z < known) {
                    nearest = Some((z, weights, index));
                }
            }
            if is_at_edge {
                continue;
            }
            compared += 1;
            let Some((z, weights, index)) = nearest else {
                assert_eq!((picture.rgb[i], picture.depth[i]), (background, f32::INFINITY), "{i}");
                assert!(picture.normal[i][0].is_nan());
                continue;
            };
            drawn += 1;
            assert!((f64::from(picture.depth[i]) / z - 1.0).abs() < 1e-6, "{i}: {z}");
            let colors = mesh.triangles[index].map(|vertex| DVec3::from(mesh.colors[vertex as usize].map(f64::from)));
            let color = weights.x * colors[0] + weights.y * colors[1] + weights.z * colors[2];
            let found = DVec3::from(picture.rgb[i].map(f64::from));
            assert!((found - color).length() < 1e-5, "{i}: {found} for {color}");
            let normal = DVec3::from(picture.normal[i].map(f64::from));
            let ray = camera.rotation.transpose() * ((pixel - camera.center) / camera.focal).extend(1.0);
            assert!(normal.dot(ray) < 1e-6 && (normal.length() - 1.0).abs() < 1e-6);
        }
        assert!(
            compared > 1400 && drawn > 250 && drawn < compared,
            "{drawn} of {compared}"
        );
    }

    #[test]
    fn a_mesh_without_colours_is_grey_and_one_behind_is_not_drawn() {
        let mut mesh = mesh();
        mesh.colors.clear();
        let picture = draw(&mesh, &camera(), 0.25, [0.0; 3]);
        assert!(picture.rgb.contains(&GREY));
        mesh.positions.iter_mut().for_each(|position| position[2] -= 100.0);
        let picture = draw(&mesh, &camera(), 0.25, [0.0; 3]);
        assert!(picture.depth.iter().all(|z| *z == f32::INFINITY));
    }
}
