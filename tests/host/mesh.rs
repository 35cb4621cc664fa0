//! Fusion of exact depth maps: the floor of every mesh.

use ashfall::lab::synth::{Material, Object, Scene, Shape, Texture, icosphere};
use ashfall::mesh::{
    ComparisonOptions, DepthMap, DepthMaps, FusionOptions, FusionPhase, FusionReport, clean, compare, components, fuse,
};
use ashfall::scene::{Camera, Mesh};
use ashfall::{Error, Result};
use glam::{DMat3, DVec2, DVec3, Vec3};
use std::collections::BTreeMap;

/// A camera at a place that looks at a point.
fn camera(position: DVec3, target: DVec3) -> Camera {
    let forward = (target - position).normalize();
    let right = forward.any_orthonormal_vector();
    let down = forward.cross(right);
    Camera {
        width: 120,
        height: 90,
        focal: DVec2::new(110.0, 120.0),
        center: DVec2::new(57.0, 48.0),
        rotation: DMat3::from_cols(right, down, forward).transpose(),
        position,
    }
}

fn map(scene: &Scene, camera: &Camera) -> DepthMap {
    let depth: Vec<f32> = scene
        .depth(camera)
        .iter()
        .map(|z| if z.is_finite() { *z } else { f32::NAN })
        .collect();
    let normal: Vec<[f32; 3]> = scene.normals(camera);
    let alpha: Vec<f32> = depth.iter().map(|z| if z.is_nan() { 0.0 } else { 1.0 }).collect();
    let color = [0.8, 0.4, 0.2];
    let rgb: Vec<[f32; 3]> = alpha.iter().map(|a| color.map(|c| c * a)).collect();
    DepthMap::new(camera, &depth, &normal, &rgb, &alpha)
}

fn fused(scene: &Scene, cameras: &[Camera], options: &FusionOptions) -> (Mesh, FusionReport) {
    fuse(
        options,
        &mut DepthMaps::new(cameras.len(), |view| Ok(map(scene, &cameras[view]))),
        |_, _| Ok(()),
    )
    .unwrap()
}

fn matt() -> Material {
    Material::matt(Texture::ripples([0.5; 3], 0.2, 0.1, 1))
}

pub(super) fn ball() -> Scene {
    Scene {
        objects: vec![Object::new(Shape::Sphere(1.0), matt())],
        ..Scene::default()
    }
}

/// Cameras all around the origin, on a spiral.
pub(super) fn around(count: usize, distance: f64) -> Vec<Camera> {
    let place = |i: usize| {
        let z = 1.0 - 2.0 * (i as f64 + 0.5) / count as f64;
        let angle = 2.399_963 * i as f64;
        let flat = (1.0 - z * z).sqrt();
        camera(
            distance * DVec3::new(flat * angle.cos(), flat * angle.sin(), z),
            DVec3::ZERO,
        )
    };
    (0..count).map(place).collect()
}

fn options(voxel: f64) -> FusionOptions {
    FusionOptions {
        voxel: Some(voxel),
        ..FusionOptions::default()
    }
}

/// Faces of each edge: by its ends, the number of triangles that run along it and against it.
fn edges(mesh: &Mesh) -> BTreeMap<[u32; 2], [u32; 2]> {
    let mut edges: BTreeMap<[u32; 2], [u32; 2]> = BTreeMap::new();
    for t in &mesh.triangles {
        for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            assert_ne!(a, b, "a triangle without area");
            edges.entry([a.min(b), a.max(b)]).or_default()[usize::from(a > b)] += 1;
        }
    }
    edges
}

#[track_caller]
fn check_manifold(mesh: &Mesh) -> usize {
    let edges = edges(mesh);
    let sound = |faces: &&[u32; 2]| faces[0] <= 1 && faces[1] <= 1;
    assert!(
        edges.values().all(|faces| sound(&faces)),
        "an edge of more than two triangles"
    );
    edges.values().filter(|faces| faces[0] + faces[1] == 1).count()
}

