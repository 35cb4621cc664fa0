//! Subject of the suite: a scene with cameras.

use crate::lab::bench::input::random::{Random, single};
use crate::reference;
use crate::render::ViewOptions;
use crate::scene::{Camera, SH_C0, ScreenFilter, Splats};
use glam::{DMat3, DVec2, DVec3};

/// Background colour; exact in single precision.
pub(super) const BACKGROUND: [f32; 3] = [0.125, 0.125, 0.15625];

/// A tested scene.
#[derive(Clone, Debug)]
pub struct StressScene {
    /// Splats of the device.
    pub splats: Splats,
    /// Splats of the reference: the same, unless the suite itself is tested.
    pub exact: Splats,
    /// Cameras around it, with small pictures; sweeps vary the first.
    pub cameras: Vec<Camera>,
    /// Common target of the cameras.
    pub target: DVec3,
    /// Near plane, world units.
    pub near: f64,
    /// True for the built-in scene, which allows further checks.
    pub is_made: bool,
}

/// Most splats in comparisons with the reference, which takes some microseconds for each.
const SPLATS_MAX: usize = 50_000;

/// Longest side of the pictures, px.
const SIDE: u32 = 96;

impl StressScene {
    /// A user's scene and cameras; pictures are reduced for the reference. Of a large scene every n-th splat is taken.
    ///
    /// Panics without a camera.
    pub fn of(splats: &Splats, cameras: &[Camera], target: DVec3, near: f64) -> StressScene {
        assert!(!cameras.is_empty(), "a scene is looked at from somewhere");
        let splats = thinned(splats, SPLATS_MAX);
        StressScene {
            exact: splats.clone(),
            splats,
            cameras: cameras.iter().map(|camera| reduced(camera, SIDE)).collect(),
            target,
            near: single(near),
            is_made: false,
        }
    }

    /// The built-in scene: a ball and a ring over a chequered floor, 800 splats of degree 1.
    pub fn made() -> StressScene {
        let splats = still_life();
        let camera = Camera {
            width: SIDE,
            height: 72,
            focal: DVec2::splat(96.0),
            center: DVec2::new(48.0, 36.0),
            rotation: DMat3::IDENTITY,
            position: DVec3::ZERO,
        };
        let place = |angle: f64, height: f64| {
            let position = DVec3::new(3.6 * angle.sin(), -height, -3.6 * angle.cos());
            exact(&camera.look_at(position, DVec3::ZERO, DVec3::NEG_Y))
        };
        StressScene {
            exact: splats.clone(),
            splats,
            cameras: vec![place(0.4, 1.4), place(2.5, 0.6), place(4.4, 2.6)],
            target: DVec3::ZERO,
            near: single(0.05),
            is_made: true,
        }
    }

    /// Camera varied by sweeps.
    pub fn camera(&self) -> &Camera {
        &self.cameras[0]
    }

    /// Distance of that camera from the target, world units.
    pub fn distance(&self) -> f64 {
        self.camera().position.distance(self.target)
    }

    /// The scene with its splats changed, those of the reference alike.
    pub(super) fn changed(&self, change: impl Fn(&mut Splats)) -> StressScene {
        let mut scene = self.clone();
        change(&mut scene.splats);
        change(&mut scene.exact);
        scene
    }
}

/// The camera with all numbers rounded to single precision.
pub(super) fn exact(camera: &Camera) -> Camera {
    Camera {
        focal: DVec2::from(camera.focal.to_array().map(single)),
        center: DVec2::from(camera.center.to_array().map(single)),
        rotation: DMat3::from_cols_array(&camera.rotation.to_cols_array().map(single)),
        position: DVec3::from(camera.position.to_array().map(single)),
        ..*camera
    }
}

/// The camera with pictures of this longest side, px.
pub(super) fn reduced(camera: &Camera, longest: u32) -> Camera {
    let side = camera.width.max(camera.height);
    let length = |of: u32| (of * longest).div_ceil(side).max(1);
    exact(&camera.resized(length(camera.width), length(camera.height)))
}

