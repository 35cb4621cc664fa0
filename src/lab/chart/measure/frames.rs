//! Frames of every setting: their time, their errors, and whether each pixel keeps its bound.

use super::scenes::Scenes;
use super::settings::{self, FrameSetting};
use super::{Plan, training};
use crate::Result;
use crate::gpu::{Buffer, Gpu};
use crate::lab::bench::CpuClock;
use crate::lab::chart::{Errors, FramePoint};
use crate::reference::bound::{Traced, trace};
use crate::reference::{self, ray};
use crate::render::{Model, RenderOptions, Renderer, ViewOptions};
use crate::scene::{Camera, Splats};
use crate::stats::Interval;
use crate::stats::Summary;
use std::rc::Rc;

/// What rounding to `f32` may change, of the colour range, in images up to [`ROUNDING_SIZE`] pixels wide: what
/// `tests/frame.rs` holds every frame to, fifty times the largest error seen there.
const ROUNDING: f64 = 1e-4;

/// Positions are rounded relatively to the image's size: in larger ones [`ROUNDING`] grows with it.
const ROUNDING_SIZE: f64 = 128.0;

/// [`ROUNDING`] in the images of a camera.
pub(super) fn rounding(camera: &Camera) -> f64 {
    let size = f64::from(camera.width.max(camera.height));
    ROUNDING * (size / ROUNDING_SIZE).max(1.0)
}

/// What is drawn.
#[derive(Clone, Copy, Debug)]
pub struct Frames<'a> {
    /// The scene.
    pub splats: &'a Splats,
    /// From where.
    pub cameras: &'a [Camera],
    /// The views that splats are pruned by: none of theirs shows more than the error.
    pub pruned_by: &'a [Camera],
    /// Near plane, world units.
    pub near: f32,
}

/// A setting, ready to be drawn.
struct Subject {
    setting: FrameSetting,
    model: Rc<Model>,
    renderer: Renderer,
    /// Nanoseconds of each timed run, over all views: on the device, and of the process.
    device_ns: Vec<f64>,
    cpu_ns: Vec<f64>,
    errors: Vec<Judged>,
}

impl Frames<'_> {
    /// Times and judges every setting, and the projection that all share.
    pub(super) fn measure(
        &self,
        gpu: &Gpu,
        plan: &Plan,
        progress: &mut dyn FnMut(&str),
    ) -> Result<(Vec<FramePoint>, Option<Errors>)> {
        let settings = settings::of_frames(self.splats.sh_degree, plan);
        progress("frames: pruning");
        let mut scenes = Scenes::new(gpu, self)?;
        let mut approximations = Vec::new();
        for setting in &settings {
            approximations.push(setting.approximations(self.splats, &scenes.removed(setting)?));
        }
        let view = ViewOptions {
            background: training::BACKGROUND,
            near: self.near,
            mode: self.splats.mode,
        };
        let mut subject = |setting: FrameSetting| -> Result<Subject> {
            let options = RenderOptions {
                accuracy: setting.accuracy,
                sh_degree: setting.sh_degree,
                precision: setting.precision,
                ..RenderOptions::default()
            };
            Ok(Subject {
                model: scenes.model(&setting)?,
                setting,
                renderer: Renderer::new(gpu, options)?,
                device_ns: Vec::new(),
                cpu_ns: Vec::new(),
                errors: Vec::new(),
            })
        };
        let mut subjects = settings
            .into_iter()
            .map(&mut subject)
            .collect::<Result<Vec<_>>>()?;
        let mut by_rays = Vec::new();
        for (index, camera) in self.cameras.iter().enumerate() {
            let (number, of) = (index + 1, self.cameras.len());
            progress(&format!("frames: the exact view {number} of {of}"));
            let traced = trace(self.splats, camera, &self.options(), &approximations);
            by_rays.extend(self.by_rays(camera, &traced, plan.ray_pixels));
            for (which, subject) in subjects.iter_mut().enumerate() {
                let drawn = subject.renderer.render(&subject.model, camera, &view)?;
                let judged = judge(&drawn.rgb, &traced, which, rounding(camera));
                subject.errors.push(judged);
            }
        }
        // In turns, so that what disturbs the machine disturbs all alike.
        for run in 0..plan.runs.max(1) {
            progress(&format!("frames: run {} of {}", run + 1, plan.runs));
            for subject in &mut subjects {
                subject.time(self.cameras, &view)?;
            }
        }
        let point = |c: &Subject| c.point(self.cameras.len());
        let points = subjects.iter().map(point).collect();
        Ok((points, (!by_rays.is_empty()).then(|| errors(by_rays))))
    }

    /// By how much each channel of some pixels differs between linear projection and rays.
    fn by_rays(&self, camera: &Camera, traced: &[Traced], most: usize) -> Vec<[f64; 3]> {
        // Every so many of the image's pixels, row after row; an odd number, so as to take all columns.
        let every = traced.len().div_ceil(most.max(1)) | 1;
        let pixels: Vec<usize> = (0..traced.len()).step_by(every).collect();
        let seen = ray::colors(self.splats, camera, &self.options(), &pixels);
        let off = |(pixel, seen): (&usize, &[f64; 3])| {
            [0, 1, 2].map(|c| (seen[c] - traced[*pixel].color[c]).abs())
        };
        pixels.iter().zip(&seen).map(off).collect()
    }

    fn options(&self) -> reference::Options {
        reference::Options {
            background: training::BACKGROUND.map(f64::from),
            near: f64::from(self.near),
            sh_degree: self.splats.sh_degree,
            thresholds: reference::Thresholds::NONE,
        }
    }
}

