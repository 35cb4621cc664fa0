//! Stability suite for users: their device, and optionally their scene.
//!
//! `tests/device/stability` is the suite for developers, with a test for every recorded failure. This smaller suite is
//! part of the library. Each check has a bound, derived in place, and a measured value; the result is a
//! [`StressReport`], which [`page`] shows.
//!
//! **Invariant:** no file access and no printing; a check without a measurement has failed.

mod curve;
mod determinism;
mod device;
mod gradients;
pub mod outcome;
pub mod page;
mod poison;
mod scenes;
mod sizes;
mod step;
mod subject;
mod surfels;
mod sweeps;
mod thumbnail;

use crate::Result;
use crate::gpu::Gpu;
use crate::reference::sample::{PixelBound, sample, spread};
use crate::render::{Model, RenderOptions, RenderedImage, Renderer};
use crate::scene::{Camera, Splats};
use outcome::{CheckGroup, StressCheck, StressReport, Sweep, Thumbnail};
use std::ops::ControlFlow;
use subject::{reference_options, view_options};

pub use subject::StressScene;

/// Size of the suite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StressPlan {
    /// Pixels of each picture that are compared with the reference.
    pub pixels: usize,
    /// Few steps of sweeps, and no large pictures.
    pub is_quick: bool,
}

impl StressPlan {
    /// Well under two minutes on a software device.
    pub const USUAL: StressPlan = StressPlan {
        pixels: 600,
        is_quick: false,
    };

    /// A few seconds, for tests.
    pub const QUICK: StressPlan = StressPlan {
        pixels: 150,
        is_quick: true,
    };
}

/// Unit of errors of pictures.
const OF_RANGE: &str = "of 1, the brightest";

/// Runs all groups. `progress` is called with the next group, and may cancel the run; then the result is `None`.
///
/// # Errors
/// Those of the device; a check that fails is an outcome, not an error.
pub fn run(
    gpu: &Gpu,
    subject: &StressScene,
    plan: StressPlan,
    progress: &mut dyn FnMut(CheckGroup) -> ControlFlow<()>,
) -> Result<Option<StressReport>> {
    let mut lab = StressRun {
        group: CheckGroup::Device,
        gpu,
        subject,
        plan,
        renderer: Renderer::new(gpu, RenderOptions::default())?,
        found: StressReport::default(),
    };
    for group in CheckGroup::ALL {
        if progress(group).is_break() {
            return Ok(None);
        }
        lab.group = group;
        match group {
            CheckGroup::Device => device::run(&mut lab)?,
            CheckGroup::Scenes => scenes::run(&mut lab)?,
            CheckGroup::Poison => poison::run(&mut lab)?,
            CheckGroup::Sizes => sizes::run(&mut lab)?,
            CheckGroup::Sweeps => {
                sweeps::run(&mut lab)?;
                surfels::run(&mut lab)?;
            }
            CheckGroup::Gradients => gradients::run(&mut lab)?,
            CheckGroup::Determinism => determinism::run(&mut lab)?,
        }
    }
    Ok(Some(lab.found))
}

/// State of a run of the suite.
struct StressRun<'a> {
    /// Group of the checks that are added.
    group: CheckGroup,
    gpu: &'a Gpu,
    subject: &'a StressScene,
    plan: StressPlan,
    renderer: Renderer,
    found: StressReport,
}

impl StressRun<'_> {
    fn draw(&mut self, splats: &Splats, camera: &Camera, near: f64) -> Result<RenderedImage> {
        let model = Model::upload(self.gpu, splats)?;
        self.renderer.render(&model, camera, &view_options(splats, near))
    }

    /// Draws a picture and compares a sample of its pixels with the reference, as [`compare`] does.
    fn look(&mut self, scene: &StressScene, camera: &Camera) -> Result<(RenderedImage, [f64; 2])> {
        let image = self.draw(&scene.splats, camera, scene.near)?;
        let pixels = spread(camera.width, camera.height, self.plan.pixels);
        let options = reference_options(&scene.exact, f64::from(scene.near as f32));
        let sampled = sample(&scene.exact, camera, &options, &pixels);
        let compared = compare(&image, &sampled);
        Ok((image, compared))
    }

    /// Adds a check of a measured value and its upper bound.
    fn at_most(&mut self, name: impl Into<String>, what: impl Into<String>, pair: [f64; 2], unit: &'static str) {
        let outcome = StressCheck::at_most(self.group, name, what, pair, unit);
        self.found.outcomes.push(outcome);
    }

    /// Adds a check of a count that must be 0.
    fn none(&mut self, name: impl Into<String>, what: impl Into<String>, count: usize, unit: &'static str) {
        self.at_most(name, what, [count as f64, 0.0], unit);
    }

    /// Adds a sweep and its check.
    fn sweep(&mut self, sweep: Sweep, unit: &'static str) {
        self.found.outcomes.push(sweep.outcome(unit));
        self.found.sweeps.push(sweep);
    }

    /// Adds pictures without a curve.
    fn pictures(&mut self, caption: &'static str, thumbnails: Vec<Thumbnail>) {
        self.found.sweeps.push(Sweep {
            group: self.group,
            title: "As drawn",
            caption,
            thumbnails,
            ..Sweep::default()
        });
    }
}

