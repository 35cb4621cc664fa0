//! Cases of the sums that the states of photographs follow from: gains, and residuals of patches.

use super::image_pair::{ImagePair, PATCH, PATCH_SHIFT};
use super::{KernelCase, Workgroups, time};
use crate::Result;
use crate::gpu::{Gpu, Groups};
use crate::kernels::{loss_exposure, loss_residual};
use crate::lab::bench::check::{Output, floats};
use crate::lab::bench::{Bench, Work};
use crate::layout::EXPOSURE_PIXELS;
use crate::reference::loss::{Exposure, Target, residuals, values};
use crate::scene::AlphaMode;

pub(super) fn run(bench: &mut Bench) -> Result<()> {
    let workgroups = Workgroups::any(&[8, 16, 32, 64]);
    for [width, height] in [[480, 272], [1920, 1080]] {
        let name = format!("{width}x{height}");
        let shaded = std::cell::LazyCell::new(|| ImagePair::shaded(width, height));
        time(bench, workgroups, &name, |gpu| expose(gpu, &shaded))?;
        time(bench, workgroups, &name, |gpu| residual(gpu, &shaded))?;
    }
    Ok(())
}

/// Sums for the gains of a photograph, by workgroup.
pub fn expose<'a>(gpu: &Gpu, of: &'a ImagePair) -> Result<KernelCase<'a, loss_exposure::LossExposure>> {
    let (pixels, size) = (of.image.len(), EXPOSURE_PIXELS as usize);
    let groups = pixels.div_ceil(size);
    let (view, image, photo) = of.upload(gpu)?;
    let partials = gpu.buffer::<[f32; 4]>("sums_from_group", 2 * groups)?;
    let [gain, toe] = of.push();
    let alpha_mode = of.alpha_mode();
    let ignored = of.upload_ignored(gpu)?;
    // Nine words of each pixel.
    let case = KernelCase::new(Work::of(pixels, "pixels").moving(16 * pixels))
        .tune(move |choice: &mut loss_exposure::Choice| choice.spec.with_ignored = u32::from(!of.ignored.is_empty()));
    let case = case.compare(&partials, move |all| {
        let exposure = Exposure {
            gain: gain.map(f64::from),
        };
        let (stored, _) = values(&of.rgba, AlphaMode::Mask, [0.0; 3]);
        let weight = |pixel: usize| {
            let coverage = match of.mode {
                AlphaMode::Mask => f64::from(of.rgba[pixel][3]) / 255.0,
                AlphaMode::Composite => f64::from(u8::from(of.rgba[pixel][3] == 255)),
            };
            of.kept(pixel) * coverage
        };
        let mut expected = Vec::new();
        for first in (0..pixels).step_by(size) {
            let stretch = first..(first + size).min(pixels);
            let sums = exposure.sums(&of.image[stretch.clone()], &stored[stretch], |i| weight(first + i));
            expected.extend(sums.as_flattened());
        }
        // Positive terms of a few ulp each, a lane's one after the other: 384 at 8 lanes.
        vec![Output::relative("sums", floats(&all), expected, 1e-4, 1.0)]
    });
    Ok(case.commands(move |rec, kernel: &loss_exposure::LossExposure, _| {
        let io = loss_exposure::Bindings {
            view: &view,
            image: &image,
            photo: &photo,
            sums_from_group: &partials,
            ignored: &ignored,
        };
        let params = loss_exposure::Params {
            alpha_mode,
            gain,
            toe,
            patch_shift: PATCH_SHIFT,
            patch_columns: of.columns() as u32,
            photo_first: 0,
            counted: [0, of.height() as u32],
        };
        kernel.record(rec, io, params, Groups::Count(groups as u32));
    }))
}

/// Residuals of patches.
pub fn residual<'a>(gpu: &Gpu, of: &'a ImagePair) -> Result<KernelCase<'a, loss_residual::LossResidual>> {
    let pixels = of.image.len();
    let patches = of.columns() * of.height().div_ceil(PATCH);
    let (view, image, photo) = of.upload(gpu)?;
    let sums = gpu.buffer::<[f32; 4]>("residual_from_patch", patches)?;
    let [gain, toe] = of.push();
    let alpha_mode = of.alpha_mode();
    // Three channels and the photograph.
    let case = KernelCase::new(Work::of(pixels, "pixels").moving(16 * pixels))
        .tune(move |choice: &mut loss_residual::Choice| choice.spec.with_exposure = of.gain.is_some().into());
    let case = case.compare(&sums, move |all| {
        let (stored, mask) = of.values();
        let exposed = of.exposure().map(|exposure| exposure.image(&of.image, &stored));
        let target = Target {
            mask: mask.as_deref(),
            ..Target::new(of.width, &stored)
        };
        let expected = residuals(exposed.as_ref().unwrap_or(&of.image), &target, PATCH);
        // 64 differences of values up to 1, each of a few ulp.
        vec![Output::relative(
            "residuals",
            floats(&all),
            expected.concat(),
            1e-4,
            1.0,
        )]
    });
    Ok(case.commands(move |rec, kernel: &loss_residual::LossResidual, _| {
        let io = loss_residual::Bindings {
            view: &view,
            image: &image,
            photo: &photo,
            residual_from_patch: &sums,
        };
        let params = loss_residual::Params {
            alpha_mode,
            gain,
            toe,
            patch_shift: PATCH_SHIFT,
            patch_columns: of.columns() as u32,
            photo_first: 0,
            counted: [0, of.height() as u32],
        };
        kernel.record(rec, io, params, Groups::Count(patches as u32));
    }))
}