/// At most `most` of the splats, spread over all.
pub(super) fn thinned(splats: &Splats, most: usize) -> Splats {
    let step = splats.len().div_ceil(most).max(1);
    splats.picked(&(0..splats.len()).step_by(step).collect::<Vec<usize>>())
}

/// View options for the device.
pub(super) fn view_options(splats: &Splats, near: f64) -> ViewOptions {
    ViewOptions {
        background: BACKGROUND,
        near: near as f32,
        filter: splats.filter,
    }
}

/// Options for the reference.
pub(super) fn reference_options(splats: &Splats, near: f64) -> reference::Options {
    reference::Options {
        background: BACKGROUND.map(f64::from),
        near,
        sh_degree: splats.sh_degree,
        ..reference::Options::default()
    }
}

/// Adds a splat as a disc on a surface; `size` is its standard deviation along the surface, world units.
fn push(splats: &mut Splats, random: &mut Random, [place, normal]: [DVec3; 2], size: f64, color: [f64; 3]) {
    let turn = glam::DQuat::from_rotation_arc(DVec3::Z, normal);
    let length = random.log_between(0.5, 2.0);
    let quaternion = [turn.w, turn.x, turn.y, turn.z].map(|q| (q * length) as f32);
    let spread = [0; 2].map(|_| (size * random.log_between(0.8, 1.25)).ln() as f32);
    splats.mean.push(place.as_vec3().to_array());
    splats.quaternion.push(quaternion);
    let thin = (0.15 * size).ln() as f32;
    splats.log_scale.push([spread[0], spread[1], thin]);
    splats.opacity_logit.push(random.between(1.0, 4.0) as f32);
    splats.sh.extend(color.map(|c| (c as f32 - 0.5) / SH_C0));
    for _ in 3..splats.sh_stride() {
        splats.sh.push(random.between(-0.08, 0.08) as f32);
    }
}

fn still_life() -> Splats {
    let mut splats = Splats {
        sh_degree: 1,
        filter: ScreenFilter::Classic,
        ..Splats::default()
    };
    let random = &mut Random::new(4);
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    for i in 0..260 {
        let up = 1.0 - 2.0 * (f64::from(i) + 0.5) / 260.0;
        let (sin, cos) = (golden * f64::from(i)).sin_cos();
        let flat = (1.0 - up * up).sqrt();
        let normal = DVec3::new(flat * cos, -up, flat * sin);
        let light = 0.45 + 0.5 * normal.dot(DVec3::new(0.5, -0.75, -0.43)).max(0.0);
        let place = normal * 0.62 + DVec3::new(0.0, -0.05, 0.0);
        let color = [0.95 * light, 0.45 * light, 0.2 * light];
        push(&mut splats, random, [place, normal], 0.045, color);
    }
    for i in 0..180 {
        let around = std::f64::consts::TAU * f64::from(i) / 180.0;
        let tube = golden * f64::from(i);
        let out = DVec3::new(around.cos(), 0.0, around.sin());
        let normal = out * tube.cos() + DVec3::Y * tube.sin();
        let light = 0.55 + 0.35 * -normal.y;
        let place = out * 1.05 + normal * 0.1 + DVec3::new(0.0, 0.1, 0.0);
        let color = [0.15 * light, 0.6 * light, 0.95 * light];
        push(&mut splats, random, [place, normal], 0.05, color);
    }
    for i in 0..360 {
        let (column, row) = (f64::from(i % 20), f64::from(i / 20));
        let jitter = [0; 2].map(|_| random.between(-0.03, 0.03));
        let (x, z) = (column * 0.18 - 1.71 + jitter[0], row * 0.2 - 1.7 + jitter[1]);
        let is_light = ((x * 2.0).floor() + (z * 2.0).floor()).rem_euclid(2.0) == 0.0;
        let shade = if is_light { 0.85 } else { 0.25 };
        let place = DVec3::new(x, 0.66 + random.between(0.0, 0.01), z);
        let color = [shade, shade, shade * 0.9];
        push(&mut splats, random, [place, DVec3::NEG_Y], 0.09, color);
    }
    splats
}
