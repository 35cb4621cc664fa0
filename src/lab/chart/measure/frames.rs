//! Frames of every setting: time, errors and broken bounds.

use super::scenes::ModelCache;
use super::settings::{self, FrameSetting};
use super::{SceneInputs, training};
use crate::Result;
use crate::gpu::Buffer;
use crate::lab::bench::CpuClock;
use crate::lab::chart::{FrameErrors, FramePoint};
use crate::reference::bound::{TracedPixel, trace};
use crate::reference::{self, ray};
use crate::render::{Model, RenderOptions, Renderer, ViewOptions};
use crate::scene::{Camera, Splats};
use crate::stats::{Interval, Summary};
use std::rc::Rc;

/// Bound of rounding to `f32`, as a share of the colour range, in images up to [`ROUNDING_SIZE`] pixels wide: the
/// tolerance of the frame tests, fifty times the largest error measured there.
const ROUNDING: f64 = 1e-4;

/// Image width in pixels above which [`ROUNDING`] grows with it, because positions are rounded relative to the image's
/// size.
const ROUNDING_SIZE: f64 = 128.0;

/// [`ROUNDING`] in the images of a camera.
pub(super) fn rounding(camera: &Camera) -> f64 {
    let size = f64::from(camera.width.max(camera.height));
    ROUNDING * (size / ROUNDING_SIZE).max(1.0)
}

/// A setting with its model and renderer.
struct SettingBench {
    setting: FrameSetting,
    model: Rc<Model>,
    renderer: Renderer,
    errors: Vec<FrameComparison>,
}

impl SceneInputs<'_> {
    /// Times and compares frames of every setting, and the projection common to all.
    pub(super) fn frames(&self, progress: &mut dyn FnMut(&str)) -> Result<(Vec<FramePoint>, Option<FrameErrors>)> {
        let (plan, cameras) = (self.plan, self.cameras()?);
        let settings = settings::of_frames(self.splats.sh_degree, plan);
        progress("frames: pruning");
        let mut scenes = ModelCache::new(*self)?;
        let (mut approximations, mut benches) = (Vec::new(), Vec::new());
        for setting in settings {
            let removed = scenes.removed(&setting)?;
            approximations.push(setting.approximations(self.splats, &removed));
            let options = RenderOptions {
                accuracy: setting.accuracy,
                sh_degree: setting.sh_degree,
                precision: setting.precision,
                ..RenderOptions::default()
            };
            benches.push(SettingBench {
                model: scenes.model(&setting, &removed)?,
                setting,
                renderer: Renderer::new(self.gpu, options)?,
                errors: Vec::new(),
            });
        }
        let view = ViewOptions {
            background: training::BACKGROUND,
            near: self.near(),
            filter: self.splats.filter,
        };
        let options = exact_options(self.splats, view.near);
        let mut by_rays = Vec::new();
        for (number, camera) in (1..).zip(&cameras) {
            let of = cameras.len();
            progress(&format!("frames: the exact view {number} of {of}"));
            let traced = trace(self.splats, camera, &options, &approximations);
            by_rays.extend(self.by_rays(camera, &options, &traced));
            for (index, bench) in benches.iter_mut().enumerate() {
                let drawn = bench.renderer.render(&bench.model, camera, &view)?;
                let rounding = rounding(camera);
                bench.errors.push(compare_frame(&drawn.rgb, &traced, index, rounding));
            }
        }
        let begun = |run| progress(&format!("frames: run {run} of {}", plan.runs));
        let times = times_ms(&mut benches, plan.runs, cameras.len(), begun, |bench| {
            let mut device_ns = 0.0;
            for camera in &cameras {
                bench.renderer.render(&bench.model, camera, &view)?;
                device_ns += bench.renderer.timings()?.iter().map(|(_, ns)| ns).sum::<f64>();
            }
            Ok(device_ns)
        })?;
        let points = benches
            .iter()
            .zip(times)
            .map(|(bench, times)| bench.point(times))
            .collect();
        Ok((points, (!by_rays.is_empty()).then(|| of_channels(by_rays))))
    }

    /// Differences between linear projection and rays, by channel of some pixels.
    fn by_rays(&self, camera: &Camera, options: &reference::Options, traced: &[TracedPixel]) -> Vec<[f64; 3]> {
        // An odd stride over the image's pixels samples all columns.
        let every = traced.len().div_ceil(self.plan.ray_pixels.max(1)) | 1;
        let pixels: Vec<usize> = (0..traced.len()).step_by(every).collect();
        let seen = ray::colors(self.splats, camera, options, &pixels);
        let off = |(pixel, seen): (&usize, &[f64; 3])| [0, 1, 2].map(|c| (seen[c] - traced[*pixel].color[c]).abs());
        pixels.iter().zip(&seen).map(off).collect()
    }
}

