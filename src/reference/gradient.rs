//! Gradient of the training loss by every raw parameter of every splat.
//!
//! Two implementations: [`loss_gradient`] composes the operations' backward passes and is fast; [`loss_derivatives`]
//! sends dual numbers through projection, compositing and loss at once, is slow, and has no chain rule written out
//! anywhere. `tests/host/reference` compares them.

use super::frame::{project_all, render, render_splats};
use super::loss::{self, Target};
use super::project_backward::project_backward;
use super::rasterize_backward::{PixelGradient, ScreenGradient, rasterize_backward};
use super::surfel_backward::surfel_backward;
use super::{Dual, Options, Splat, Viewpoint};
use crate::scene::{Camera, Primitive, Splats};
use rayon::prelude::*;

/// Dual variables per pass over the frame.
const LANES: usize = 8;

/// Gradient of an objective by raw parameters; shapes as in [`Splats`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SplatGradients {
    /// By the mean.
    pub mean: Vec<[f64; 3]>,
    /// By the stored, unnormalised quaternion.
    pub quaternion: Vec<[f64; 4]>,
    /// By the log-scale.
    pub log_scale: Vec<[f64; 3]>,
    /// By the opacity's logit.
    pub opacity_logit: Vec<f64>,
    /// `[splat][coefficient][rgb]`.
    pub sh: Vec<f64>,
}

impl SplatGradients {
    /// From one row per splat, each ordered like [`Splat::parameters`].
    pub fn from_rows(rows: &[Vec<f64>]) -> SplatGradients {
        let mut all = SplatGradients::default();
        for row in rows {
            let splat = Splat::from_parameters(row);
            all.mean.push(splat.mean);
            all.quaternion.push(splat.quaternion);
            all.log_scale.push(splat.log_scale);
            all.opacity_logit.push(splat.opacity_logit);
            all.sh.extend(splat.sh.iter().flatten());
        }
        all
    }
}

/// Loss of a training step with all gradients before the optimiser.
#[derive(Clone, Debug)]
pub struct LossGradient {
    /// The loss.
    pub loss: f64,
    /// Gradient by every raw parameter.
    pub d_splats: SplatGradients,
}

/// Renders the scene, compares it with the target and differentiates the loss.
pub fn loss_gradient(splats: &Splats, camera: &Camera, options: &Options, target: &Target<'_>) -> LossGradient {
    let image = render(splats, camera, options).colors();
    let upstream = |color| PixelGradient {
        color,
        ..PixelGradient::default()
    };
    let upstream: Vec<PixelGradient> = loss::gradient(&image, target).into_iter().map(upstream).collect();
    LossGradient {
        loss: loss::loss(&image, target),
        d_splats: backward(splats, camera, options, &upstream).1,
    }
}

/// Gradients of the splats, on the screen (of 3D Gaussians) and in the world, from a gradient of the frame.
pub fn backward(
    splats: &Splats,
    camera: &Camera,
    options: &Options,
    upstream: &[PixelGradient],
) -> (Vec<ScreenGradient>, SplatGradients) {
    let view = Viewpoint::on(splats, camera, options);
    if splats.primitive == Primitive::Surfel {
        let rows = surfel_backward(&Splat::all(splats), &view, options, upstream);
        return (
            vec![ScreenGradient::default(); rows.len()],
            SplatGradients::from_rows(&rows),
        );
    }
    let splats = Splat::<f64>::all(splats);
    let screen = project_all(&splats, &view);
    let by_screen = rasterize_backward(&screen, camera.width, options, upstream);
    let rows: Vec<Vec<f64>> = splats
        .par_iter()
        .zip(&by_screen)
        .map(|(splat, gradient)| project_backward(splat, &view, &gradient.row))
        .collect();
    (by_screen, SplatGradients::from_rows(&rows))
}

/// Derivative of the loss by each of some parameters, given as (splat, index into [`Splat::parameters`]), with duals
/// from end to end.
pub fn loss_derivatives(
    splats: &Splats,
    camera: &Camera,
    options: &Options,
    target: &Target<'_>,
    parameters: &[(usize, usize)],
) -> Vec<f64> {
    let view = Viewpoint::on(splats, camera, options);
    let rows: Vec<Vec<f64>> = Splat::<f64>::all(splats).iter().map(Splat::parameters).collect();
    let mut derivatives = Vec::with_capacity(parameters.len());
    for chunk in parameters.chunks(LANES) {
        let mut lifted: Vec<Vec<Dual<LANES>>> = rows
            .iter()
            .map(|row| row.iter().map(|&value| Dual::variable(value, None)).collect())
            .collect();
        for (lane, &(splat, parameter)) in chunk.iter().enumerate() {
            lifted[splat][parameter] = Dual::variable(rows[splat][parameter], Some(lane));
        }
        let lifted: Vec<Splat<Dual<LANES>>> = lifted.iter().map(|row| Splat::from_parameters(row)).collect();
        let frame = render_splats(&lifted, &view, options);
        let loss = loss::loss(&frame.colors(), target);
        derivatives.extend(&loss.d[..chunk.len()]);
    }
    derivatives
}
