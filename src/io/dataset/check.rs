//! Capture check: whether the photographs show the points where the reconstruction says, and else which usual mistake
//! makes them.
//!
//! Measure: the correlation, over the points that a photograph sees, of the points' luminance with that of the pixels
//! there. It does not depend on exposure. Of some photographs, evenly spaced, each hypothesis tells other pixels for
//! the same points.

use super::super::parallel::try_map;
use super::super::photo;
use crate::error::Result;
use crate::scene::{Camera, Dataset, Optics, Photo, PhotoSource, View};
use crate::stats::quantile;
use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;

/// Photographs that are looked at.
const PHOTOS: usize = 12;

/// Points of a photograph that are looked at, and the fewest that tell anything.
const POINTS: usize = 500;
const POINTS_MIN: usize = 30;

/// Correlation below which something is wrong, and the gain of a hypothesis over it.
const CORRELATION_MIN: f64 = 0.4;
const GAIN_MIN: f64 = 0.3;

/// Displacement by the lens, in pixels, of points that tell whether it was removed twice; and the gain without removal.
const DISPLACED: f64 = 2.0;
const TWICE_GAIN: f64 = 0.1;

/// Place of a point on the photograph under a hypothesis.
type PointPlacement = fn(&Camera, DVec3) -> Option<DVec2>;

/// Hypotheses and their names.
const MISTAKES: [(&str, PointPlacement); 8] = [
    (
        "the photographs are turned by 180 degrees against their cameras",
        |c, p| on(c, p, |u, v| [1.0 - u, 1.0 - v]),
    ),
    ("the photographs are mirrored left to right", |c, p| {
        on(c, p, |u, v| [1.0 - u, v])
    }),
    (
        "the photographs are mirrored top to bottom, or the cameras' y axes point the other way",
        |c, p| on(c, p, |u, v| [u, 1.0 - v]),
    ),
    ("the photographs are turned by 90 degrees to the right", |c, p| {
        on(c, p, |u, v| [1.0 - v, u])
    }),
    ("the photographs are turned by 90 degrees to the left", |c, p| {
        on(c, p, |u, v| [v, 1.0 - u])
    }),
    (
        "the cameras look backwards: their axes are y up and z backward",
        |c, p| axes(c, p, DVec3::new(1.0, -1.0, -1.0)),
    ),
    ("the points have y and z exchanged", |c, p| {
        c.pixel_from_world(DVec3::new(p.x, p.z, -p.y))
    }),
    ("the points have y and z exchanged", |c, p| {
        c.pixel_from_world(DVec3::new(p.x, -p.z, p.y))
    }),
];

/// The pixel moved on the picture, in shares of its width and height.
fn on(camera: &Camera, point: DVec3, moved: fn(f64, f64) -> [f64; 2]) -> Option<DVec2> {
    let size = DVec2::new(camera.width.into(), camera.height.into());
    let share = camera.pixel_from_world(point)? / size;
    Some(DVec2::from(moved(share.x, share.y)) * size)
}

/// The pixel for camera axes of other signs.
fn axes(camera: &Camera, point: DVec3, signs: DVec3) -> Option<DVec2> {
    let rotation = DMat3::from_diagonal(signs) * camera.rotation;
    Camera { rotation, ..*camera }.pixel_from_world(point)
}

/// Correlations of a photograph.
struct PhotoCheck {
    name: String,
    here: f64,
    mistakes: [f64; MISTAKES.len()],
    /// Of the points that the lens displaces: with its removal, and without.
    lens: Option<[f64; 2]>,
}

/// One line for each mistake that the photographs show; none without points. Photographs are decoded for it.
///
/// # Errors
/// Those of a photograph that cannot be read.
pub fn check_capture(dataset: &Dataset) -> Result<Vec<String>> {
    let has_file = |&view: &usize| matches!(dataset.views[view].photo, PhotoSource::File { .. });
    let views: Vec<usize> = (0..dataset.views.len()).filter(has_file).collect();
    let chosen: Vec<usize> = views
        .iter()
        .copied()
        .step_by(views.len().div_ceil(PHOTOS).max(1))
        .collect();
    let checks = try_map(chosen.par_iter(), |&view| look(dataset, view))?;
    let checks: Vec<PhotoCheck> = checks.into_iter().flatten().collect();
    Ok(findings(&checks, dataset.tracks.is_empty()))
}

fn findings(checks: &[PhotoCheck], without_tracks: bool) -> Vec<String> {
    let Some(here) = median(checks.iter().map(|check| check.here)) else {
        return Vec::new();
    };
    let mut found = Vec::new();
    let twice = checks.iter().filter_map(|check| check.lens);
    if let Some(gain) = median(twice.map(|[with, without]| without - with)).filter(|gain| *gain > TWICE_GAIN) {
        found.push(format!(
            "the photographs seem to be undistorted already, but their camera model has distortion (correlation \
             {gain:.2} better without)"
        ));
    }
    if here < CORRELATION_MIN {
        let of = |i: usize| median(checks.iter().map(|check| check.mistakes[i])).unwrap_or(-1.0);
        let best = (0..MISTAKES.len())
            .max_by(|&a, &b| of(a).total_cmp(&of(b)))
            .unwrap_or(0);
        if of(best) > here + GAIN_MIN {
            let (name, better) = (MISTAKES[best].0, of(best));
            found.push(format!(
                "{name} (correlation with the points {here:.2}, so {better:.2})"
            ));
        } else if !without_tracks {
            found.push(format!(
                "the photographs do not show the points (correlation {here:.2}): are they those of the reconstruction?"
            ));
        }
        return found;
    }
    for check in checks
        .iter()
        .filter(|check| !without_tracks && check.here < here - GAIN_MIN)
    {
        let PhotoCheck { name, here: own, .. } = check;
        if *own < CORRELATION_MIN {
            found.push(format!(
                "{name} does not show the points that the reconstruction sees in it (correlation {own:.2}, others \
                 {here:.2}): is it another photograph?"
            ));
        }
    }
    found
}