/// Options of the reference without any cut.
pub(super) fn exact_options(splats: &Splats, near: f32) -> reference::Options {
    reference::Options {
        background: training::BACKGROUND.map(f64::from),
        near: f64::from(near),
        sh_degree: splats.sh_degree,
        thresholds: reference::Thresholds::NONE,
    }
}

/// Errors and bounds of a frame by pixel.
#[derive(Clone, Debug, PartialEq)]
struct FrameComparison {
    /// Largest error of each pixel.
    errors: Vec<f64>,
    bounds: Vec<f64>,
    /// Sum of squares over pixels and channels.
    square: f64,
    rounding: f64,
    /// Largest distance of a pixel beyond its bound and rounding.
    excess: f64,
}

/// Compares a frame with the exact one, by the bounds of setting `index` and the share of a pixel's colour range for
/// rounding.
fn compare_frame(drawn: &[[f32; 3]], traced: &[TracedPixel], index: usize, share: f64) -> FrameComparison {
    assert_eq!(drawn.len(), traced.len(), "sizes differ");
    let mut comparison = FrameComparison {
        errors: Vec::with_capacity(drawn.len()),
        bounds: traced.iter().map(|t| t.bounds[index]).collect(),
        square: 0.0,
        rounding: 0.0,
        excess: f64::NEG_INFINITY,
    };
    for ((pixel, exact), bound) in drawn.iter().zip(traced).zip(&comparison.bounds) {
        let off = [0, 1, 2].map(|c| (f64::from(pixel[c]) - exact.color[c]).abs());
        comparison.square += off.iter().map(|d| d * d).sum::<f64>();
        let error = off.into_iter().fold(0.0, larger);
        let rounding = share * exact.range + exact.order;
        comparison.rounding = comparison.rounding.max(rounding);
        comparison.excess = larger(comparison.excess, error - bound - rounding);
        comparison.errors.push(error);
    }
    comparison
}

impl SettingBench {
    fn point(&self, (time_ms, cpu_ms): (Interval, f64)) -> FramePoint {
        let pool = |of: fn(&FrameComparison) -> &Vec<f64>| -> Vec<f64> {
            let mut all: Vec<f64> = self.errors.iter().flat_map(of).copied().collect();
            all.sort_by(f64::total_cmp);
            all
        };
        let (errors, bounds) = (pool(|j| &j.errors), pool(|j| &j.bounds));
        let pixels = errors.len() as f64;
        let squares: f64 = self.errors.iter().map(|j| j.square).sum();
        let promised: f64 = bounds.iter().map(|b| b * b).sum();
        let most = |of: fn(&FrameComparison) -> f64| self.errors.iter().map(of).fold(f64::NEG_INFINITY, larger);
        FramePoint {
            knob: self.setting.knob.clone(),
            time_ms,
            cpu_ms,
            scene_bytes: bytes(&self.model),
            error: of_sorted(&errors, squares / (3.0 * pixels)),
            bound: of_sorted(&bounds, promised / pixels),
            rounding: most(|j| j.rounding),
            excess: most(|j| j.excess),
        }
    }
}

