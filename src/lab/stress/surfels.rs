//! Sweeps of surfels: edge-on, thin, through the camera and behind it, far from the origin.

use super::sweeps::sweep_pictures;
use super::{StressRun, subject};
use crate::Result;
use crate::reference::frame::{center, project_all, sorted};
use crate::reference::linear::{dot, normalize};
use crate::reference::rasterize::{discontinuity_margin, rasterize, weights};
use crate::reference::sample::spread;
use crate::reference::{Options, ScreenSplat, Splat, Viewpoint};
use crate::render::{Model, RenderOptions, RenderedImage, Renderer, ViewOptions};
use crate::scene::{Camera, Primitive, SH_C0, Splats};
use glam::{DMat3, DQuat, DVec2, DVec3};

/// Half a unit in the last place of 1 in single precision.
const U: f64 = 1.0 / 16_777_216.0;

/// Near plane, world units.
const NEAR: f32 = 1.0 / 1024.0;

/// A camera at the origin along z.
fn camera() -> Camera {
    Camera {
        width: 80,
        height: 60,
        focal: DVec2::new(72.0, 66.0),
        center: DVec2::new(38.0, 31.0),
        rotation: DMat3::IDENTITY,
        position: DVec3::ZERO,
    }
}

/// An opaque surfel and a fainter one before it, of a camera at `origin`.
fn pair(origin: DVec3, mean: DVec3, normal: DVec3, scales: [f64; 2]) -> Splats {
    let mut splats = Splats {
        primitive: Primitive::Surfel,
        ..Splats::default()
    };
    let shapes = [
        (mean, normal, 6.0, [0.9, 0.6, 0.2]),
        (
            0.9 * mean,
            -DVec3::new(normal.y, normal.x, normal.z),
            0.5,
            [0.2, 0.5, 0.9],
        ),
    ];
    for (mean, normal, logit, color) in shapes {
        let q = DQuat::from_rotation_arc(DVec3::Z, normal.normalize());
        splats.mean.push((origin + mean).as_vec3().to_array());
        splats.quaternion.push([q.w, q.x, q.y, q.z].map(|x| x as f32));
        splats
            .log_scale
            .push([scales[0].ln() as f32, scales[1].ln() as f32, 0.0]);
        splats.opacity_logit.push(logit);
        splats.sh.extend(color.map(|c: f32| (c - 0.5) / SH_C0));
    }
    splats.set_thickness();
    splats
}

/// Bound of a surfel's error at a position in a picture, of its share: the rounding of its mean on the screen over its
/// width, and of its plane's distance over the cosine of normal and line of sight.
fn bound(splat: &ScreenSplat<f64>, at: [f64; 2], focal: f64) -> f64 {
    let Some(disc) = &splat.disc else { return 0.0 };
    let sight = normalize(disc.mean);
    let cosine = dot(disc.normal, sight).abs().max(1e-3);
    let [xx, xy, yy] = splat.covariance;
    // Of the spot at least, where the ellipse is thinner and no pixel's hit counts.
    let smallest = (0.5 * (xx + yy) - (0.5 * (xx - yy)).hypot(xy)).max(1e-6).sqrt();
    let [dx, dy] = [0, 1].map(|i| at[i] - splat.mean[i]);
    let reach = 1.0 / sight[2];
    let place = 16.0 * U * focal * reach * reach + 8.0 * U * dx.hypot(dy);
    3e-6 / cosine + 0.61 * place / smallest
}

/// The surfels of the reference: as much more opaque as those of the subject's, that is, not at all but in tests.
fn exact(lab: &StressRun<'_>, mut splats: Splats) -> Splats {
    let of = |splats: &Splats| splats.opacity_logit.first().copied().unwrap_or(0.0);
    let more = of(&lab.subject.exact) - of(&lab.subject.splats);
    splats.opacity_logit.iter_mut().for_each(|logit| *logit += more);
    splats
}

/// Error and bound of the pixel closest to its bound; NaN anywhere in the picture is beyond all.
fn compare(image: &RenderedImage, splats: &Splats, camera: &Camera, pixels: usize) -> [f64; 2] {
    if !image.rgb.as_flattened().iter().all(|value| value.is_finite()) {
        return [f64::NAN, f64::MIN_POSITIVE];
    }
    let options = Options {
        near: NEAR.into(),
        ..Options::default()
    };
    let view = Viewpoint::on(splats, camera, &options);
    let (list, _) = sorted(&project_all(&Splat::<f64>::all(splats), &view));
    let order: Vec<usize> = (0..list.len()).collect();
    let mut worst = [0.0, f64::MIN_POSITIVE];
    for i in spread(camera.width, camera.height, pixels) {
        let at = center(i, camera.width as usize);
        let thresholds = &options.thresholds;
        let drawn = weights(&list, &order, at, thresholds).into_iter();
        let allowed = 5e-6 + drawn.map(|(k, _)| bound(&list[k], at, camera.focal.x)).sum::<f64>();
        // Beside the least alpha a pixel may have the splat or not.
        if discontinuity_margin(&list, &order, at, thresholds).nearest() < 2.0 * allowed {
            continue;
        }
        let expected = rasterize(&list, &order, at, options.background, thresholds);
        let colors = image.rgb[i].iter().zip(expected.color);
        let errors = colors.map(|(found, exact)| (f64::from(*found) - exact).abs());
        let passed = (f64::from(image.transmittance[i]) - expected.transmittance).abs();
        let error = errors.fold(passed, f64::max);
        if error / allowed >= worst[0] / worst[1] {
            worst = [error, allowed];
        }
    }
    worst
}

