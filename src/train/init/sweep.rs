//! Random points at the depths that the photographs agree on, for data sets without points.
//!
//! A ray through a random pixel of a photograph is swept in depth: at each depth, a small cross of pixels is seen in
//! other photographs, and the depth at which their colours agree best gives the point, the pixel its colour. Depths are
//! spaced evenly in their logarithm, for a splat's size on the screen is what counts; between them the errors are taken
//! for a parabola. A ray that tells no depth, or another one than its neighbours in the photograph, or a point before
//! what most other photographs show there, is left out: splats at wrong depths before the cameras stay as floaters.
//! Photographs are reduced first.

use super::points_in_frusta;
use crate::Result;
use crate::scene::{Camera, Dataset, Point, focus};
use crate::stats::quantile;
use crate::train::config::InitConfig;
use crate::train::rng::{self, Stream};
use crate::train::thumbnails::ReducedPhoto;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Other photographs that must show a place for it to be judged.
const OTHERS_MIN: usize = 2;

/// Least difference between the best and the worst depth of a ray that tells where it ends: a plain wall, or a
/// background of one colour, does not.
const CONTRAST_MIN: f64 = 0.03;

/// Largest share that the error of the best depth may be of that of any other place on the ray: patterns that repeat
/// agree in several.
const RIVAL_MAX: f64 = 0.7;

/// Error between equal colours that rounding to 8 bits explains: places closer than it agree alike, as a background of
/// one colour does at any depth.
const ROUNDING: f64 = 1.0 / 255.0;

/// Distance in steps from the best depth at which another place begins.
const RIVAL_STEPS: usize = 3;

/// Nearest rays of a photograph with whose median depth a ray must agree.
const NEIGHBORS: usize = 5;

/// Largest difference from it, of the logarithm; one that is nearer by more is before it.
const DEVIATION_MAX: f64 = 0.15;

/// Rays for each point, at most; with more the photographs tell nothing.
const RAYS_PER_POINT_MAX: usize = 20;

/// Pixels of the cross about the middle one.
const CROSS: [[f64; 2]; 5] = [[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]];

/// Draws of a pixel, at most, to find one that counts.
const PIXEL_DRAWS: u32 = 4;

/// At most `count` points by sweeps of as many depths as configured; so many grey ones in the cameras' frusta where
/// photographs tell nothing. A pure function of the seed.
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
    let ray = |own: usize, index: usize| {
        let sweep = DepthSweep {
            own: &thumbnails[own],
            others: others
                .iter()
                .filter(|&&other| other != own)
                .map(|&other| &thumbnails[other])
                .collect(),
            depth: distance(&cameras[own]),
            key: [seed, index as u64],
        };
        sweep.ray(config)
    };
    let photos = 0..cameras.len();
    // Rays take turns among the photographs.
    let rays = |own: usize| -> Vec<DepthRay> {
        let swept = (own..count).into_par_iter().step_by(cameras.len());
        let rays: Vec<DepthRay> = swept.filter_map(|index| ray(own, index)).collect();
        let agreeing = rays.iter().filter(|ray| ray.agrees_with(&rays));
        agreeing.cloned().collect()
    };
    let rays: Vec<Vec<DepthRay>> = photos.clone().map(rays).collect();
    let points = |own: usize| {
        let points = rays[own].iter().map(|ray| ray.point(&cameras[own]));
        let clear = points.filter(|point| !is_before_surfaces(point.position.into(), own, &cameras, &rays));
        clear.collect::<Vec<Point>>()
    };
    let points: Vec<Point> = photos.into_par_iter().flat_map_iter(points).collect();
    Ok(match points.len() * RAYS_PER_POINT_MAX < count {
        true => points_in_frusta(&cameras, count, extent, seed, config),
        false => points,
    })
}

/// A pixel of a photograph whose depth stands out.
#[derive(Clone)]
struct DepthRay {
    pixel: DVec2,
    color: DVec3,
    /// Depth along the ray, world units.
    depth: f64,
}