/// Bytes of a scene on the device.
fn bytes(model: &Model) -> usize {
    let params = model.params.iter().map(Buffer::bytes);
    let slots = model.splat_from_slot.iter().map(Buffer::bytes);
    params.chain(slots).sum::<u64>() as usize
}

/// Medians of device and processor time of a frame of each subject, from runs of `frames` each, which return their
/// nanoseconds on the device. In turns, so that disturbances of the machine affect all alike.
pub(super) fn times_ms<T>(
    subjects: &mut [T],
    runs: usize,
    frames: usize,
    mut begun: impl FnMut(usize),
    mut run: impl FnMut(&mut T) -> Result<f64>,
) -> Result<Vec<(Interval, f64)>> {
    let mut times = vec![(Vec::new(), Vec::new()); subjects.len()];
    for number in 1..=runs.max(1) {
        begun(number);
        for (subject, (device_ns, cpu_ns)) in subjects.iter_mut().zip(&mut times) {
            let clock = CpuClock::now();
            device_ns.push(run(subject)?);
            cpu_ns.extend(clock.elapsed_ns());
        }
    }
    let share = 1e-6 / frames as f64;
    let frame = |runs_ns: &[f64]| {
        let summary = Summary::of(runs_ns);
        let [low, high] = summary.interval;
        Interval::new(summary.median * share, low * share, high * share, summary.runs)
    };
    Ok(times
        .iter()
        .map(|(device, cpu)| (frame(device), frame(cpu).value))
        .collect())
}

/// Errors from those of pixels' channels.
fn of_channels(pixels: Vec<[f64; 3]>) -> FrameErrors {
    let square = |pixel: &[f64; 3]| pixel.iter().map(|d| d * d).sum::<f64>();
    let mean = pixels.iter().map(square).sum::<f64>() / (3 * pixels.len()) as f64;
    let largest = |pixel: &[f64; 3]| pixel.iter().copied().fold(0.0, f64::max);
    let mut worst: Vec<f64> = pixels.iter().map(largest).collect();
    worst.sort_by(f64::total_cmp);
    of_sorted(&worst, mean)
}

/// Errors from those of pixels, ascending, and their mean square.
fn of_sorted(sorted: &[f64], mean_square: f64) -> FrameErrors {
    let at = |share: f64| sorted.get(((sorted.len().max(1) - 1) as f64 * share).round() as usize);
    FrameErrors {
        max: at(1.0).copied().unwrap_or(f64::NAN),
        p99: at(0.99).copied().unwrap_or(f64::NAN),
        psnr_db: -10.0 * mean_square.log10(),
    }
}

/// The larger number; NaN propagates.
pub(super) fn larger(a: f64, b: f64) -> f64 {
    if b > a || b.is_nan() { b } else { a }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exact(bound: f64) -> TracedPixel {
        TracedPixel {
            color: [0.5, 0.25, 0.0],
            bounds: vec![1.0, bound],
            range: 1.0,
            order: 0.0,
        }
    }

    #[test]
    fn a_pixel_beyond_its_own_bound_is_found() {
        let traced = [exact(1e-2), exact(1e-3)];
        let drawn = [[0.509, 0.25, 0.0], [0.5, 0.25, 0.0009]];
        let kept = compare_frame(&drawn, &traced, 1, 1e-4);
        assert!(kept.excess < 0.0, "{}", kept.excess);
        // Below the largest bound, but above its own.
        let broken = compare_frame(&[drawn[0], [0.5, 0.25, 0.005]], &traced, 1, 1e-4);
        assert!((broken.excess - (5e-3 - 1e-3 - 1e-4)).abs() < 1e-6, "{}", broken.excess);
        // Within a larger share of rounding.
        let large = compare_frame(&[drawn[0], [0.5, 0.25, 0.005]], &traced, 1, 64e-4);
        assert!(large.excess < 0.0, "{}", large.excess);
        let poison = compare_frame(&[[f32::NAN; 3], drawn[1]], &traced, 1, 1e-4);
        assert!(poison.excess.is_nan());
    }
}