/// Draws with a renderer of surfels.
struct SurfelStage {
    renderer: Renderer,
}

impl SurfelStage {
    fn draw(&mut self, lab: &StressRun<'_>, splats: &Splats, camera: &Camera) -> Result<RenderedImage> {
        let options = ViewOptions {
            background: [0.0; 3],
            near: NEAR,
            filter: splats.filter,
        };
        self.renderer.render(&Model::upload(lab.gpu, splats)?, camera, &options)
    }

    /// Compares the picture at every value of a parameter with the reference. The texts are title, parameter and
    /// caption.
    fn sweep(
        &mut self,
        lab: &mut StressRun<'_>,
        [title, parameter, caption]: [&'static str; 3],
        values: &[f64],
        scene: impl Fn(f64) -> (Splats, Camera),
    ) -> Result<()> {
        let texts = [title, parameter, "", caption];
        sweep_pictures(lab, texts, values.iter().copied(), |lab, x| {
            let (splats, camera) = scene(x);
            let image = self.draw(lab, &splats, &camera)?;
            let errors = compare(&image, &exact(lab, splats), &camera, lab.plan.pixels);
            Ok((image, errors))
        })
    }
}

pub(super) fn run(lab: &mut StressRun<'_>) -> Result<()> {
    let options = RenderOptions {
        primitive: Primitive::Surfel,
        ..RenderOptions::default()
    };
    let mut stage = SurfelStage {
        renderer: Renderer::new(lab.gpu, options)?,
    };
    let mean = DVec3::new(0.02, -0.03, 2.0);
    let texts = [
        "Surfels edge-on",
        "cosine of normal and line of sight",
        "Their ellipse becomes a line, and the hits in their plane move fast from pixel to pixel. Below 0.001 a surfel is \
         a spot.",
    ];
    let cosines = [1e-6, 1e-5, 5e-4, 2e-3, 0.01, 0.03, 0.1, 0.3, 1.0];
    stage.sweep(lab, texts, &cosines, |cosine| {
        let across = mean.any_orthonormal_vector();
        let normal = across * (1.0 - cosine * cosine).sqrt() - mean.normalize() * cosine;
        (pair(DVec3::ZERO, mean, normal, [0.4, 0.1]), camera())
    })?;
    let texts = [
        "Thin surfels",
        "axes stretched apart by a factor of",
        "From discs to needles, longer than their distance and thinner than a pixel.",
    ];
    let aspects = [1.0, 10.0, 100.0, 1e3, 1e4];
    stage.sweep(lab, texts, &aspects, |aspect| {
        let normal = DVec3::new(0.4, -0.3, 1.0);
        (
            pair(DVec3::ZERO, mean, normal, [0.2 * aspect.sqrt(), 0.2 / aspect.sqrt()]),
            camera(),
        )
    })?;
    let texts = [
        "Surfels through the camera",
        "distance of the mean, of the surfel's standard deviation",
        "Part of the disc is behind the camera; its outline on the screen is no ellipse there.",
    ];
    let distances = [0.03, 0.1, 0.3, 1.0, 3.0, 10.0];
    stage.sweep(lab, texts, &distances, |distance| {
        let mean = DVec3::new(0.05, 0.1, 1.0) * distance;
        (pair(DVec3::ZERO, mean, DVec3::new(0.3, 0.8, 0.6), [1.0, 1.0]), camera())
    })?;
    let texts = [
        "Surfels far from the origin",
        "distance of scene and camera from the origin, of that between them",
        "Positions snap to coarser steps; what is stored is drawn as exactly as ever.",
    ];
    let factors = [1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6];
    stage.sweep(lab, texts, &factors, |factor| {
        let by = DVec3::new(0.8, -0.5, 0.33) * (2.0 * factor);
        let moved = Camera {
            position: by,
            ..camera()
        };
        let splats = pair(by, mean, DVec3::new(0.4, -0.3, 1.0), [0.4, 0.2]);
        (splats, subject::exact(&moved))
    })?;
    let splats = pair(DVec3::ZERO, -mean, DVec3::new(0.4, -0.3, 1.0), [0.4, 0.2]);
    let image = stage.draw(lab, &splats, &camera())?;
    let shown = image.transmittance.iter().filter(|&&passes| passes != 1.0).count();
    lab.none(
        "Surfels behind the camera",
        "Pixels that show one whose mean is behind the camera: none.",
        shown,
        "pixels",
    );
    Ok(())
}
