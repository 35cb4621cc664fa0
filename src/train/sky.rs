//! Sky: splats on a far shell about the cameras, where the photographs show no point.
//!
//! A sky has no parallax and few points; without splats there, training explains it by floaters before the cameras.
//! The shell is part of the scene like all else, and is drawn by every viewer. Its radius is a multiple of the scene
//! extent, so that the learning rate of means, in extents, hardly moves its splats.

use super::config::SkyConfig;
use super::knn::KdTree;
use super::thumbnails::ReducedPhoto;
use crate::Result;
use crate::scene::{Camera, Dataset, SH_C0, Splats, Split, logit, sh_coefficient_count};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Share of the cameras that look at a place of the shell and must see it free of points.
const CLEAR_SHARE: f64 = 1.0 / 3.0;

/// Opacity of the first splats.
const OPACITY: f64 = 0.9;

/// Clear places of which a place beside them has the mean colour.
const NEIGHBORS: usize = 8;

/// Cells of a picture's grid of points along the angle that must be free.
const CELLS: f64 = 2.0;

/// Sphere about the cameras.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkyShell {
    /// Mean of the training cameras.
    pub center: DVec3,
    /// Radius, world units.
    pub radius: f64,
}

impl SkyShell {
    /// Shell about the training cameras; `extent` is the scene extent.
    pub fn around(dataset: &Dataset, extent: f64, config: &SkyConfig) -> SkyShell {
        let views = dataset.split(Split::Train);
        let sum: DVec3 = views.iter().map(|&view| dataset.views[view].camera.position).sum();
        SkyShell {
            center: sum / views.len().max(1) as f64,
            radius: config.distance * extent,
        }
    }

    /// Whether a position belongs to the sky: beyond half the radius.
    pub fn holds(&self, position: [f32; 3]) -> bool {
        self.center.distance(DVec3::from(position.map(f64::from))) > 0.5 * self.radius
    }
}

/// A picture and the cells of it that show points.
struct PointGrid<'a> {
    thumbnail: &'a ReducedPhoto,
    /// Pixels along a side of a cell.
    cell: f64,
    columns: i64,
    rows: i64,
    is_taken: Vec<bool>,
}

impl<'a> PointGrid<'a> {
    fn new(thumbnail: &'a ReducedPhoto, points: &[DVec3], gap_degrees: f64) -> PointGrid<'a> {
        let camera = &thumbnail.camera;
        let cell = (camera.focal.max_element() * gap_degrees.to_radians().tan() / CELLS).max(1.0);
        let cells = |length: u32| (f64::from(length) / cell).ceil() as i64;
        let (columns, rows) = (cells(camera.width), cells(camera.height));
        let mut grid = PointGrid {
            thumbnail,
            cell,
            columns,
            rows,
            is_taken: vec![false; (columns * rows) as usize],
        };
        for pixel in points.iter().filter_map(|&point| camera.pixel_from_world(point)) {
            if let Some(index) = grid.index(grid.place(pixel)) {
                grid.is_taken[index] = true;
            }
        }
        grid
    }

    fn place(&self, pixel: DVec2) -> [i64; 2] {
        (pixel / self.cell).floor().to_array().map(|x| x as i64)
    }

    fn index(&self, [x, y]: [i64; 2]) -> Option<usize> {
        let is_inside = (0..self.columns).contains(&x) && (0..self.rows).contains(&y);
        is_inside.then_some((y * self.columns + x) as usize)
    }

    /// Whether the neighbourhood of a pixel is free of points.
    fn is_clear(&self, pixel: DVec2) -> bool {
        let [x, y] = self.place(pixel);
        let reach = CELLS as i64;
        let near = (y - reach..=y + reach).flat_map(|y| (x - reach..=x + reach).map(move |x| [x, y]));
        near.filter_map(|place| self.index(place))
            .all(|index| !self.is_taken[index])
    }
}

/// Directions of the shell in which the photographs show sky.
struct ClearPlaces<'a> {
    tree: KdTree<'a>,
    colors: Vec<DVec3>,
    /// Distance on the unit sphere to places that are taken with a clear one: the angle in radians, if small.
    margin: f64,
}

