//! Cameras around a synthetic scene, and its data set.

use super::fisheye::FisheyeLens;
use super::noise::disturb;
use super::perturb::{exposed, exposures, vignetting};
use super::random::KeyedRandom;
use super::shape::Shape;
use super::{Material, Object, Scene, Texture};
use crate::scene::{AlphaMode, Camera, Dataset, Photo, PhotoSource, Point, View};
use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;
use std::borrow::Cow;

/// Rig of cameras: a band of directions around a target. Azimuth goes round once from view to view; elevation jumps by
/// the golden ratio, so that any stretch of views, and any regular choice of test views, covers the whole band.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rig {
    /// Target, world units.
    pub target: DVec3,
    /// Distance from the target, world units.
    pub distance: f64,
    /// First and last direction from the target, counter-clockwise from +x seen from above; a difference of 360 is a
    /// full ring.
    pub azimuth_degrees: (f64, f64),
    /// Lowest and highest angle above the horizon.
    pub elevation_degrees: (f64, f64),
}

impl Default for Rig {
    fn default() -> Rig {
        Rig {
            target: DVec3::new(0.0, 0.0, 0.5),
            distance: 5.6,
            azimuth_degrees: (0.0, 360.0),
            elevation_degrees: (15.0, 55.0),
        }
    }
}

/// Contents of a synthetic data set.
#[derive(Clone, Debug, PartialEq)]
pub struct SynthOptions {
    /// Number of photographs.
    pub views: usize,
    /// Width of each in pixels.
    pub width: u32,
    /// Height of each in pixels.
    pub height: u32,
    /// Offset of the principal point from the middle of the picture, pixels.
    pub center_offset: DVec2,
    /// Focal length in y over that in x.
    pub focal_ratio: f64,
    /// Rays per pixel along each axis.
    pub samples: u32,
    /// Cut out the background of photographs (straight alpha) instead of painting it.
    pub cutout: bool,
    /// Number of points; fewer if the cameras see too little surface.
    pub points: usize,
    /// Standard deviation of the points' positions, world units.
    pub point_noise: f64,
    /// Number of additional outlier points, of any colour, anywhere within one and a half times the rig's distance of
    /// the target, like the wrong matches of a reconstruction.
    pub strays: usize,
    /// Seed of the points.
    pub seed: u64,
    /// As `Dataset::test_every`.
    pub test_every: usize,
    /// Find the views that see each point (`Dataset::tracks`).
    pub tracks: bool,
    /// Seed of exposures of the training photographs ([`SynthOptions::exposures`]); `None`: one exposure for all.
    pub exposure_seed: Option<u64>,
    /// Take the photographs, those of test views too, through a lens that darkens the corners by 0.7 stops.
    pub vignetting: bool,
    /// Seed of errors of the training cameras ([`SynthOptions::pose_amount`]); `None`: none. Needs tracks.
    pub pose_seed: Option<u64>,
    /// Size of these errors: 1 for half a degree and half a percent of the extent (rms).
    pub pose_amount: f64,
    /// Surround the scene by a far textured sphere, on which there are no points.
    pub dome: bool,
    /// Seed of the boxes before some of the training photographs ([`SynthOptions::occluded`]); `None`: none.
    pub transient_seed: Option<u64>,
    /// Take the training photographs through a [`FisheyeLens`], for `save_colmap` alone: they do not fit the pinholes
    /// of the views, which have the same poses.
    pub fisheye: bool,
}

impl Default for SynthOptions {
    /// Options of the demo: 32 photographs of 192 × 144, 5,000 exact points.
    fn default() -> SynthOptions {
        SynthOptions {
            views: 32,
            width: 192,
            height: 144,
            center_offset: DVec2::ZERO,
            focal_ratio: 1.0,
            samples: 3,
            cutout: false,
            points: 5_000,
            point_noise: 0.0,
            strays: 0,
            seed: 1,
            test_every: 8,
            tracks: false,
            exposure_seed: None,
            vignetting: false,
            pose_seed: None,
            pose_amount: 1.0,
            dome: false,
            transient_seed: None,
            fisheye: false,
        }
    }
}

impl SynthOptions {
    /// Whether a view is held out.
    pub fn is_test(&self, view: usize) -> bool {
        self.test_every > 0 && view.is_multiple_of(self.test_every)
    }

    /// Whether a fisheye lens takes a photograph.
    pub fn is_fisheye(&self, view: usize) -> bool {
        self.fisheye && !self.is_test(view)
    }