impl DepthRay {
    /// Whether the depth is about the median of the nearest rays of the photograph.
    fn agrees_with(&self, rays: &[DepthRay]) -> bool {
        let median = median_depth(rays, self.pixel);
        median.is_none_or(|median| (self.depth / median).ln().abs() < DEVIATION_MAX)
    }

    fn point(&self, camera: &Camera) -> Point {
        Point {
            position: (camera.position + self.depth * camera.ray_from_pixel(self.pixel)).to_array(),
            color: self.color.as_vec3().to_array(),
        }
    }
}

/// Median depth of the nearest other rays about a pixel of their photograph; `None` without any.
fn median_depth(rays: &[DepthRay], pixel: DVec2) -> Option<f64> {
    let mut near: Vec<(f64, f64)> = rays
        .iter()
        .map(|ray| (ray.pixel.distance_squared(pixel), ray.depth))
        .filter(|(distance, _)| *distance > 0.0)
        .collect();
    if near.len() > NEIGHBORS {
        near.select_nth_unstable_by(NEIGHBORS, |a, b| a.0.total_cmp(&b.0));
        near.truncate(NEIGHBORS);
    }
    let mut depths: Vec<f64> = near.into_iter().map(|(_, depth)| depth).collect();
    quantile(&mut depths, 0.5)
}

