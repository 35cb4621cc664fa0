//! Random points at the depths that the photographs agree on, for data sets without points.
//!
//! A ray through a random pixel of a photograph is swept in depth: at each depth, a small cross of pixels is seen in
//! other photographs, and the depth at which their colours agree best gives the point, the pixel its colour. Depths are
//! spaced evenly in their logarithm, for a splat's size on the screen is what counts. Photographs are reduced first.

use super::points_in_frusta;
use crate::Result;
use crate::scene::{Camera, Dataset, Point, focus};
use crate::train::config::InitConfig;
use crate::train::rng::{self, Stream};
use crate::train::thumbnails::ReducedPhoto;
use glam::DVec2;
use rayon::prelude::*;

/// Other photographs that must show a place for it to be judged.
const OTHERS_MIN: usize = 2;

/// Least difference between the best and the worst depth of a ray that tells where it ends: a plain wall, or a
/// background of one colour, does not.
const CONTRAST_MIN: f64 = 0.03;

/// Pixels of the cross about the middle one.
const CROSS: [[f64; 2]; 5] = [[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]];

/// Draws of a pixel, at most, to find one that counts.
const PIXEL_DRAWS: u32 = 4;

/// `count` points by sweeps of as many depths as configured, and grey ones in the cameras' frusta where those tell
/// nothing. Each is a pure function of the seed.
pub(super) fn points_by_sweep(
    dataset: &Dataset,
    training: &[usize],
    count: usize,
    extent: f64,
    seed: u64,
    config: &InitConfig,
) -> Result<Vec<Point>> {
    let thumbnails = ReducedPhoto::all(dataset, training)?;
    let cameras: Vec<Camera> = thumbnails.iter().map(|of| of.camera).collect();
    let focus = focus(&cameras);
    let distance = |camera: &Camera| focus.map_or(extent, |focus| camera.position.distance(focus));
    let step = cameras.len().div_ceil(config.random_cameras as usize);
    let others: Vec<usize> = (0..cameras.len()).step_by(step).collect();
    let elsewhere = points_in_frusta(&cameras, count, extent, seed, config);
    let point = |index: usize| {
        let own = index % thumbnails.len();
        let ray = DepthSweep {
            own: &thumbnails[own],
            others: others
                .iter()
                .filter(|&&other| other != own)
                .map(|&other| &thumbnails[other])
                .collect(),
            depth: distance(&cameras[own]),
            key: [seed, index as u64],
        };
        ray.point(config).unwrap_or(elsewhere[index])
    };
    Ok((0..count).into_par_iter().map(point).collect())
}

/// A ray of a photograph among the others.
struct DepthSweep<'a> {
    own: &'a ReducedPhoto,
    others: Vec<&'a ReducedPhoto>,
    /// Distance that the depths refer to, world units.
    depth: f64,
    key: [u64; 2],
}

