//! Compositing against baselines, forward and backward.

use super::scalar::{self, HostInput};
use super::{Ratio, TARGET_FEATURES, case, compare, is_wanted, vector};
use crate::Result;
use crate::kernels::rasterize::Outputs;
use crate::kernels::{baseline_16x16, baseline_16x16_backward, rasterize, rasterize_backward};
use crate::lab::bench::input::scene::scattered;
use crate::lab::bench::kernels::gradient::{self, Gradient, SAMPLED, SOURCE_TOLERANCE, SPLAT_TOLERANCE};
use crate::lab::bench::kernels::{Composite, composite};
use crate::lab::bench::session::{Bench, Case};
use crate::lab::bench::trial::{Subject, host_times};
use std::rc::Rc;

const COUNT: usize = 50_000;
const SIZE: [u32; 2] = [480, 272];
const SIGMA_MAX: f64 = 3.0;

const BASELINE: &str = "baseline_16x16";
const SCALAR: &str = "processor scalar";

/// The scene by the engine's tiles and by those of the baselines.
fn composites() -> [Composite; 2] {
    [Composite::of, Composite::in_squares].map(|of| of(scattered(COUNT, SIZE, SIGMA_MAX, 0)))
}

fn on_host<'a>(case: Case, run: impl Fn() + 'a) -> Subject<'a> {
    Subject {
        case,
        run: Box::new(move || Ok(host_times(&run))),
    }
}

/// An image by pixel as planes.
fn planes(image: &[[f32; 4]]) -> Vec<f32> {
    (0..4)
        .flat_map(|plane| image.iter().map(move |pixel| pixel[plane]))
        .collect()
}

pub(super) fn forward(bench: &mut Bench) -> Result<Vec<Ratio>> {
    let gpu = bench.gpu().clone();
    let choice = rasterize::Choice::prefer(gpu.caps(), Outputs::TRAINING);
    let lanes = choice.spec.workgroup;
    // Outputs for training include the end of each pixel's list, as do all baselines but the vectorised one.
    let ours = format!("rasterize {}/{lanes}", choice.variant.name());
    let image_ours = format!("rasterize image {}/{lanes}", choice.variant.name());
    let vectorised = format!("processor vectorised {TARGET_FEATURES}");
    let names = [&ours, &image_ours, BASELINE, SCALAR, &vectorised];
    if !is_wanted(bench, "forward", &names) {
        return Ok(Vec::new());
    }
    let [engine, squares] = composites();
    let host = HostInput::new(&squares);
    let case = |variant: &str| case("forward", variant).doing(engine.work());
    let (image, ends) = scalar::forward(&host);
    case(SCALAR).judge(&squares.outputs(&planes(&image), Some(&ends)))?;
    let image = vector::forward(&host);
    case(&vectorised).judge(&squares.outputs(&planes(&image), None))?;
    let training = composite::rasterize(&gpu, &engine, Outputs::TRAINING)?;
    let image = composite::rasterize(&gpu, &engine, Outputs::default())?;
    let old = composite::baseline_16x16(&gpu, &squares)?;
    let subjects = vec![
        training.subject(&gpu, case(&ours), choice)?,
        image.subject(&gpu, case(&image_ours), choice)?,
        old.subject(&gpu, case(BASELINE), baseline_16x16::Choice::default())?,
        on_host(case(SCALAR), || drop(scalar::forward(&host))),
        on_host(case(&vectorised), || drop(vector::forward(&host))),
    ];
    let pairs = [
        [ours.as_str(), BASELINE],
        [&ours, SCALAR],
        [&image_ours, "processor vectorised"],
    ];
    compare(bench, "forward", subjects, &pairs)
}

pub(super) fn backward(bench: &mut Bench) -> Result<Vec<Ratio>> {
    let gpu = bench.gpu().clone();
    let choice = rasterize_backward::Choice::prefer(gpu.caps(), Outputs::TRAINING);
    let ours = format!("rasterize_backward {}/{}", choice.variant.name(), choice.spec.workgroup);
    if !is_wanted(bench, "backward", &[&ours, BASELINE, SCALAR]) {
        return Ok(Vec::new());
    }
    let [engine, squares] = composites();
    let gradient = Rc::new(Gradient::new(&squares, SAMPLED));
    let host = HostInput::new(&squares);
    let case = |variant: &str| case("backward", variant).doing(engine.work());
    let (image, ends) = scalar::forward(&host);
    let sums = scalar::backward(&host, &image, &ends, &gradient.d_sampled);
    case(SCALAR).judge(&gradient.judge_splats(&scalar::whitened(&host, &sums), SPLAT_TOLERANCE))?;
    let new = Gradient::new(&engine, SAMPLED);
    let new = gradient::rasterize_backward(&gpu, &engine, new, SOURCE_TOLERANCE)?;
    let old = gradient::baseline_16x16_backward(&gpu, &squares, gradient.clone(), SPLAT_TOLERANCE)?;
    let mut subjects = vec![new.subject(&gpu, case(&ours), choice)?];
    // The design needs atomic addition of floats.
    let old_choice = baseline_16x16_backward::Choice::default();
    if gpu.caps().supports(old_choice.variant.info()).is_ok() {
        subjects.push(old.subject(&gpu, case(BASELINE), old_choice)?);
    }
    subjects.push(on_host(case(SCALAR), || {
        drop(scalar::backward(&host, &image, &ends, &gradient.d_image));
    }));
    let pairs = [[ours.as_str(), BASELINE], [&ours, SCALAR]];
    compare(bench, "backward", subjects, &pairs)
}
