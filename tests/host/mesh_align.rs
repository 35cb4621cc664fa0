//! Alignment of depth maps by their pictures.

use super::mesh::{around, ball};
use ashfall::lab::synth::Scene;
use ashfall::mesh::{DepthMap, DepthMaps, FusionOptions, fuse};
use ashfall::scene::{Camera, Mesh};
use ashfall::{Error, Result};
use glam::Vec3;

/// Map of a scene whose depths are wrong by a factor.
fn map(scene: &Scene, camera: &Camera, factor: f32, has_texture: bool) -> DepthMap {
    let truth = scene.depth(camera);
    let depth: Vec<f32> = truth
        .iter()
        .map(|z| if z.is_finite() { factor * z } else { f32::NAN })
        .collect();
    let alpha: Vec<f32> = depth.iter().map(|z| if z.is_nan() { 0.0 } else { 1.0 }).collect();
    let rgb = match has_texture {
        true => scene.image(camera, 2),
        false => vec![[0.5; 3]; alpha.len()],
    };
    DepthMap::new(camera, &depth, &scene.normals(camera), &rgb, &alpha)
}

/// Mesh of maps of the ball, aligned or as they are.
fn fused(count: usize, is_aligned: bool, room: u64, map: impl Fn(&Camera) -> DepthMap) -> Mesh {
    let cameras = around(count, 4.0);
    let mut maps = DepthMaps::new(count, |view| Ok(map(&cameras[view]))).within(room);
    if is_aligned {
        maps.align(|| Ok(())).unwrap();
    }
    let options = FusionOptions {
        voxel: Some(0.04),
        ..FusionOptions::default()
    };
    fuse(&options, &mut maps, |_, _| Ok(())).unwrap().0
}

/// Median distance of vertices from the sphere of radius 1.
fn error(mesh: &Mesh) -> f32 {
    let distance = |at: &[f32; 3]| (Vec3::from(*at).length() - 1.0).abs();
    let mut distances: Vec<f32> = mesh.positions.iter().map(distance).collect();
    distances.sort_by(f32::total_cmp);
    distances[distances.len() / 2]
}

const COUNT: usize = 60;
const ROOM: u64 = 64 << 20;

#[test]
fn wrong_depths_are_moved_to_where_pictures_agree() {
    let of = |factor: f32, is_aligned: bool, room: u64| {
        let mesh = fused(COUNT, is_aligned, room, |camera| map(&ball(), camera, factor, true));
        error(&mesh)
    };
    for factor in [0.99, 1.01] {
        let (before, after) = (of(factor, false, ROOM), of(factor, true, ROOM));
        // Pictures of 60 × 45 pixels, in which the error is half a pixel.
        let reduced = of(factor, true, COUNT as u64 * DepthMap::bytes(60 * 45));
        println!("{factor}: {before:.5}, aligned {after:.5}, at half the size {reduced:.5}");
        assert!(before > 0.02 && after < 0.05 * before && reduced < 0.1 * before);
    }
    let (exact, aligned) = (of(1.0, false, ROOM), of(1.0, true, ROOM));
    println!("exact {exact:.5}, aligned {aligned:.5}");
    assert!(aligned < exact + 0.002);
}

#[test]
fn nothing_moves_without_texture_or_other_views() {
    let plain = |is_aligned| fused(COUNT, is_aligned, ROOM, |camera| map(&ball(), camera, 1.01, false));
    assert!(plain(true) == plain(false));
    let lone = |is_aligned| fused(1, is_aligned, ROOM, |camera| map(&ball(), camera, 1.01, true));
    assert!(!lone(true).triangles.is_empty() && lone(true) == lone(false));
}

#[test]
fn an_alignment_is_the_same_twice_and_can_be_stopped() {
    let once = || fused(8, true, ROOM, |camera| map(&ball(), camera, 1.01, true));
    assert!(once() == once());
    let cameras = around(4, 4.0);
    let mut maps = DepthMaps::new(4, |view| Ok(map(&ball(), &cameras[view], 1.0, true)));
    let stopped: Result<()> = maps.align(|| Err(Error::Config("stop".into())));
    assert!(stopped.unwrap_err().to_string().contains("stop"));
}