#[test]
fn a_sphere_is_exact_to_a_tenth_of_a_voxel() {
    let voxel = 0.05;
    let (mesh, report) = fused(&ball(), &around(24, 4.0), &options(voxel));
    assert_eq!(report.slabs, 1);
    assert!(mesh.triangles.len() > 5_000, "{} triangles", mesh.triangles.len());
    let (mut mean, mut worst, mut worst_normal) = (0.0f64, 0.0f64, 0.0f32);
    for (position, normal) in mesh.positions.iter().zip(&mesh.normals) {
        let position = Vec3::from(*position);
        let off = f64::from((position.length() - 1.0).abs());
        mean += off / mesh.positions.len() as f64;
        worst = worst.max(off);
        let angle = position.normalize().dot(Vec3::from(*normal)).clamp(-1.0, 1.0).acos();
        worst_normal = worst_normal.max(angle.to_degrees());
    }
    println!(
        "sphere: mean {:.4} and at most {:.4} voxels, normals to {worst_normal:.3}°",
        mean / voxel,
        worst / voxel
    );
    assert!(
        mean <= 0.1 * voxel && worst <= 0.5 * voxel,
        "mean {mean}, worst {worst}"
    );
    // Seen from all sides: closed, of one piece, without a hole through it.
    assert_eq!(check_manifold(&mesh), 0, "open edges");
    assert_eq!(
        mesh.positions.len() + mesh.triangles.len() - edges(&mesh).len(),
        2,
        "Euler's number"
    );
    assert_eq!(components(&mesh).len(), 1);
    for (i, t) in mesh.triangles.iter().enumerate() {
        let [a, b, c] = mesh.corners(i).map(Vec3::from);
        assert!((b - a).cross(c - a).dot(a) > 0.0, "triangle {t:?} faces inward");
    }
    let red = mesh
        .colors
        .iter()
        .all(|c| (c[0] - 0.8).abs() < 0.01 && (c[2] - 0.2).abs() < 0.01);
    assert!(red, "not the colour of the maps");
    let mean_normal = worst_normal;
    assert!(mean_normal < 3.0, "a normal is off by {mean_normal}°");
}

#[test]
fn a_plane_is_exact_and_not_shifted() {
    let slope = DMat3::from_rotation_y(0.4) * DMat3::from_rotation_x(0.2);
    let plane = Object::new(Shape::Rectangle(DVec2::new(1.5, 1.0)), matt()).turned(slope);
    let scene = Scene {
        objects: vec![plane.at(0.1, -0.2, 0.3)],
        ..Scene::default()
    };
    let normal = slope * DVec3::Z;
    let cameras: Vec<Camera> = [[0.0, 0.0, 4.0], [1.5, 0.5, 3.5], [-1.0, 1.0, 4.0], [0.4, -1.5, 3.0]]
        .into_iter()
        .map(|place| camera(1.3 * DVec3::from(place), DVec3::ZERO))
        .collect();
    let voxel = 0.04;
    let (mesh, _) = fused(&scene, &cameras, &options(voxel));
    assert!(mesh.triangles.len() > 2_000, "{} triangles", mesh.triangles.len());
    let mut bounds = [DVec2::INFINITY, DVec2::NEG_INFINITY];
    for (position, own) in mesh.positions.iter().zip(&mesh.normals) {
        let local = slope.transpose() * (DVec3::from(position.map(f64::from)) - DVec3::new(0.1, -0.2, 0.3));
        bounds = [bounds[0].min(local.truncate()), bounds[1].max(local.truncate())];
        let inner = local.x.abs() < 1.3 && local.y.abs() < 0.8;
        assert!(
            local.z.abs() < if inner { 0.02 } else { 0.5 } * voxel,
            "off by {} at {local}",
            local.z
        );
        let cosine = normal.dot(DVec3::from(own.map(f64::from)));
        assert!(!inner || cosine > 0.9999, "normal {own:?}");
    }
    // The border is where the last pixels are, within a pixel and a voxel.
    let reach = 6.0 / 110.0 + 1.8 * voxel;
    let apart = (bounds[0] + DVec2::new(1.5, 1.0))
        .abs()
        .max((bounds[1] - DVec2::new(1.5, 1.0)).abs());
    assert!(apart.max_element() < reach, "{bounds:?}");
    assert!(check_manifold(&mesh) > 100, "a plane has a border");
}

