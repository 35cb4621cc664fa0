//! A camera in the hand: it turns about a target, moves, flies, and jumps to cameras of a data set.

use ashfall::Camera;
use glam::{DMat3, DQuat, DVec2, DVec3};
use serde_json::{Value, json};

pub(crate) struct Rig {
    /// With its own image size, which is fitted into the window's.
    pub(crate) camera: Camera,
    /// Centre of the orbit, anywhere in front of the camera.
    pub(crate) target: DVec3,
}

impl Rig {
    /// Before splats, upright.
    pub(crate) fn before(center: DVec3, radius: f64, up: DVec3) -> Rig {
        let camera = Camera {
            width: 960,
            height: 720,
            focal: DVec2::splat(960.0),
            center: DVec2::new(480.0, 360.0),
            rotation: DMat3::IDENTITY,
            position: DVec3::ZERO,
        };
        let side = up.any_orthonormal_vector();
        Rig {
            camera: camera.look_at(center + 2.5 * radius * (side + 0.3 * up), center, up),
            target: center,
        }
    }

    /// Jumps to a camera, the target at the depth of `focus`, or at a distance without one.
    pub(crate) fn jump(&mut self, camera: &Camera, focus: Option<DVec3>, distance: f64) {
        let depth = focus.map_or(0.0, |focus| camera.view_from_world(focus).z);
        let depth = if depth > 0.0 { depth } else { distance };
        self.target = camera.position + depth * camera.rotation.row(2);
        self.camera = *camera;
    }

    /// Distance from camera to target.
    pub(crate) fn distance(&self) -> f64 {
        self.camera.position.distance(self.target)
    }

    /// Turns about the target, by angles about the camera's vertical and horizontal axes.
    pub(crate) fn orbit(&mut self, yaw: f64, pitch: f64) {
        let [right, down] = [0, 1].map(|row| self.camera.rotation.row(row));
        self.turn(DQuat::from_axis_angle(down, yaw) * DQuat::from_axis_angle(right, pitch));
    }

    /// Turns the picture about the target.
    pub(crate) fn roll(&mut self, angle: f64) {
        self.turn(DQuat::from_axis_angle(self.camera.rotation.row(2), angle));
    }

    fn turn(&mut self, turn: DQuat) {
        let camera = &mut self.camera;
        camera.position = self.target + turn * (camera.position - self.target);
        camera.rotation *= DMat3::from_quat(turn).transpose();
    }

    /// Moves camera and target by camera axes: right, down, ahead.
    pub(crate) fn fly(&mut self, by: DVec3) {
        let by = self.camera.rotation.transpose() * by;
        self.camera.position += by;
        self.target += by;
    }

    /// Scales the distance to the target.
    pub(crate) fn dolly(&mut self, factor: f64) {
        let away = self.camera.position - self.target;
        self.camera.position = self.target + factor * away;
    }

    /// Scales the focal lengths.
    pub(crate) fn zoom(&mut self, factor: f64) {
        self.camera.focal *= factor;
    }

    /// Where the camera's image lies in a window: left, top, right, bottom.
    pub(crate) fn area(&self, [width, height]: [u32; 2]) -> [i32; 4] {
        let scale = self.scale([width, height]);
        let half = |of: u32| 0.5 * f64::from(of);
        let edges = |window: u32, image: u32| {
            let (middle, reach) = (half(window), scale * half(image));
            [(middle - reach).round() as i32, (middle + reach).round() as i32]
        };
        let ([left, right], [top, bottom]) = (edges(width, self.camera.width), edges(height, self.camera.height));
        [left, top, right, bottom]
    }

    /// The camera of a window that shows the whole of its image.
    pub(crate) fn fitted(&self, [width, height]: [u32; 2]) -> Camera {
        let scale = self.scale([width, height]);
        let half = |width: u32, height: u32| 0.5 * DVec2::new(width.into(), height.into());
        let camera = &self.camera;
        Camera {
            width,
            height,
            focal: camera.focal * scale,
            center: half(width, height) + (camera.center - half(camera.width, camera.height)) * scale,
            ..*camera
        }
    }

    fn scale(&self, [width, height]: [u32; 2]) -> f64 {
        let ratio = |window: u32, image: u32| f64::from(window) / f64::from(image);
        ratio(width, self.camera.width).min(ratio(height, self.camera.height))
    }
}

/// Cameras as a `camera_path.json` of nerfstudio, in a world with this origin.
pub(crate) fn path_document(cameras: &[Camera], origin: DVec3) -> Value {
    let key = |camera: &Camera| {
        let [right, down, ahead] = [0, 1, 2].map(|row| camera.rotation.row(row));
        let (up, back, place) = (-down, -ahead, camera.position + origin);
        let row = |i: usize| [right[i], up[i], back[i], place[i]];
        let matrix = [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]].concat();
        let field = 2.0 * (0.5 * f64::from(camera.height) / camera.focal.y).atan();
        json!({ "camera_to_world": matrix, "fov": field.to_degrees() })
    };
    let last = cameras.last();
    json!({
        "camera_type": "perspective",
        "render_width": last.map_or(1, |camera| camera.width),
        "render_height": last.map_or(1, |camera| camera.height),
        "fps": 30,
        "is_cycle": false,
        "camera_path": cameras.iter().map(key).collect::<Vec<_>>(),
    })
}