/// A frame beside the exact one.
#[derive(Clone, Debug, PartialEq)]
pub struct Judged {
    /// Largest error of each pixel.
    errors: Vec<f64>,
    bounds: Vec<f64>,
    /// Sum of squares over pixels and channels.
    square: f64,
    rounding: f64,
    /// The most that a pixel lies beyond its bound and rounding.
    pub excess: f64,
}

/// Compares a frame with the exact one; `which` of its bounds counts, and rounding may change so much of a pixel's
/// colour range.
pub fn judge(drawn: &[[f32; 3]], traced: &[Traced], which: usize, share: f64) -> Judged {
    assert_eq!(drawn.len(), traced.len(), "sizes differ");
    let mut judged = Judged {
        errors: Vec::with_capacity(drawn.len()),
        bounds: traced.iter().map(|t| t.bounds[which]).collect(),
        square: 0.0,
        rounding: 0.0,
        excess: f64::NEG_INFINITY,
    };
    for ((pixel, exact), bound) in drawn.iter().zip(traced).zip(&judged.bounds) {
        let off = [0, 1, 2].map(|c| (f64::from(pixel[c]) - exact.color[c]).abs());
        judged.square += off.iter().map(|d| d * d).sum::<f64>();
        // NaN must win.
        let error = off
            .into_iter()
            .fold(0.0, |a: f64, b| if b > a || b.is_nan() { b } else { a });
        let rounding = share * exact.range + exact.order;
        judged.rounding = judged.rounding.max(rounding);
        let excess = error - bound - rounding;
        if excess > judged.excess || excess.is_nan() {
            judged.excess = excess;
        }
        judged.errors.push(error);
    }
    judged
}

impl Subject {
    fn time(&mut self, cameras: &[Camera], view: &ViewOptions) -> Result<()> {
        let (clock, mut device_ns) = (CpuClock::now(), 0.0);
        for camera in cameras {
            self.renderer.render(&self.model, camera, view)?;
            let stages = self.renderer.timings()?;
            device_ns += stages.iter().map(|(_, ns)| ns).sum::<f64>();
        }
        self.device_ns.push(device_ns);
        self.cpu_ns.extend(clock.elapsed_ns());
        Ok(())
    }