impl ClearPlaces<'_> {
    /// Colour of a clear place, or the mean of the nearest clear places within the margin.
    fn color_near(&self, direction: DVec3) -> Option<DVec3> {
        let near = self
            .tree
            .nearest(direction.as_vec3().to_array(), NEIGHBORS, |_, _| true);
        let &(squared, nearest) = near.first()?;
        let color = |index: u32| self.colors[index as usize];
        match squared.sqrt() {
            0.0 => Some(color(nearest)),
            distance if distance > self.margin => None,
            _ => Some(near.iter().map(|&(_, index)| color(index)).sum::<DVec3>() / near.len() as f64),
        }
    }
}

/// Directions evenly spread over the sphere, by the golden angle.
fn directions(count: u32) -> impl Iterator<Item = DVec3> {
    let turn = std::f64::consts::PI * (3.0 - 5_f64.sqrt());
    (0..count).map(move |i| {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(count);
        let around = DVec2::from_angle(turn * f64::from(i)) * (1.0 - z * z).sqrt();
        around.extend(z)
    })
}

/// Adds splats of the sky: those of `count` places of the shell that a training camera sees, free of points in at least
/// a third of the cameras that see them, in the mean colour that these show; and those around, which other views show
/// beside objects and beyond the photographs' borders, in the colour of the nearest.
pub(super) fn add_sky(dataset: &Dataset, shell: SkyShell, config: &SkyConfig, splats: &mut Splats) -> Result<usize> {
    let thumbnails = ReducedPhoto::all(dataset, &dataset.split(Split::Train))?;
    let finite = dataset.points.iter().filter(|point| point.is_finite());
    let points: Vec<DVec3> = finite.map(|point| point.position.into()).collect();
    let grids: Vec<PointGrid<'_>> = thumbnails
        .par_iter()
        .map(|thumbnail| PointGrid::new(thumbnail, &points, config.gap_degrees))
        .collect();
    let directions: Vec<DVec3> = directions(config.count).collect();
    let position = |direction: DVec3| shell.center + shell.radius * direction;
    let color = |&direction: &DVec3| Some((direction.as_vec3().to_array(), color_at(&grids, position(direction))?));
    let (clear, colors): (Vec<[f32; 3]>, Vec<DVec3>) = directions.par_iter().filter_map(color).unzip();
    let clear = ClearPlaces {
        tree: KdTree::new(&clear),
        colors,
        margin: config.margin_degrees.to_radians(),
    };
    let found: Vec<(DVec3, DVec3)> = directions
        .par_iter()
        .filter_map(|&direction| Some((position(direction), clear.color_near(direction)?)))
        .collect();
    let spacing = (4.0 * std::f64::consts::PI / f64::from(config.count)).sqrt();
    let log_scale = (shell.radius * spacing).ln() as f32;
    let stride = 3 * sh_coefficient_count(splats.sh_degree);
    for (position, color) in &found {
        splats.mean.push(position.as_vec3().to_array());
        splats.log_scale.push([log_scale; 3]);
        splats.quaternion.push([1.0, 0.0, 0.0, 0.0]);
        splats.opacity_logit.push(logit(OPACITY) as f32);
        let constant = color.to_array().map(|c| ((c - 0.5) / f64::from(SH_C0)) as f32);
        let rest = std::iter::repeat_n(0.0, stride - 3);
        splats.sh.extend(constant.into_iter().chain(rest));
    }
    Ok(found.len())
}