#[test]
fn a_side_that_no_view_sees_stays_open() {
    let cameras = vec![camera(DVec3::new(0.0, 0.0, 4.0), DVec3::ZERO)];
    let (mesh, _) = fused(&ball(), &cameras, &options(0.05));
    assert!(check_manifold(&mesh) > 20, "a half has a border");
    let lowest = mesh.positions.iter().map(|p| p[2]).fold(f32::INFINITY, f32::min);
    // The silhouette from a distance of 4 is at 1/4; depths at less than 10 degrees are left out.
    assert!(lowest > 0.2, "a back at {lowest}");
    assert!(
        mesh.positions
            .iter()
            .all(|p| (Vec3::from(*p).length() - 1.0).abs() < 0.05)
    );
}

#[test]
fn a_closed_mesh_has_no_border() {
    let closed = |voxel: f64| FusionOptions {
        closed: true,
        ..options(voxel)
    };
    let volume = |mesh: &Mesh| -> f64 {
        let corners = (0..mesh.triangles.len()).map(|i| mesh.corners(i).map(|c| DVec3::from(c.map(f64::from))));
        corners.map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
    };
    // Seen from all sides it is a full ball, without a shell inside.
    let voxel = 0.05;
    let (mesh, _) = fused(&ball(), &around(24, 4.0), &closed(voxel));
    assert_eq!(check_manifold(&mesh), 0, "open edges");
    assert_eq!(components(&mesh).len(), 1);
    assert_eq!(
        mesh.positions.len() + mesh.triangles.len() - edges(&mesh).len(),
        2,
        "Euler's number"
    );
    let full = 4.0 / 3.0 * std::f64::consts::PI;
    assert!((volume(&mesh) / full - 1.0).abs() < 0.01, "{}", volume(&mesh));
    // Seen from one side it has a back, and the front stays.
    let one = vec![camera(DVec3::new(0.0, 0.0, 4.0), DVec3::ZERO)];
    let (mesh, _) = fused(&ball(), &one, &closed(voxel));
    assert_eq!(check_manifold(&mesh), 0, "open edges");
    assert!(volume(&mesh) > 0.05 && volume(&mesh) < 0.5 * full, "{}", volume(&mesh));
    let front = mesh
        .positions
        .iter()
        .filter(|p| (Vec3::from(**p).length() - 1.0).abs() < 0.01)
        .count();
    assert!(front > 1_000, "{front} vertices on the sphere");
    // In slabs it is the same.
    let (whole, report) = fused(&ball(), &around(10, 4.0), &closed(0.03));
    let parts = FusionOptions {
        memory: report.slab_bytes / 2,
        ..closed(0.03)
    };
    let (mesh, report) = fused(&ball(), &around(10, 4.0), &parts);
    assert!(report.slabs > 1 && mesh == whole, "slabs make a difference");
    assert_eq!(check_manifold(&mesh), 0, "open edges");
}

#[test]
fn a_room_seen_from_within_stays_hollow() {
    let mut room = ball();
    room.objects[0].scale = 2.0;
    // Cameras in the middle that look everywhere; walls face them.
    let cameras: Vec<Camera> = around(30, 0.1)
        .iter()
        .map(|c| camera(c.position, 9.0 * c.position))
        .collect();
    let closed = FusionOptions {
        closed: true,
        ..options(0.1)
    };
    let (mesh, _) = fused(&room, &cameras, &closed);
    assert_eq!(check_manifold(&mesh), 0, "open edges");
    // The wall, and its back outside.
    let inner = mesh
        .positions
        .iter()
        .filter(|p| (Vec3::from(**p).length() - 2.0).abs() < 0.02)
        .count();
    let middle = mesh.positions.iter().filter(|p| Vec3::from(**p).length() < 1.9).count();
    assert!(
        inner > 2_000 && middle == 0,
        "{inner} vertices on the wall, {middle} within"
    );
}