/// Whether a point of the photograph `own` would hide what most of the other photographs that look at it show: it lies
/// before the surface that their rays tell. `rays` are those of each photograph.
fn is_before_surfaces(point: DVec3, own: usize, cameras: &[Camera], rays: &[Vec<DepthRay>]) -> bool {
    let others = cameras.iter().zip(rays).enumerate().filter(|(photo, _)| *photo != own);
    let is_before = |(_, (camera, rays)): (usize, (&Camera, &Vec<DepthRay>))| {
        let pixel = camera.pixel_from_world(point).filter(|_| camera.sees(point))?;
        let surface = median_depth(rays, pixel)?;
        Some((camera.view_from_world(point).z / surface).ln() < -DEVIATION_MAX)
    };
    let votes: Vec<bool> = others.filter_map(is_before).collect();
    2 * votes.iter().filter(|&&is_before| is_before).count() > votes.len()
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
    /// The ray; `None` where no pixel counts or no depth stands out.
    fn ray(&self, config: &InitConfig) -> Option<DepthRay> {
        let [seed, index] = self.key;
        let draw = |draw: u32| rng::uniform(seed, draw, index as u32, Stream::RandomInit).map(f64::from);
        let size = DVec2::new(self.own.photo.width.into(), self.own.photo.height.into());
        let pixel = |[u, v, ..]: [f64; 4]| DVec2::new(u, v) * size;
        let mut draws = (0..PIXEL_DRAWS).map(|i| pixel(draw(i)));
        let (pixel, color) = draws.find_map(|place| Some((place, self.own.color(place)?)))?;
        let depth = self.depth(pixel, draw(PIXEL_DRAWS)[0], config)?;
        Some(DepthRay { pixel, color, depth })
    }

    /// Depth at which the colours agree best, if it stands out. All depths are shifted alike, by a share of their
    /// spacing.
    fn depth(&self, pixel: DVec2, shift: f64, config: &InitConfig) -> Option<f64> {
        let [near, far] = config.random_depths;
        let steps = config.random_sweep;
        let depth_at = |step: f64| self.depth * near * (far / near).powf((step + shift) / f64::from(steps));
        let errors: Vec<Option<f64>> = (0..steps)
            .map(|step| self.error(pixel, depth_at(step.into())))
            .collect();
        let known = || (0..).zip(&errors).filter_map(|(step, error)| Some((step, (*error)?)));
        let (step, best) = known().reduce(|best: (usize, f64), next| if next.1 < best.1 { next } else { best })?;
        let worst = known().fold(0.0, |worst: f64, (_, error)| worst.max(error));
        let beside = |step: Option<usize>| *errors.get(step?)?;
        let offset = match (beside(step.checked_sub(1)), beside(Some(step + 1))) {
            (Some(before), Some(after)) if before + after > 2.0 * best => {
                0.5 * (before - after) / (before - 2.0 * best + after)
            }
            _ => 0.0,
        };
        let elsewhere = known().filter(|(other, _)| other.abs_diff(step) >= RIVAL_STEPS);
        let rival = elsewhere.fold(f64::INFINITY, |least: f64, (_, error)| least.min(error));
        let stands_out = worst - best >= CONTRAST_MIN && best + ROUNDING <= RIVAL_MAX * rival;
        stands_out.then(|| depth_at(step as f64 + offset))
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

    const PLAIN: [u8; 4] = [90, 120, 30, 255];

    /// Photographs of the plane z = 0 from a ring above it: textured up to a distance from its middle, and of one
    /// colour beyond.
    fn dataset(textured: f64) -> Dataset {
        let level = |x: f64| (127.5 + 120.0 * x) as u8;
        let color = |p: DVec3| match p.length() < textured {
            true => [
                level((2.3 * p.x).sin()),
                level((1.9 * p.y + 1.1 * p.x).cos()),
                level((1.7 * p.x - 2.1 * p.y).sin()),
                255,
            ],
            false => PLAIN,
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
        let dataset = dataset(f64::INFINITY);
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
    fn a_ray_agrees_with_its_neighbours_or_is_left_out() {
        let ray = |x: f64, depth: f64| DepthRay {
            pixel: DVec2::new(x, 0.0),
            color: DVec3::ZERO,
            depth,
        };
        let mut rays: Vec<DepthRay> = [4.0, 4.1, 4.2, 4.3, 4.4].map(|depth| ray(10.0 * depth, depth)).into();
        // Far off, where it is deeper.
        rays.extend([200.0, 201.0, 202.0, 203.0, 204.0].map(|x| ray(x, 9.0)));
        let agrees = |x: f64, depth: f64| ray(x, depth).agrees_with(&rays);
        assert!(agrees(42.5, 4.5) && agrees(42.5, 3.8) && agrees(205.0, 9.5));
        assert!(!agrees(42.5, 9.0) && !agrees(42.5, 2.0) && !agrees(205.0, 4.0));
        assert!(ray(0.0, 1.0).agrees_with(&[]), "alone");
    }

    #[test]
    fn a_point_before_what_other_photographs_show_is_told() {
        let cameras: Vec<Camera> = dataset(0.0).views.iter().map(|view| view.camera).collect();
        let on_plane = |camera: &Camera| {
            let pixels = (0..48).map(|i| DVec2::new(f64::from(i % 8) * 7.5, f64::from(i / 8) * 7.5) + 1.0);
            let ray = |pixel: DVec2| DepthRay {
                pixel,
                color: DVec3::ZERO,
                depth: -camera.position.z / camera.ray_from_pixel(pixel).z,
            };
            pixels.map(ray).collect::<Vec<_>>()
        };
        let rays: Vec<Vec<DepthRay>> = cameras.iter().map(on_plane).collect();
        let is_before = |z: f64, rays: &[Vec<DepthRay>]| is_before_surfaces(DVec3::new(0.1, 0.0, z), 0, &cameras, rays);
        assert!(is_before(1.5, &rays) && !is_before(0.0, &rays) && !is_before(-1.0, &rays));
        assert!(!is_before(1.5, &vec![Vec::new(); cameras.len()]), "without other rays");
    }

    #[test]
    fn a_plain_background_tells_no_depth_beside_texture() -> Result<()> {
        let plain = PLAIN.map(|level| f32::from(level) / 255.0);
        let is_plain = |point: &Point| point.color.iter().zip(plain).all(|(a, b)| (a - b).abs() < 0.01);
        let found = points(&dataset(1.0))?;
        let count = found.iter().filter(|point| is_plain(point)).count();
        assert!(
            found.len() > 20 && 10 * count < found.len(),
            "{count} of {}",
            found.len()
        );
        Ok(())
    }

    #[test]
    fn a_plain_wall_tells_no_depth() -> Result<()> {
        let found = points(&dataset(0.0))?;
        assert!(found.len() == 300 && found.iter().all(|point| point.color == [0.5; 3]));
        Ok(())
    }
}