    fn point(&self, views: usize) -> FramePoint {
        let pool = |of: fn(&Judged) -> &Vec<f64>| -> Vec<f64> {
            let mut all: Vec<f64> = self.errors.iter().flat_map(of).copied().collect();
            all.sort_by(f64::total_cmp);
            all
        };
        let (errors, bounds) = (pool(|j| &j.errors), pool(|j| &j.bounds));
        let pixels = errors.len() as f64;
        let psnr = |mean_square: f64| -10.0 * mean_square.log10();
        let squares: f64 = self.errors.iter().map(|j| j.square).sum();
        let promised: f64 = bounds.iter().map(|b| b * b).sum();
        let most = |of: fn(&Judged) -> f64| {
            let all = self.errors.iter().map(of);
            all.fold(
                f64::NEG_INFINITY,
                |a, b| if b > a || b.is_nan() { b } else { a },
            )
        };
        FramePoint {
            knob: self.setting.knob.clone(),
            time_ms: milliseconds(&self.device_ns, views),
            cpu_ms: milliseconds(&self.cpu_ns, views).value,
            scene_bytes: bytes(&self.model),
            error: Errors {
                psnr_db: psnr(squares / (3.0 * pixels)),
                ..percentiles(&errors)
            },
            bound: Errors {
                psnr_db: psnr(promised / pixels),
                ..percentiles(&bounds)
            },
            rounding: most(|j| j.rounding),
            excess: most(|j| j.excess),
        }
    }
}

/// What a scene takes on the device.
fn bytes(model: &Model) -> usize {
    let params = model.params.iter().map(Buffer::bytes);
    let slots = model.splat_from_slot.iter().map(Buffer::bytes);
    params.chain(slots).sum::<u64>() as usize
}

/// The median of runs over so many frames each, per frame.
pub(super) fn milliseconds(runs_ns: &[f64], frames: usize) -> Interval {
    let share = 1e-6 / frames as f64;
    let summary = Summary::of(runs_ns);
    let [low, high] = summary.interval;
    Interval::new(
        summary.median * share,
        low * share,
        high * share,
        summary.runs,
    )
}

/// Of pixels' channels.
fn errors(pixels: Vec<[f64; 3]>) -> Errors {
    let square = |pixel: &[f64; 3]| pixel.iter().map(|d| d * d).sum::<f64>();
    let mean = pixels.iter().map(square).sum::<f64>() / (3 * pixels.len()) as f64;
    let largest = |pixel: &[f64; 3]| pixel.iter().copied().fold(0.0, f64::max);
    let mut worst: Vec<f64> = pixels.iter().map(largest).collect();
    worst.sort_by(f64::total_cmp);
    Errors {
        psnr_db: -10.0 * mean.log10(),
        ..percentiles(&worst)
    }
}

/// Of ascending values.
fn percentiles(sorted: &[f64]) -> Errors {
    let at = |share: f64| sorted.get(((sorted.len().max(1) - 1) as f64 * share).round() as usize);
    Errors {
        max: at(1.0).copied().unwrap_or(f64::NAN),
        p99: at(0.99).copied().unwrap_or(f64::NAN),
        psnr_db: f64::NAN,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exact(bound: f64) -> Traced {
        Traced {
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
        let kept = judge(&drawn, &traced, 1, 1e-4);
        assert!(kept.excess < 0.0, "{}", kept.excess);
        // Below the largest bound, but above its own.
        let broken = judge(&[drawn[0], [0.5, 0.25, 0.005]], &traced, 1, 1e-4);
        assert!(
            (broken.excess - (5e-3 - 1e-3 - 1e-4)).abs() < 1e-6,
            "{}",
            broken.excess
        );
        // Rounding may explain it.
        let large = judge(&[drawn[0], [0.5, 0.25, 0.005]], &traced, 1, 64e-4);
        assert!(large.excess < 0.0, "{}", large.excess);
        let poison = judge(&[[f32::NAN; 3], drawn[1]], &traced, 1, 1e-4);
        assert!(poison.excess.is_nan());
    }
}