/// Mean colour of a far place in the pictures that show it free of points, if these are enough.
fn color_at(grids: &[PointGrid<'_>], position: DVec3) -> Option<DVec3> {
    let (mut seen, mut clear, mut sum) = (0.0, 0.0, DVec3::ZERO);
    for grid in grids {
        let camera: &Camera = &grid.thumbnail.camera;
        let Some(pixel) = camera.pixel_from_world(position) else {
            continue;
        };
        let Some(color) = grid.thumbnail.color(pixel) else {
            continue;
        };
        seen += 1.0;
        if grid.is_clear(pixel) {
            clear += 1.0;
            sum += color;
        }
    }
    (clear > 0.0 && clear >= CLEAR_SHARE * seen).then(|| sum / clear)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Photo, PhotoSource, Point, View};
    use crate::train::test_camera;

    fn view(target: DVec3, color: [u8; 4]) -> View {
        let camera = test_camera(40, 30, 30.0).look_at(DVec3::new(0.5, 0.0, 0.0), target, DVec3::Z);
        View {
            name: String::new(),
            camera,
            photo: PhotoSource::Memory(Photo {
                width: 40,
                height: 30,
                rgba: vec![color; 1200],
            }),
        }
    }

    #[test]
    fn directions_are_evenly_spread() {
        let all: Vec<DVec3> = directions(1_000).collect();
        let mean = all.iter().sum::<DVec3>() / 1e3;
        assert!(mean.length() < 1e-2 && all.iter().all(|d| (d.length() - 1.0).abs() < 1e-12));
        let spacing = (4.0 * std::f64::consts::PI / 1e3).sqrt();
        let nearest = |a: &DVec3| {
            all.iter()
                .map(|b| a.distance(*b))
                .filter(|&d| d > 0.0)
                .fold(9.0, f64::min)
        };
        assert!(all.iter().map(nearest).all(|d| (0.7..1.2).contains(&(d / spacing))));
    }

    #[test]
    fn the_sky_lies_where_cameras_see_no_points_in_the_colour_of_their_pictures() -> Result<()> {
        let mut dataset = Dataset {
            views: vec![
                view(DVec3::new(9.0, 0.0, 0.0), [0, 0, 255, 255]),
                view(DVec3::new(-9.0, 0.0, 0.0), [0, 255, 0, 255]),
            ],
            ..Dataset::default()
        };
        // Before the second camera there are points everywhere, before the first one in its lower half.
        for i in 0..400 {
            let (across, up) = (f64::from(i % 20) - 9.5, f64::from(i / 20) - 9.5);
            let point = |x: f64, z: f64| Point {
                position: [x, 0.4 * across, z],
                color: [0.5; 3],
            };
            dataset.points.push(point(-5.0, 0.4 * up));
            dataset.points.push(point(6.0, 0.2 * up - 2.0));
        }
        let config = SkyConfig {
            count: 2_000,
            margin_degrees: 0.0,
            ..SkyConfig::default()
        };
        let shell = SkyShell::around(&dataset, 2.0, &config);
        let sky = |config: &SkyConfig| {
            let mut splats = Splats {
                sh_degree: 1,
                ..Splats::default()
            };
            let count = add_sky(&dataset, shell, config, &mut splats)?;
            assert!(splats.len() == count && splats.sh.len() == 12 * count);
            for (mean, sh) in splats.mean.iter().zip(splats.sh.chunks(12)) {
                let blue = 0.5 + SH_C0 * sh[2];
                assert!(shell.holds(*mean) && (blue - 1.0).abs() < 1e-5, "{mean:?} {blue}");
                assert!(sh[3..].iter().all(|&c| c == 0.0));
            }
            Ok::<_, crate::Error>(splats.mean)
        };
        let clear = sky(&config)?;
        assert!((20..200).contains(&clear.len()) && clear.iter().all(|mean| mean[0] > 0.0 && mean[2] > 0.0));
        let margin_degrees = 12.0;
        let wide = sky(&SkyConfig {
            margin_degrees,
            ..config
        })?;
        // Behind points and outside of photographs alike, and nowhere else.
        let direction = |mean: &[f32; 3]| (DVec3::from(mean.map(f64::from)) - shell.center).normalize();
        let apart = |mean: &[f32; 3]| {
            let angle = |other: &[f32; 3]| direction(mean).distance(direction(other)).to_degrees();
            clear.iter().map(angle).fold(f64::INFINITY, f64::min)
        };
        assert!(wide.len() > clear.len() + 20 && wide.iter().any(|mean| mean[2] < 0.0));
        assert!(wide.iter().all(|mean| apart(mean) < margin_degrees + 0.1));
        assert!(!shell.holds([10.0, 5.0, 0.0]));
        Ok(())
    }
}
