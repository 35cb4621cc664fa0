//! Training steps of every setting: their time, and how far their gradients are from the exact ones.

use super::frames::milliseconds;
use super::settings::{self, FrameSetting};
use super::{Plan, reduced, training};
use crate::bench::CpuClock;
use crate::gpu::Gpu;
use crate::io::photo;
use crate::reference::gradient::SplatGradients;
use crate::reference::loss::Target;
use crate::reference::{Cuts, Options, loss_gradient};
use crate::report::chart::GradientPoint;
use crate::scene::{AlphaMode, Dataset, PhotoSource, Point, Splats, Split, View};
use crate::train::{Background, HostState, TrainConfig, Trainer};
use crate::{Error, Result};

/// The step that is taken: late in a long run, when all harmonics are trained and nothing is refined.
const BEGUN: u32 = 20_000;

/// Errors count relatively to the exact value, or to this share of its kind's root mean square where that is
/// more: what is small beside its kind is the remainder of terms that cancel.
const SHARE: f64 = 0.01;

/// Times a step of every setting and compares its gradient.
pub(super) fn measure(
    gpu: &Gpu,
    dataset: &Dataset,
    splats: &Splats,
    plan: &Plan,
    progress: &mut dyn FnMut(&str),
) -> Result<Vec<GradientPoint>> {
    let one = one_view(dataset, plan)?;
    let settings = settings::of_gradients(splats.sh_degree, plan);
    let state = HostState::from_splats(splats, splats.sh_degree);
    let mut trainers = Vec::new();
    for setting in &settings {
        let config = config(setting, splats);
        trainers.push(Trainer::from_state(gpu, &one, config, &state, BEGUN)?);
    }
    progress("gradients: the exact ones");
    let exact = exact(&one, splats, trainers[0].near())?;
    let mut points = Vec::new();
    for (setting, trainer) in settings.iter().zip(&mut trainers) {
        trainer.step()?;
        let planes = trainer.gradients()?;
        let found = HostState {
            sh_degree: splats.sh_degree,
            m: planes.clone(),
            v: planes.clone(),
            params: planes,
        };
        let errors = errors(&found.to_splats(splats.mode), &exact);
        let at = |share: f64| errors.get(((errors.len().max(1) - 1) as f64 * share) as usize);
        points.push(GradientPoint {
            knob: setting.knob.clone(),
            median: at(0.5).copied().unwrap_or(0.0),
            p99: at(0.99).copied().unwrap_or(0.0),
            ..GradientPoint::default()
        });
    }
    let mut times = vec![(Vec::new(), Vec::new()); trainers.len()];
    for run in 0..plan.runs.max(1) {
        progress(&format!("gradients: run {} of {}", run + 1, plan.runs));
        for (trainer, (device_ns, cpu_ns)) in trainers.iter_mut().zip(&mut times) {
            let clock = CpuClock::now();
            trainer.step()?;
            let stages = trainer.timings()?;
            device_ns.push(stages.iter().map(|(_, ns)| ns).sum());
            cpu_ns.extend(clock.elapsed_ns());
        }
    }
    for (point, (device_ns, cpu_ns)) in points.iter_mut().zip(&times) {
        point.time_ms = milliseconds(device_ns, 1);
        point.cpu_ms = milliseconds(cpu_ns, 1).value;
    }
    Ok(points)
}

fn config(setting: &FrameSetting, splats: &Splats) -> TrainConfig {
    TrainConfig {
        sh_degree: splats.sh_degree,
        accuracy: setting.accuracy,
        mode: splats.mode,
        background: Background::Fixed(training::BACKGROUND),
        ..TrainConfig::for_iterations(30_000)
    }
}

/// One training view, small enough for the reference, in a data set of the same extent.
fn one_view(dataset: &Dataset, plan: &Plan) -> Result<Dataset> {
    let index = dataset.split(Split::Train).first().copied();
    let view = index.map(|i| &dataset.views[i]);
    let view = view.ok_or_else(|| Error::Config("the data set has no training view".into()))?;
    let camera = reduced(&view.camera, plan.gradient_pixels);
    let photo = photo::reduce(photo::load(view)?, camera.width, camera.height);
    // The extent of a data set with one camera is 1.1 times the distance of its points.
    let ahead = camera.rotation.row(2) * (dataset.extent() / 1.1);
    let point = Point {
        position: (camera.position + ahead).to_array(),
        color: [0.5; 3],
    };
    // Alpha is composited once and for all, so that the reference need not know of it.
    let target = crate::report::Target::new(&photo, AlphaMode::Composite, training::BACKGROUND);
    let opaque = crate::scene::Photo::from_rgb(camera.width, camera.height, &target.rgb);
    Ok(Dataset {
        views: vec![View {
            name: view.name.clone(),
            camera,
            photo: PhotoSource::Memory(opaque),
        }],
        points: vec![point],
        ..Dataset::default()
    })
}

fn exact(one: &Dataset, splats: &Splats, near: f32) -> Result<SplatGradients> {
    let view = &one.views[0];
    let photo: Vec<[f64; 3]> = photo::load(view)?
        .rgba
        .iter()
        .map(|&[r, g, b, _]| [r, g, b].map(|level| f64::from(level) / 255.0))
        .collect();
    let target = Target {
        lambda: f64::from(TrainConfig::default().lambda_dssim),
        ..Target::new(view.camera.width as usize, &photo)
    };
    let options = Options {
        background: training::BACKGROUND.map(f64::from),
        near: f64::from(near),
        sh_degree: splats.sh_degree,
        cuts: Cuts::NONE,
    };
    Ok(loss_gradient(splats, &view.camera, &options, &target).d_splats)
}

/// Relative errors of all parameters that have a gradient, ascending.
fn errors(found: &Splats, exact: &SplatGradients) -> Vec<f64> {
    let mut errors = Vec::new();
    let mut add = |found: &[f32], exact: &[f64]| {
        let square: f64 = exact.iter().map(|e| e * e).sum();
        let floor = SHARE * (square / exact.len().max(1) as f64).sqrt();
        for (&found, &exact) in found.iter().zip(exact) {
            let off = (f64::from(found) - exact).abs();
            let size = exact.abs().max(floor);
            if off > 0.0 || exact != 0.0 {
                errors.push(off / size);
            }
        }
    };
    add(found.mean.as_flattened(), exact.mean.as_flattened());
    add(
        found.quaternion.as_flattened(),
        exact.quaternion.as_flattened(),
    );
    add(
        found.log_scale.as_flattened(),
        exact.log_scale.as_flattened(),
    );
    add(&found.opacity_logit, &exact.opacity_logit);
    add(&found.sh, &exact.sh);
    errors.sort_by(f64::total_cmp);
    errors
}
