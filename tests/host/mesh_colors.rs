//! Colours of meshes fitted to pictures.

use ashfall::lab::synth::icosphere;
use ashfall::mesh::{ColorFitOptions, DepthMap, DepthMaps, draw, fit_colors};
use ashfall::scene::{Camera, Mesh};
use glam::{DMat3, DVec2, DVec3, Vec3};
use std::f64::consts::FRAC_PI_6;

const OPTIONS: ColorFitOptions = ColorFitOptions {
    near: 0.1,
    distance_max: 0.02,
};
/// Colour of a mesh without colours.
const GREY: [f32; 3] = [0.7; 3];

/// A camera on the z axis turned about y, which looks at the origin from a distance of 4.
fn camera(angle: f64) -> Camera {
    let rotation = DMat3::from_rotation_y(angle);
    Camera {
        width: 192,
        height: 160,
        focal: DVec2::new(300.0, 300.0),
        center: DVec2::new(95.0, 81.0),
        rotation,
        position: rotation.transpose() * DVec3::new(0.0, 0.0, -4.0),
    }
}

fn cameras() -> Vec<Camera> {
    (0..12).map(|i| camera(f64::from(i) * FRAC_PI_6)).collect()
}

/// Ripples of many vertices' length.
fn ripple(at: &[f32; 3]) -> [f32; 3] {
    [0, 1, 2].map(|axis| 0.5 + 0.3 * (5.0 * at[axis]).sin())
}

/// A ball with ripples around another ball, which is nowhere visible.
fn balls() -> (Mesh, usize) {
    let mut mesh = icosphere(4);
    let outer = mesh.positions.len();
    let inner = icosphere(2);
    let half = |at: &[f32; 3]| at.map(|x| x / 2.0);
    mesh.positions.extend(inner.positions.iter().map(half));
    let moved = |corners: &[u32; 3]| corners.map(|vertex| vertex + outer as u32);
    mesh.triangles.extend(inner.triangles.iter().map(moved));
    mesh.colors = mesh.positions.iter().map(ripple).collect();
    mesh.normals.clear();
    (mesh, outer)
}

fn map(mesh: &Mesh, camera: &Camera) -> DepthMap {
    let picture = draw(mesh, camera, OPTIONS.near, [0.0; 3]);
    let is_covered = picture.depth.iter().map(|z| z.is_finite());
    let alpha: Vec<f32> = is_covered.map(|covered| if covered { 1.0 } else { 0.0 }).collect();
    DepthMap::new(camera, &picture.depth, &picture.normal, &picture.rgb, &alpha)
}

fn fitted(mesh: &mut Mesh, count: usize, map: impl Fn(usize) -> DepthMap) {
    let mut maps = DepthMaps::new(count, |view| Ok(map(view)));
    fit_colors(mesh, OPTIONS, &mut maps, |_| Ok(())).unwrap();
}

#[test]
fn colours_of_visible_vertices_come_back_and_others_stay() {
    let (truth, outer) = balls();
    let cameras = cameras();
    let mut mesh = truth.clone();
    mesh.colors.clear();
    fitted(&mut mesh, cameras.len(), |view| map(&truth, &cameras[view]));
    // Poles are seen at low angles.
    let is_seen = |at: &[f32; 3]| Vec3::from(*at).length() > 0.9 && at[1].abs() < 0.7;
    let (mut seen, mut worst) = (0, 0.0_f32);
    for ((at, color), truth) in mesh.positions.iter().zip(&mesh.colors).zip(&truth.colors) {
        if is_seen(at) {
            seen += 1;
            worst = worst.max((Vec3::from(*color) - Vec3::from(*truth)).abs().max_element());
        }
    }
    println!("{seen} vertices, off by {worst} at most");
    // Rounding to 8 bits, and the weight of the colours before.
    assert!(seen > 1500 && worst < 0.02, "{worst}");
    assert_eq!(mesh.colors[outer..], vec![GREY; truth.colors.len() - outer]);
}

#[test]
fn pixels_with_another_surface_do_not_count() {
    let (truth, _) = balls();
    let cameras = cameras();
    let mut alike = truth.clone();
    alike.colors.fill(GREY);
    let mut mesh = alike.clone();
    fitted(&mut alike, cameras.len(), |view| map(&truth, &cameras[view]));
    // A black wall before the ball in a further view.
    fitted(&mut mesh, cameras.len() + 1, |view| {
        let mut map = map(&truth, cameras.get(view).unwrap_or(&cameras[0]));
        if view == cameras.len() {
            map.depth.fill(2.0);
            map.color.fill([0, 0, 0, 255]);
        }
        map
    });
    assert!(mesh == alike);
}