#[test]
fn slabs_and_redrawn_views_give_the_same_mesh() {
    let cameras = around(10, 4.0);
    let voxel = 0.03;
    let (whole, report) = fused(&ball(), &cameras, &options(voxel));
    assert_eq!(whole, fused(&ball(), &cameras, &options(voxel)).0, "not the same twice");
    let parts = FusionOptions {
        memory: report.slab_bytes / 2,
        ..options(voxel)
    };
    let mut drawn = 0;
    let draw = |view: usize| {
        drawn += 1;
        Ok(map(&ball(), &cameras[view]))
    };
    let mut phases = Vec::new();
    let mut maps = DepthMaps::new(cameras.len(), draw).within(DepthMap::bytes(120 * 90) * 3);
    let (mesh, report) = fuse(&parts, &mut maps, |phase, view| {
        phases.push((phase, view));
        Ok(())
    })
    .unwrap();
    drop(maps);
    assert!(report.slabs > 1 && report.slab_bytes <= parts.memory);
    assert!(drawn > 20, "{drawn} views drawn: all were kept");
    assert_eq!(phases.len(), (2 + report.slabs) * 10);
    assert_eq!(phases[10], (FusionPhase::List, 0));
    assert!(mesh == whole, "slabs make a difference");
}

#[test]
fn faults_are_told_in_one_line() {
    let cameras = around(4, 4.0);
    let told = |options: &FusionOptions, scene: &Scene| -> String {
        let draw = |view: usize| Ok(map(scene, &cameras[view]));
        let fused = fuse(options, &mut DepthMaps::new(4, draw), |_, _| Ok(()));
        fused.unwrap_err().to_string()
    };
    assert!(told(&options(0.1), &Scene::default()).contains("no view has a surface"));
    let tight = FusionOptions {
        memory: 1 << 20,
        ..options(1e-3)
    };
    let told_memory = told(&tight, &ball());
    assert!(told_memory.contains("--voxel"), "{told_memory}");
    assert!(told(&options(1e-12), &ball()).contains("too small"));
    let stop = fuse(
        &options(0.1),
        &mut DepthMaps::new(4, |view| Ok(map(&ball(), &cameras[view]))),
        |phase, view| match (phase, view) {
            (FusionPhase::List, 2) => Err(Error::Config("stop".into())),
            _ => Ok(()),
        },
    );
    let stop: Result<()> = stop.map(|_| ());
    assert!(stop.unwrap_err().to_string().contains("stop"));
}

#[test]
fn a_world_of_another_size_has_the_same_mesh() {
    let (small, _) = fused(&ball(), &around(8, 4.0), &options(0.08));
    let mut large = ball();
    large.objects[0].scale = 1000.0;
    let (large, _) = fused(&large, &around(8, 4000.0), &options(80.0));
    assert_eq!(small.triangles, large.triangles);
    let apart = |(a, b): (&[f32; 3], &[f32; 3])| (Vec3::from(*a) - Vec3::from(*b) / 1000.0).length();
    let worst = small
        .positions
        .iter()
        .zip(&large.positions)
        .map(apart)
        .fold(0.0, f32::max);
    println!("scaled by 1000: apart by {worst:.1e}");
    assert!(worst < 1e-5, "{worst}");
}

#[test]
fn small_pieces_go() {
    let (ball, _) = fused(&ball(), &around(24, 4.0), &options(0.1));
    let mut mesh = ball.clone();
    let first = mesh.positions.len() as u32;
    // A second one, far smaller, and a lone triangle.
    for p in &ball.positions {
        mesh.positions.push([p[0] * 0.3 + 5.0, p[1] * 0.3, p[2] * 0.3]);
    }
    mesh.triangles
        .extend(ball.triangles.iter().map(|t| t.map(|v| v + first)));
    let lone = mesh.positions.len() as u32;
    mesh.positions
        .extend([[9.0, 0.0, 0.0], [9.0, 0.1, 0.0], [9.0, 0.0, 0.1], [0.0; 3]]);
    mesh.triangles.push([lone, lone + 1, lone + 2]);
    mesh.normals = vec![[0.0, 0.0, 1.0]; mesh.positions.len()];
    mesh.colors.clear();
    let sizes: Vec<usize> = components(&mesh).iter().map(|c| c.triangles).collect();
    assert_eq!(sizes, [ball.triangles.len(), ball.triangles.len(), 1]);
    let mut kept = mesh.clone();
    assert_eq!(clean(&mut kept, None), 1);
    assert_eq!(kept.triangles.len(), 2 * ball.triangles.len());
    assert_eq!(
        (kept.positions.len(), kept.normals.len()),
        (lone as usize, lone as usize)
    );
    assert_eq!(clean(&mut mesh, Some(1)), 2);
    assert_eq!(mesh.positions, ball.positions);
    assert_eq!(mesh.triangles, ball.triangles);
    let mut nothing = Mesh::default();
    assert_eq!(clean(&mut nothing, Some(3)), 0);
}