impl DepthSweep<'_> {
    /// Point of the ray; `None` where no depth stands out.
    fn point(&self, config: &InitConfig) -> Option<Point> {
        let [seed, index] = self.key;
        let draw = |draw: u32| rng::uniform(seed, draw, index as u32, Stream::RandomInit).map(f64::from);
        let size = DVec2::new(self.own.photo.width.into(), self.own.photo.height.into());
        let pixel = |[u, v, ..]: [f64; 4]| DVec2::new(u, v) * size;
        let draws = (0..PIXEL_DRAWS).map(|i| pixel(draw(i)));
        let middle = draws.into_iter().find(|&place| self.own.color(place).is_some())?;
        let [near, far] = config.random_depths;
        // All depths of a ray are shifted alike, by a share of their spacing.
        let shift = draw(PIXEL_DRAWS)[0];
        let steps = config.random_sweep;
        let depth_at = |step: u32| {
            let share = (f64::from(step) + shift) / f64::from(steps);
            self.depth * near * (far / near).powf(share)
        };
        let errors: Vec<(f64, u32)> = (0..steps)
            .filter_map(|step| Some((self.error(middle, depth_at(step))?, step)))
            .collect();
        let best = errors
            .iter()
            .copied()
            .reduce(|best, next| if next.0 < best.0 { next } else { best })?;
        let worst = errors.iter().fold(0.0, |worst: f64, error| worst.max(error.0));
        let stands_out = worst - best.0 >= CONTRAST_MIN;
        let position = self.own.camera.position + depth_at(best.1) * self.own.camera.ray_from_pixel(middle);
        let color = self.own.color(middle)?;
        stands_out.then(|| Point {
            position: position.to_array(),
            color: color.as_vec3().to_array(),
        })
    }

    /// Mean difference of the cross's colours in the better half of the photographs that show it; `None` in too few.
    fn error(&self, middle: DVec2, depth: f64) -> Option<f64> {
        let camera = &self.own.camera;
        let cross = CROSS.map(|offset| {
            let place = middle + DVec2::from(offset);
            let position = camera.position + depth * camera.ray_from_pixel(place);
            self.own.color(place).map(|color| (position, color))
        });
        let difference = |other: &&ReducedPhoto| {
            let (mut sum, mut count) = (0.0, 0.0);
            for (position, color) in cross.into_iter().flatten() {
                let seen = other.color(other.camera.pixel_from_world(position)?)?;
                sum += (seen - color).abs().element_sum();
                count += 3.0;
            }
            (count > 0.0).then(|| sum / count)
        };
        let mut differences: Vec<f64> = self.others.iter().filter_map(difference).collect();
        if differences.len() < OTHERS_MIN {
            return None;
        }
        differences.sort_unstable_by(f64::total_cmp);
        let better = &differences[..differences.len().div_ceil(2)];
        Some(better.iter().sum::<f64>() / better.len() as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Photo, PhotoSource, View};
    use crate::train::test_camera;
    use glam::DVec3;

    /// Photographs of the plane z = 0, textured or of one colour, from a ring above it.
    fn dataset(is_textured: bool) -> Dataset {
        let level = |x: f64| (127.5 + 120.0 * x) as u8;
        let color = |p: DVec3| match is_textured {
            true => [
                level((2.3 * p.x).sin()),
                level((1.9 * p.y + 1.1 * p.x).cos()),
                level((1.7 * p.x - 2.1 * p.y).sin()),
                255,
            ],
            false => [90, 120, 30, 255],
        };
        let view = |i: u32| {
            let around = DVec2::from_angle(0.7 * f64::from(i));
            let camera = test_camera(60, 45, 60.0).look_at((2.0 * around).extend(4.0), DVec3::ZERO, DVec3::Y);
            let pixel = |place: u32| {
                let ray = camera.ray_from_pixel(DVec2::new((place % 60).into(), (place / 60).into()) + 0.5);
                color(camera.position - ray * (camera.position.z / ray.z))
            };
            View {
                name: String::new(),
                camera,
                photo: PhotoSource::Memory(Photo {
                    width: 60,
                    height: 45,
                    rgba: (0..60 * 45).map(pixel).collect(),
                }),
            }
        };
        Dataset {
            views: (0..9).map(view).collect(),
            ..Dataset::default()
        }
    }

    fn points(dataset: &Dataset) -> Result<Vec<Point>> {
        let views: Vec<usize> = (0..dataset.views.len()).collect();
        points_by_sweep(dataset, &views, 300, 4.0, 7, &InitConfig::default())
    }

    #[test]
    fn points_lie_on_a_textured_plane_in_its_colour() -> Result<()> {
        let dataset = dataset(true);
        let found = points(&dataset)?;
        assert_eq!(found, points(&dataset)?);
        // Depths of 4.5 lie a tenth apart.
        let near = found.iter().filter(|point| point.position[2].abs() < 0.5).count();
        println!("{near} of {}", found.len());
        assert!(near * 10 >= 7 * found.len(), "{near} of {}", found.len());
        assert!(found.iter().filter(|point| point.color == [0.5; 3]).count() < 30);
        Ok(())
    }

    #[test]
    fn a_plain_wall_tells_no_depth() -> Result<()> {
        let found = points(&dataset(false))?;
        assert!(found.len() == 300 && found.iter().all(|point| point.color == [0.5; 3]));
        Ok(())
    }
}
