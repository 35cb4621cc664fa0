//! Scenes from sketches. All numbers are exact in `f32`, for equal inputs of device and oracle.

use super::random::Random;
use super::volume::camera;
use crate::reference::Options;
use crate::scene::{Camera, Dataset, Photo, PhotoSource, Point, Primitive, SH_C0, ScreenFilter, Splats, View};
use glam::DVec2;

/// Splats with a camera and options.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The splats.
    pub splats: Splats,
    /// The camera.
    pub camera: Camera,
    /// Background, near plane, degree; the engine's thresholds.
    pub options: Options,
}

/// A splat in screen terms, for authors of scenes.
#[derive(Clone, Copy, Debug)]
pub struct Sketch {
    /// Projected centre, pixels; may lie outside the image.
    pub pixel: DVec2,
    /// z in the view; may be negative.
    pub depth: f64,
    /// Standard deviation along each local axis, projected face on, pixels.
    pub sigma: [f64; 3],
    /// Opacity's logit.
    pub opacity_logit: f64,
    /// Colour of the constant term.
    pub color: [f64; 3],
}

/// Appends a splat with a random orientation and random higher harmonics.
pub fn push(splats: &mut Splats, camera: &Camera, sketch: &Sketch, random: &mut Random) {
    let ray = ((sketch.pixel - camera.center) / camera.focal).extend(1.0);
    let mean = camera.position + camera.rotation.transpose() * (ray * sketch.depth);
    let world_per_pixel = sketch.depth.abs() / camera.focal.x;
    let length = random.log_between(0.5, 2.0);
    splats.mean.push(mean.to_array().map(|x| x as f32));
    splats
        .quaternion
        .push([0; 4].map(|_| (random.normal() * length) as f32));
    splats
        .log_scale
        .push(sketch.sigma.map(|s| (s * world_per_pixel).ln() as f32));
    splats.opacity_logit.push(sketch.opacity_logit as f32);
    splats.sh.extend(sketch.color.map(|c| (c as f32 - 0.5) / SH_C0));
    for _ in 3..splats.sh_stride() {
        splats.sh.push(random.between(-0.06, 0.06) as f32);
    }
}

/// The scene with its splats as surfels.
pub fn flattened(mut scene: Scene) -> Scene {
    scene.splats.primitive = Primitive::Surfel;
    scene.splats.set_thickness();
    scene
}

/// `count` splats all over an image, with standard deviations log-uniform from 1 px to `sigma_max`.
pub fn scattered(count: usize, [width, height]: [u32; 2], sigma_max: f64, sh_degree: u32) -> Scene {
    let random = &mut Random::new(7);
    let size = DVec2::new(width.into(), height.into());
    let camera = camera([width, height]);
    let mut splats = Splats {
        sh_degree,
        filter: ScreenFilter::Classic,
        ..Splats::default()
    };
    for _ in 0..count {
        let sketch = Sketch {
            pixel: DVec2::new(random.between(0.0, size.x), random.between(0.0, size.y)),
            depth: random.between(2.0, 20.0),
            sigma: [0; 3].map(|_| random.log_between(1.0, sigma_max)),
            opacity_logit: random.between(-3.0, 3.0),
            color: [0; 3].map(|_| random.between(0.0, 1.0)),
        };
        push(&mut splats, &camera, &sketch, random);
    }
    let options = Options {
        near: 0.1,
        sh_degree,
        ..Options::default()
    };
    Scene {
        splats,
        camera,
        options,
    }
}

/// Data set of one view, with an extent of 1.1 times `distance`, at which its only point lies ahead.
pub fn one_view(camera: Camera, photo: Photo, distance: f64) -> Dataset {
    let ahead = camera.rotation.row(2) * distance;
    let view = View {
        name: "view".into(),
        camera,
        photo: PhotoSource::Memory(photo),
    };
    let point = Point {
        position: (camera.position + ahead).to_array(),
        color: [0.5; 3],
    };
    Dataset {
        views: vec![view],
        points: vec![point],
        ..Dataset::default()
    }
}