    /// Exposure of each photograph's red, green and blue in stops of linear light: 0 in test views and without a seed,
    /// else within one stop, and a quarter more or less in red and blue. The mean over the training views is 0 in each
    /// channel, so that test views show the scene at its own brightness.
    pub fn exposures(&self) -> Vec<[f64; 3]> {
        let is_test = |view| self.is_test(view);
        match self.exposure_seed {
            Some(seed) => exposures(self.views, is_test, seed),
            None => vec![[0.0; 3]; self.views],
        }
    }
}

/// Angle of view across the width of a photograph, degrees.
const FOV_DEGREES: f64 = 50.0;

/// Radius of the sky, relative to the rig's distance from its target.
const DOME: f64 = 15.0;

/// Seed of its texture.
const DOME_SEED: u64 = 77;

/// Most views in the average of a point's colour, like the track of a reconstruction.
const TRACK_VIEWS: usize = 6;

impl Scene {
    /// Photographs from the scene's rig, with points visible to at least one of the cameras.
    pub fn dataset(&self, options: &SynthOptions) -> Dataset {
        let cameras = self.cameras(options);
        let stops = options.exposures();
        let lens = FisheyeLens::of(options.width * options.height);
        let occluded = options.occluded();
        let world = match options.dome {
            true => Cow::Owned(self.with_dome()),
            false => Cow::Borrowed(self),
        };
        let shown = |index: usize, camera: &Camera| match options.transient_seed {
            Some(seed) if occluded.binary_search(&index).is_ok() => {
                Cow::Owned(world.with_passerby(camera, seed, index))
            }
            _ => Cow::Borrowed(&*world),
        };
        let view = |(index, camera): (usize, &Camera)| {
            let scene = shown(index, camera);
            View {
                name: format!("images/{index:04}.png"),
                camera: *camera,
                photo: PhotoSource::Memory(match options.cutout {
                    true => scene.cutout(camera, options.samples),
                    false if options.is_fisheye(index) => scene.fisheye_photo(camera, &lens, options.samples),
                    false => scene.exposed_photo(camera, options, stops[index]),
                }),
            }
        };
        let points = self.points(&cameras, options);
        let mut dataset = Dataset {
            views: cameras.iter().enumerate().map(view).collect(),
            tracks: match options.tracks {
                true => {
                    let views = cameras.par_iter().enumerate();
                    let track = |(index, camera)| shown(index, camera).track(camera, &points);
                    views.map(track).collect()
                }
                false => Vec::new(),
            },
            points,
            test_every: options.test_every,
            alpha: AlphaMode::Composite,
            ..Dataset::default()
        };
        if let Some(seed) = options.pose_seed {
            disturb(&mut dataset, seed, options.pose_amount);
        }
        dataset
    }

    /// The scene within a far textured sphere.
    fn with_dome(&self) -> Scene {
        let radius = DOME * self.rig.distance;
        let texture = Texture::ripples([0.45, 0.55, 0.7], 0.7, 0.15 * radius, DOME_SEED);
        let DVec3 { x, y, z } = self.rig.target;
        let mut scene = self.clone();
        let dome = Object::new(Shape::Sphere(radius), Material::matt(texture));
        scene.objects.push(dome.at(x, y, z));
        scene
    }

    /// Cameras of `dataset`, in the order of its views.
    pub fn cameras(&self, options: &SynthOptions) -> Vec<Camera> {
        let size = DVec2::new(options.width.into(), options.height.into());
        let focal = 0.5 * size.x / (0.5 * FOV_DEGREES.to_radians()).tan();
        let blank = Camera {
            width: options.width,
            height: options.height,
            focal: DVec2::new(focal, focal * options.focal_ratio),
            center: 0.5 * size + options.center_offset,
            rotation: DMat3::IDENTITY,
            position: DVec3::ZERO,
        };
        let (first, last) = self.rig.azimuth_degrees;
        let (low, high) = self.rig.elevation_degrees;
        // The last view of a full ring must differ from the first.
        let full = (last - first).abs() >= 360.0;
        let steps = options.views.saturating_sub(usize::from(!full)).max(1);
        let camera = |index: usize| {
            let azimuth = first + (last - first) * index as f64 / steps as f64;
            let golden = (index as f64 * 0.618_033_988_749_895 + 0.5).fract();
            let elevation = (low + (high - low) * golden).to_radians();
            let flat = DVec2::from_angle(azimuth.to_radians()) * elevation.cos();
            let direction = flat.extend(elevation.sin());
            let position = self.rig.target + self.rig.distance * direction;
            blank.look_at(position, self.rig.target, DVec3::Z)
        };
        (0..options.views).map(camera).collect()
    }

