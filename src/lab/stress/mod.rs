//! The stability suite for users: their device, and their scene if they have one.
//!
//! `tests/stability` is the suite for developers: every failure on record, each with its test. This is the smaller
//! instrument that goes where the library goes. Each check states a bound that is derived where it stands and
//! measures against it; what was found is a [`Stress`], which [`crate::lab::stress::outcome`] writes.
//!
//! **Invariant:** nothing here reads a file or prints; a check that could not be made is no success.

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
mod still;
mod subject;
mod sweeps;

use crate::Result;
use crate::gpu::Gpu;
use crate::reference::sample::{Sampled, sample, spread};
use crate::render::{Model, RenderOptions, Rendered, Renderer};
use crate::scene::{Camera, Splats};
use outcome::{Group, Outcome, Still, Stress, Sweep};
use std::ops::ControlFlow;
use subject::{reference_options, view_options};

pub use subject::Subject;

/// How much is tried.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Pixels of each picture that are compared with the reference.
    pub pixels: usize,
    /// Whether sweeps take few steps and the largest pictures are left out.
    pub is_quick: bool,
}

impl Plan {
    /// Well under two minutes on a software device.
    pub const USUAL: Plan = Plan {
        pixels: 600,
        is_quick: false,
    };

    /// A few seconds: whether all works.
    pub const QUICK: Plan = Plan {
        pixels: 150,
        is_quick: true,
    };
}

/// Unit of errors of pictures.
const OF_RANGE: &str = "of 1, the brightest";

/// Runs everything. `progress` is told which group is next, and may end it all: then there is no result.
///
/// # Errors
/// Those of the device; a check that fails is an outcome, not an error.
pub fn run(
    gpu: &Gpu,
    subject: &Subject,
    plan: Plan,
    progress: &mut dyn FnMut(Group) -> ControlFlow<()>,
) -> Result<Option<Stress>> {
    let mut lab = Lab {
        gpu,
        subject,
        plan,
        renderer: Renderer::new(gpu, RenderOptions::default())?,
        found: Stress::default(),
    };
    for group in Group::ALL {
        if progress(group).is_break() {
            return Ok(None);
        }
        match group {
            Group::Device => device::run(&mut lab)?,
            Group::Scenes => scenes::run(&mut lab)?,
            Group::Poison => poison::run(&mut lab)?,
            Group::Sizes => sizes::run(&mut lab)?,
            Group::Sweeps => sweeps::run(&mut lab)?,
            Group::Gradients => gradients::run(&mut lab)?,
            Group::Determinism => determinism::run(&mut lab)?,
        }
    }
    Ok(Some(lab.found))
}

/// Scenes as the device and as the reference have them.
#[derive(Clone)]
struct Pair {
    drawn: Splats,
    exact: Splats,
}

impl Pair {
    fn of(subject: &Subject) -> Pair {
        Pair {
            drawn: subject.splats.clone(),
            exact: subject.exact.clone(),
        }
    }

    /// Both changed in the same way.
    fn map(&self, change: impl Fn(&Splats) -> Splats) -> Pair {
        Pair {
            drawn: change(&self.drawn),
            exact: change(&self.exact),
        }
    }

    /// As `map`, in place.
    fn with(&self, change: impl Fn(&mut Splats)) -> Pair {
        self.map(|splats| {
            let mut splats = splats.clone();
            change(&mut splats);
            splats
        })
    }

    /// At most so many of the splats, spread over all.
    fn thinned(&self, most: usize) -> Pair {
        let step = self.drawn.len().div_ceil(most).max(1);
        let some: Vec<usize> = (0..self.drawn.len()).step_by(step).collect();
        self.map(|splats| splats.picked(&some))
    }
}

/// What checks work with.
struct Lab<'a> {
    gpu: &'a Gpu,
    subject: &'a Subject,
    plan: Plan,
    renderer: Renderer,
    found: Stress,
}

/// What the worst pixel of a picture is off by, and may be.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Compared {
    measured: f64,
    bound: f64,
}

impl Lab<'_> {
    fn draw(&mut self, splats: &Splats, camera: &Camera, near: f64) -> Result<Rendered> {
        let model = Model::upload(self.gpu, splats)?;
        self.renderer
            .render(&model, camera, &view_options(splats, near))
    }

    /// Draws a picture and compares it with the reference, in some pixels of it.
    fn look(&mut self, pair: &Pair, camera: &Camera, near: f64) -> Result<(Rendered, Compared)> {
        let image = self.draw(&pair.drawn, camera, near)?;
        let pixels = spread(camera.width, camera.height, self.plan.pixels);
        let options = reference_options(&pair.exact, f64::from(near as f32));
        let sampled = sample(&pair.exact, camera, &options, &pixels);
        let compared = compare(&image, &sampled);
        Ok((image, compared))
    }

    fn add(&mut self, outcome: Outcome) {
        self.found.outcomes.push(outcome);
    }

    /// Adds a sweep and the check that it amounts to.
    fn sweep(&mut self, sweep: Sweep, unit: &'static str) {
        self.add(sweep.outcome(unit));
        self.found.sweeps.push(sweep);
    }
}

/// The pixel that comes closest to its bound; one that is no number, anywhere in the picture, is beyond all.
fn compare(image: &Rendered, sampled: &[Sampled]) -> Compared {
    let mut worst = Compared {
        measured: 0.0,
        bound: f64::MIN_POSITIVE,
    };
    let all = image.rgb.as_flattened().iter().chain(&image.transmittance);
    if !all.clone().all(|value| value.is_finite()) {
        worst.measured = f64::NAN;
        return worst;
    }
    let mut consider = |measured: f64, bound: f64| {
        if measured / bound >= worst.measured / worst.bound {
            worst = Compared { measured, bound };
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

/// A picture for the page.
fn still(label: impl Into<String>, image: &Rendered) -> Still {
    Still::new(label, [image.width, image.height], &image.rgb)
}

/// Pixels that differ in any bit, colour or transmittance.
fn differing(a: &Rendered, b: &Rendered) -> usize {
    let bits = |r: &Rendered, i: usize| {
        let [red, green, blue] = r.rgb[i].map(f32::to_bits);
        [red, green, blue, r.transmittance[i].to_bits()]
    };
    let same_size = (a.width, a.height) == (b.width, b.height);
    assert!(same_size, "pictures of one size are compared");
    (0..a.rgb.len())
        .filter(|&i| bits(a, i) != bits(b, i))
        .count()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(red: f32) -> Rendered {
        Rendered {
            width: 2,
            height: 1,
            rgb: vec![[red, 0.0, 0.0], [0.5; 3]],
            transmittance: vec![0.5; 2],
            depth: Vec::new(),
        }
    }

    fn sampled(index: usize, color: [f64; 3], bound: f64) -> Sampled {
        Sampled {
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
        let found = compare(&image(0.251), &exact);
        assert!((found.measured - 1e-5).abs() < 1e-9 && found.bound == 2e-5);
        let found = compare(&image(0.27), &exact);
        assert!(found.measured > found.bound && found.bound == 1e-2);
        // Not sampled, but no number.
        let found = compare(&image(f32::NAN), &exact[1..]);
        assert!(found.measured.is_nan());
    }

    #[test]
    fn bits_differ_where_values_may_not() {
        assert_eq!(differing(&image(0.0), &image(-0.0)), 1);
        assert_eq!(differing(&image(f32::NAN), &image(f32::NAN)), 0);
    }
}