/// Error and bound of the pixel closest to its bound; NaN anywhere in the picture is beyond all.
fn compare(image: &RenderedImage, sampled: &[PixelBound]) -> [f64; 2] {
    let mut all = image.rgb.as_flattened().iter().chain(&image.transmittance);
    if !all.all(|value| value.is_finite()) {
        return [f64::NAN, f64::MIN_POSITIVE];
    }
    let mut worst = [0.0, f64::MIN_POSITIVE];
    let mut consider = |measured: f64, bound: f64| {
        if measured / bound >= worst[0] / worst[1] {
            worst = [measured, bound];
        }
    };
    for pixel in sampled {
        let (rgb, passes) = (image.rgb[pixel.index], image.transmittance[pixel.index]);
        for (found, exact) in rgb.iter().zip(pixel.color) {
            consider((f64::from(*found) - exact).abs(), pixel.color_bound);
        }
        let error = (f64::from(passes) - pixel.transmittance).abs();
        consider(error, pixel.transmittance_bound);
    }
    worst
}

/// Numbers that differ from the expected ones, or are missing or too many.
fn unequal<T: PartialEq>(found: &[T], expected: &[T]) -> usize {
    let missing = found.len().abs_diff(expected.len());
    missing + found.iter().zip(expected).filter(|(a, b)| a != b).count()
}

/// A picture for the page.
fn thumbnail(label: impl Into<String>, image: &RenderedImage) -> Thumbnail {
    Thumbnail::new(label, [image.width, image.height], &image.rgb)
}

/// Pixels that differ in any bit, colour or transmittance.
fn differing(a: &RenderedImage, b: &RenderedImage) -> usize {
    let bits = |r: &RenderedImage, i: usize| {
        let [red, green, blue] = r.rgb[i].map(f32::to_bits);
        [red, green, blue, r.transmittance[i].to_bits()]
    };
    let same_size = (a.width, a.height) == (b.width, b.height);
    assert!(same_size, "pictures of one size are compared");
    (0..a.rgb.len()).filter(|&i| bits(a, i) != bits(b, i)).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(red: f32) -> RenderedImage {
        RenderedImage {
            width: 2,
            height: 1,
            rgb: vec![[red, 0.0, 0.0], [0.5; 3]],
            transmittance: vec![0.5; 2],
            depth: Vec::new(),
            ids: Vec::new(),
            id_depth: Vec::new(),
            surface: None,
        }
    }

    fn sampled(index: usize, color: [f64; 3], bound: f64) -> PixelBound {
        PixelBound {
            index,
            color,
            transmittance: 0.5,
            color_bound: bound,
            transmittance_bound: 1e-6,
        }
    }

    #[test]
    fn the_pixel_closest_to_its_own_bound_counts() {
        let exact = [
            sampled(0, [0.25, 0.0, 0.0], 1e-2),
            sampled(1, [0.5, 0.5, 0.500_01], 2e-5),
        ];
        let [measured, bound] = compare(&image(0.251), &exact);
        assert!((measured - 1e-5).abs() < 1e-9 && bound == 2e-5);
        let [measured, bound] = compare(&image(0.27), &exact);
        assert!(measured > bound && bound == 1e-2);
        // NaN outside the sample.
        assert!(compare(&image(f32::NAN), &exact[1..])[0].is_nan());
    }

    #[test]
    fn bits_differ_where_values_may_not() {
        assert_eq!(differing(&image(0.0), &image(-0.0)), 1);
        assert_eq!(differing(&image(f32::NAN), &image(f32::NAN)), 0);
        assert_eq!(unequal(&[1, 2, 3], &[1, 5, 3]), 1);
        assert_eq!(unequal(&[1, 2], &[1, 2, 3]), 1);
    }
}