fn scored(mesh: &Mesh, truth: &Mesh, cameras: Vec<Camera>) -> ashfall::mesh::MeshComparison {
    let options = ComparisonOptions {
        samples: 20_000,
        threshold: Some(0.03),
        cameras,
        ..ComparisonOptions::default()
    };
    compare(mesh, DVec3::ZERO, truth, &options).unwrap()
}

#[test]
fn a_larger_sphere_is_as_far_as_it_is_larger() {
    let truth = icosphere(4);
    let mut mesh = truth.clone();
    mesh.positions.iter_mut().flatten().for_each(|x| *x *= 1.02);
    let found = scored(&mesh, &truth, Vec::new());
    // Facets of the sphere are up to 1e-3 below it.
    for summary in [&found.accuracy, &found.completeness] {
        assert!(
            (summary.mean - 0.02).abs() < 1e-4 && (summary.max - 0.02).abs() < 1e-3,
            "{summary:?}"
        );
        assert_eq!(summary.points, 20_000);
    }
    assert!((found.chamfer - 0.02).abs() < 1e-4);
    let f1: Vec<f64> = found.scores.iter().map(|score| score.f1).collect();
    assert_eq!(f1, [0.0, 1.0, 1.0, 1.0], "at 0.015, 0.03, 0.045 and 0.09");
    assert!((found.diagonal - 12f64.sqrt()).abs() < 1e-6 && found.footprint.is_none());
    assert!(found.normal_deg.mean < 1.0 && found.normal_deg.mean_outward < 1.0);
    let mut inward = mesh.clone();
    inward.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    let inward = scored(&inward, &truth, Vec::new()).normal_deg;
    assert!(inward.mean < 1.0 && inward.mean_outward > 179.0, "{inward:?}");
}

#[test]
fn cameras_choose_the_points_that_count() {
    let truth = icosphere(4);
    let mut front = truth.clone();
    let is_front = |t: &[u32; 3]| t.iter().all(|&v| truth.positions[v as usize][2] > 0.1);
    front.triangles.retain(is_front);
    let all = scored(&front, &truth, Vec::new());
    assert!(
        (all.scores[1].recall - 0.47).abs() < 0.05 && all.scores[1].precision == 1.0,
        "{all:?}"
    );
    assert!(all.completeness.max > 0.9, "the back is a hole");
    // Two cameras on one side see what is above 1/4.
    let cameras = [0.05, -0.05].map(|x| camera(DVec3::new(x, 0.0, 4.0), DVec3::ZERO));
    let seen = scored(&front, &truth, cameras.to_vec());
    assert!(
        seen.scores[1].recall == 1.0 && seen.scores[1].precision == 1.0,
        "{seen:?}"
    );
    assert!(
        seen.completeness.points < 9_000 && seen.completeness.points > 5_000,
        "{seen:?}"
    );
    // From a distance of 3 to 3.75 at a focal length of 120.
    assert!(seen.footprint.is_some_and(|p| p > 3.0 / 120.0 && p < 3.8 / 120.0));
    let one = ComparisonOptions {
        samples: 1_000,
        cameras: cameras[..1].to_vec(),
        ..ComparisonOptions::default()
    };
    let told = compare(&front, DVec3::ZERO, &truth, &one).unwrap_err().to_string();
    assert!(told.contains("no two cameras"), "{told}");
    let lost = compare(
        &front,
        DVec3::splat(90.0),
        &truth,
        &ComparisonOptions {
            cameras: cameras.to_vec(),
            ..one
        },
    );
    assert!(lost.unwrap_err().to_string().contains("no point of the mesh"));
}