/// Correlations of a view; `None` with too few points.
fn look(dataset: &Dataset, index: usize) -> Result<Option<PhotoCheck>> {
    let view = &dataset.views[index];
    let all: Vec<u32> = match dataset.tracks.get(index) {
        Some(seen) => seen.clone(),
        None => (0..)
            .zip(&dataset.points)
            .filter(|(_, point)| view.camera.sees(point.position.into()))
            .map(|(place, _)| place)
            .collect(),
    };
    if all.len() < POINTS_MIN {
        return Ok(None);
    }
    let points: Vec<(DVec3, f64)> = all
        .iter()
        .step_by(all.len().div_ceil(POINTS))
        .map(|&place| &dataset.points[place as usize])
        .map(|point| (point.position.into(), luminance(point.color.map(f64::from))))
        .collect();
    let photo = photo::load(view)?;
    let of = |placement: PointPlacement| correlation(&points, |point| value(&photo, placement(&view.camera, point)?));
    Ok(Some(PhotoCheck {
        name: view.name.clone(),
        here: of(Camera::pixel_from_world),
        mistakes: MISTAKES.map(|(_, placement)| of(placement)),
        lens: with_and_without_lens(view, &photo, &points)?,
    }))
}

/// Correlations over the points that the lens displaces, with its distortion removed and with the pixels as stored.
fn with_and_without_lens(view: &View, photo: &Photo, points: &[(DVec3, f64)]) -> Result<Option<[f64; 2]>> {
    let PhotoSource::File {
        path,
        optics: Some(optics),
        ..
    } = &view.photo
    else {
        return Ok(None);
    };
    let Optics {
        lens, focal, center, ..
    } = **optics;
    let reach = lens.reach();
    let at_full_size = Camera {
        rotation: view.camera.rotation,
        position: view.camera.position,
        ..optics.pinhole
    };
    let displaced: Vec<(DVec3, f64)> = points
        .iter()
        .copied()
        .filter(|(point, _)| {
            let direction = at_full_size.view_from_world(*point);
            let plain = at_full_size.pixel_from_world(*point);
            let through = optics.pixel(direction, reach);
            matches!((plain, through), (Some(a), Some(b)) if a.distance(b) > DISPLACED)
        })
        .collect();
    let is_whole = optics.lens_from_pinhole == DMat3::IDENTITY && optics.pinhole.center == center;
    if !is_whole || displaced.len() < POINTS_MIN {
        return Ok(None);
    }
    let stored = photo::decode(path)?;
    let ratio = DVec2::new(stored.width.into(), stored.height.into())
        / DVec2::new(optics.size[0].into(), optics.size[1].into());
    let with = correlation(&displaced, |point| value(photo, view.camera.pixel_from_world(point)?));
    let without = correlation(&displaced, |point| {
        let v = at_full_size.view_from_world(point);
        value(&stored, (focal * v.truncate() / v.z + center) * ratio)
    });
    Ok(Some([with, without]))
}

fn luminance([r, g, b]: [f64; 3]) -> f64 {
    0.299 * r + 0.587 * g + 0.114 * b
}

/// Luminance of the photograph about a place; `None` outside or where alpha hides a pixel.
fn value(photo: &Photo, pixel: DVec2) -> Option<f64> {
    photo.patch(pixel).map(luminance)
}

/// Pearson's correlation over the points that have a value; 0 of too few, or of equal ones.
fn correlation(points: &[(DVec3, f64)], value: impl Fn(DVec3) -> Option<f64>) -> f64 {
    let pairs = points.iter().filter_map(|&(point, known)| Some((known, value(point)?)));
    let pairs: Vec<(f64, f64)> = pairs.collect();
    if pairs.len() < POINTS_MIN {
        return 0.0;
    }
    let count = pairs.len() as f64;
    let mean = |part: fn(&(f64, f64)) -> f64| pairs.iter().map(part).sum::<f64>() / count;
    let (a, b) = (mean(|pair| pair.0), mean(|pair| pair.1));
    let product = |x: fn(&(f64, f64), f64, f64) -> f64| pairs.iter().map(|pair| x(pair, a, b)).sum::<f64>();
    let both = product(|(x, y), a, b| (x - a) * (y - b));
    let (first, second) = (
        product(|(x, _), a, _| (x - a).powi(2)),
        product(|(_, y), _, b| (y - b).powi(2)),
    );
    let scale = (first * second).sqrt();
    if scale > 1e-12 { both / scale } else { 0.0 }
}

fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    quantile(&mut values.collect::<Vec<f64>>(), 0.5)
}
