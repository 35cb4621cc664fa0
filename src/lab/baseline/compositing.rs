//! Compositing against baselines, forward and backward.

use super::scalar::{self, HostInput};
use super::{Ratio, TARGET_FEATURES, case, compare, is_wanted, on_device, vector};
use crate::Result;
use crate::gpu::Recorder;
use crate::kernels::rasterize::Outputs;
use crate::kernels::{baseline_16x16, baseline_16x16_backward, rasterize, rasterize_backward};
use crate::lab::bench::kernels::gradient::{SAMPLED, SOURCE_TOLERANCE, SPLAT_TOLERANCE, params};
use crate::lab::bench::kernels::{Composite, CompositeBuffers, Device, Gradient};
use crate::lab::bench::session::{Bench, Case};
use crate::lab::bench::trial::{Subject, host_times};

const COUNT: usize = 50_000;
const SIZE: [u32; 2] = [480, 272];
const SIGMA_MAX: f64 = 3.0;

const SCALAR: &str = "processor scalar";

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
    let [image_choice, choice] = [Outputs::default(), Outputs::TRAINING]
        .map(|outputs| rasterize::Choice::prefer(gpu.caps()).of_outputs(outputs));
    let lanes = choice.spec.workgroup;
    // Outputs for training include the end of each pixel's list, as do all baselines but the vectorised one.
    let ours = format!("rasterize {}/{lanes}", choice.variant.name());
    let image_ours = format!("rasterize image {}/{lanes}", choice.variant.name());
    let vectorised = format!("processor vectorised {TARGET_FEATURES}");
    let names = [&ours, &image_ours, "baseline_16x16", SCALAR, &vectorised];
    if !is_wanted(bench, "forward", &names) {
        return Ok(Vec::new());
    }
    let engine = Composite::new(COUNT, SIZE, SIGMA_MAX);
    let squares = Composite::baseline_16x16(COUNT, SIZE, SIGMA_MAX);
    let (input, square_input) = (
        CompositeBuffers::new(&gpu, &engine)?,
        CompositeBuffers::new(&gpu, &squares)?,
    );
    let host = HostInput::new(&squares);
    let work = engine.work();
    let case = |variant: &str| case("forward", variant).doing(work);
    let kernel = rasterize::Rasterize::new(&gpu, choice)?;
    let image_kernel = rasterize::Rasterize::new(&gpu, image_choice)?;
    let old = baseline_16x16::Baseline16x16::new(&gpu, baseline_16x16::Choice::default())?;
    let record = |kernel: &rasterize::Rasterize, rec: &mut Recorder<'_>| {
        kernel.record(rec, input.rasterize(), input.params(), input.groups());
    };

    let (image, ends) = scalar::forward(&host);
    case(SCALAR).judge(&squares.outputs(&planes(&image), Some(&ends)))?;
    let image = vector::forward(&host);
    case(&vectorised).judge(&squares.outputs(&planes(&image), None))?;
    let subjects = vec![
        on_device(
            &gpu,
            case(&ours),
            |_| {},
            |rec| record(&kernel, rec),
            || input.outputs(&gpu, &engine),
        )?,
        on_device(
            &gpu,
            case(&image_ours),
            |_| {},
            |rec| record(&image_kernel, rec),
            || input.image_outputs(&gpu, &engine),
        )?,
        on_device(
            &gpu,
            case("baseline_16x16"),
            |_| {},
            |rec| {
                let groups = square_input.groups();
                old.record(rec, square_input.baseline_16x16(), groups);
            },
            || square_input.outputs(&gpu, &squares),
        )?,
        on_host(case(SCALAR), || drop(scalar::forward(&host))),
        on_host(case(&vectorised), || drop(vector::forward(&host))),
    ];
    let pairs = [
        [ours.as_str(), "baseline_16x16"],
        [&ours, SCALAR],
        [&image_ours, "processor vectorised"],
    ];
    compare(bench, "forward", subjects, &pairs)
}

pub(super) fn backward(bench: &mut Bench) -> Result<Vec<Ratio>> {
    let gpu = bench.gpu().clone();
    let choice = rasterize_backward::Choice::prefer(gpu.caps());
    let ours = format!("rasterize_backward {}/{}", choice.variant.name(), choice.spec.workgroup);
    if !is_wanted(bench, "backward", &[&ours, "baseline_16x16", SCALAR]) {
        return Ok(Vec::new());
    }
    let engine = Composite::new(COUNT, SIZE, SIGMA_MAX);
    let squares = Composite::baseline_16x16(COUNT, SIZE, SIGMA_MAX);
    let (input, square_input) = (
        CompositeBuffers::new(&gpu, &engine)?,
        CompositeBuffers::new(&gpu, &squares)?,
    );
    let (gradient, square_gradient) = (Gradient::new(&engine, SAMPLED), Gradient::new(&squares, SAMPLED));
    let device = Device::new(&gpu, &engine, &gradient)?;
    let square_device = Device::new(&gpu, &squares, &square_gradient)?;
    let host = HostInput::new(&squares);
    let work = engine.work();
    let case = |variant: &str| case("backward", variant).doing(work);
    let kernel = rasterize_backward::RasterizeBackward::new(&gpu, choice)?;

    let (image, ends) = scalar::forward(&host);
    let sums = scalar::backward(&host, &image, &ends, &square_gradient.d_sampled);
    case(SCALAR).judge(&square_gradient.judge_splats(&scalar::whitened(&host, &sums), SPLAT_TOLERANCE))?;
    for device in [&device, &square_device] {
        gpu.run(|rec| device.upstream(rec, true))?;
    }
    let mut subjects = vec![on_device(
        &gpu,
        case(&ours),
        |_| {},
        |rec| {
            let io = device.rasterize_backward(&input);
            kernel.record(rec, io, params(&input), input.groups());
        },
        || device.judge_sources(&gradient, SOURCE_TOLERANCE),
    )?];
    // The design needs atomic addition of floats.
    let old = baseline_16x16_backward::Choice::default();
    if gpu.caps().supports(old.variant.info()).is_ok() {
        let old = baseline_16x16_backward::Baseline16x16Backward::new(&gpu, old)?;
        let (device, input) = (&square_device, &square_input);
        subjects.push(on_device(
            &gpu,
            case("baseline_16x16"),
            |_| {},
            move |rec| {
                let io = device.baseline_16x16_backward(input);
                old.record_cleared(rec, io, input.groups());
            },
            || device.judge_splats(&square_gradient, SPLAT_TOLERANCE),
        )?);
    }
    subjects.push(on_host(case(SCALAR), || {
        drop(scalar::backward(&host, &image, &ends, &square_gradient.d_image));
    }));
    for device in [&device, &square_device] {
        gpu.run(|rec| device.upstream(rec, false))?;
    }
    let pairs = [[ours.as_str(), "baseline_16x16"], [&ours, SCALAR]];
    compare(bench, "backward", subjects, &pairs)
}