    /// Points at the hits of rays through random pixels: dense in close-ups, like those of a reconstruction.
    fn points(&self, cameras: &[Camera], options: &SynthOptions) -> Vec<Point> {
        if cameras.is_empty() {
            return Vec::new();
        }
        // Limit of the number of rays, because most may miss.
        let tries = 20 * options.points as u64;
        // In blocks, to cast little more rays than the points need.
        let mut points: Vec<Point> = Vec::with_capacity(options.points);
        let mut key = 0;
        while points.len() < options.points && key < tries {
            let block = key..(key + (options.points - points.len()).max(64) as u64).min(tries);
            key = block.end;
            let draw = |key| self.point(cameras, options, &mut KeyedRandom::new(options.seed, key));
            points.par_extend(block.into_par_iter().filter_map(draw));
        }
        points.truncate(options.points);
        points.extend((0..options.strays).map(|key| self.stray(options.seed, key as u64)));
        points
    }

    /// A photograph under an exposure in stops of each channel, through the lens of the options.
    fn exposed_photo(&self, camera: &Camera, options: &SynthOptions, stops: [f64; 3]) -> Photo {
        if stops == [0.0; 3] && !options.vignetting {
            return self.photo(camera, options.samples);
        }
        let mut image = self.image(camera, options.samples);
        for (index, color) in (0..).zip(&mut image) {
            let pixel = DVec2::new((index % camera.width).into(), (index / camera.width).into()) + 0.5;
            let lost = if options.vignetting {
                vignetting(camera, pixel)
            } else {
                0.0
            };
            *color = exposed(*color, stops.map(|stop| stop - lost));
        }
        Photo::from_rgb(camera.width, camera.height, &image)
    }

    /// Indices of the points that a camera sees.
    fn track(&self, camera: &Camera, points: &[Point]) -> Vec<u32> {
        let is_seen = |point: &Point| self.seen(camera, point.position.into()).is_some();
        let indices = (0..).zip(points).filter(|(_, point)| is_seen(point));
        indices.map(|(index, _)| index).collect()
    }

    /// An outlier point, on no surface.
    fn stray(&self, seed: u64, key: u64) -> Point {
        // A stream apart from that of the points on surfaces.
        let random = &mut KeyedRandom::new(!seed, key);
        // Uniform over the ball.
        let reach = 1.5 * self.rig.distance * random.uniform().cbrt();
        let position = self.rig.target + reach * random.direction();
        Point {
            position: position.as_vec3().as_dvec3().to_array(),
            color: [(); 3].map(|()| random.uniform() as f32),
        }
    }

    fn point(&self, cameras: &[Camera], options: &SynthOptions, random: &mut KeyedRandom) -> Option<Point> {
        let first = random.index(cameras.len());
        let camera = &cameras[first];
        let pixel = DVec2::new(random.uniform(), random.uniform());
        let size = DVec2::new(camera.width.into(), camera.height.into());
        let ray = Scene::ray(camera, pixel * size);
        let (_, hit) = self.hit(&ray, f64::INFINITY)?;
        let position = ray.at(hit.t);
        let stride = cameras.len().div_ceil(TRACK_VIEWS);
        let track = (0..cameras.len())
            .step_by(stride)
            .map(|i| &cameras[(first + i) % cameras.len()]);
        let seen: Vec<DVec3> = track.filter_map(|camera| self.seen(camera, position)).collect();
        // The first camera sees it up to rounding.
        let color = seen.iter().sum::<DVec3>() / seen.len().max(1) as f64;
        let error = DVec3::from_array([(); 3].map(|()| random.normal())) * options.point_noise;
        (!seen.is_empty()).then(|| Point {
            position: (position + error).as_vec3().as_dvec3().to_array(),
            color: color.as_vec3().to_array(),
        })
    }

    /// Colour of a surface point in a camera; `None` if hidden or outside.
    fn seen(&self, camera: &Camera, point: DVec3) -> Option<DVec3> {
        let pixel = camera.pixel_from_world(point)?;
        let size = DVec2::new(camera.width.into(), camera.height.into());
        let within = pixel.cmpge(DVec2::ZERO).all() && pixel.cmplt(size).all();
        let ray = Scene::ray(camera, pixel);
        let depth = camera.view_from_world(point).z;
        // Hidden if the ray hits anything before it.
        let free = within && self.hit(&ray, depth * (1.0 - 1e-4)).is_none();
        free.then(|| self.color(&ray)).flatten()
    }
}
