//! Projection of a Gaussian to an ellipse on the screen: EWA splatting as in the 3DGS paper (section 4), with the whole
//! covariance matrices written out. Surfels keep their axes in the view.

use super::linear::{Mat3, Vec3, covariance, matrix, normalize, product, sub, transform, transpose, vector};
use super::surfel::SurfelDisc;
use super::{Options, Real, sh};
use crate::layout::{COLOR_MAX, QUATERNION_MIN};
use crate::scene::{Camera, Primitive, Projection, ScreenFilter, Splats};

/// Floats of [`Splat::parameters`] before the SH coefficients.
pub const GEOMETRY_PARAMETERS: usize = 11;

/// Raw parameters of one splat, as stored and trained.
#[derive(Clone, Debug, PartialEq)]
pub struct Splat<R> {
    /// Mean, world units.
    pub mean: Vec3<R>,
    /// w, x, y, z; of any length.
    pub quaternion: [R; 4],
    /// Logarithm of the standard deviations.
    pub log_scale: Vec3<R>,
    /// Logit of the opacity.
    pub opacity_logit: R,
    /// `[coefficient][rgb]`.
    pub sh: Vec<Vec3<R>>,
}

impl<R: Real> Splat<R> {
    /// Splat `index` of a scene, as constants.
    pub fn of(splats: &Splats, index: usize) -> Splat<R> {
        let of = |x: f32| R::of(f64::from(x));
        let stride = splats.sh_stride();
        Splat {
            mean: splats.mean[index].map(of),
            quaternion: splats.quaternion[index].map(of),
            log_scale: splats.log_scale[index].map(of),
            opacity_logit: of(splats.opacity_logit[index]),
            sh: splats.sh[index * stride..][..stride]
                .chunks_exact(3)
                .map(|rgb| [of(rgb[0]), of(rgb[1]), of(rgb[2])])
                .collect(),
        }
    }

    /// All splats of a scene, as constants.
    pub fn all(splats: &Splats) -> Vec<Splat<R>> {
        (0..splats.len()).map(|i| Splat::of(splats, i)).collect()
    }

    /// Parameters in one row: mean, quaternion, log-scale, opacity logit, SH coefficients.
    pub fn parameters(&self) -> Vec<R> {
        let mut row = self.mean.to_vec();
        row.extend(self.quaternion);
        row.extend(self.log_scale);
        row.push(self.opacity_logit);
        row.extend(self.sh.iter().flatten());
        row
    }

    /// Inverse of [`Splat::parameters`].
    pub fn from_parameters(row: &[R]) -> Splat<R> {
        assert!(row.len() >= GEOMETRY_PARAMETERS, "{} parameters", row.len());
        Splat {
            mean: [row[0], row[1], row[2]],
            quaternion: [row[3], row[4], row[5], row[6]],
            log_scale: [row[7], row[8], row[9]],
            opacity_logit: row[10],
            sh: row[GEOMETRY_PARAMETERS..]
                .chunks_exact(3)
                .map(|rgb| [rgb[0], rgb[1], rgb[2]])
                .collect(),
        }
    }
}

/// Parameters of projection besides the splat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// The camera.
    pub camera: Camera,
    /// `x_min, x_max, y_min, y_max` of x/z and y/z inside the Jacobian.
    pub limit: [f64; 4],
    /// Near plane along z, world units.
    pub near: f64,
    /// Added to both variances on the screen, px².
    pub dilation: f64,
    /// Whether the opacity compensates the dilation (Mip-Splatting, section 5.2).
    pub compensated: bool,
    /// Highest SH degree used.
    pub sh_degree: u32,
    /// Kind of the splats.
    pub primitive: Primitive,
    /// Rays of the pixels.
    pub projection: Projection,
}

impl Viewpoint {
    /// View of a camera. The limits lie 15 % of the image beyond each border.
    pub fn new(camera: &Camera, options: &Options, filter: ScreenFilter) -> Viewpoint {
        let width = f64::from(camera.width);
        let height = f64::from(camera.height);
        let (focal, center) = (camera.focal, camera.center);
        Viewpoint {
            camera: *camera,
            limit: [
                -(0.15 * width + center.x) / focal.x,
                (1.15 * width - center.x) / focal.x,
                -(0.15 * height + center.y) / focal.y,
                (1.15 * height - center.y) / focal.y,
            ],
            near: options.near,
            dilation: match filter {
                ScreenFilter::Classic => 0.3,
                ScreenFilter::Mip => 0.1,
            },
            compensated: filter == ScreenFilter::Mip,
            sh_degree: options.sh_degree,
            primitive: Primitive::Gaussian3d,
            projection: Projection::Perspective,
        }
    }

    /// The same view of splats of a kind. Surfels are projected at their means, wherever these are, and without a
    /// dilation but that of the mip filter.
    #[must_use]
    pub fn drawing(mut self, primitive: Primitive) -> Viewpoint {
        self.primitive = primitive;
        if primitive == Primitive::Surfel {
            self.limit = [f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY];
            self.dilation = if self.compensated { 0.1 } else { 0.0 };
        }
        self
    }

    /// View of a camera on a scene.
    pub fn on(splats: &Splats, camera: &Camera, options: &Options) -> Viewpoint {
        Viewpoint::new(camera, options, splats.filter).drawing(splats.primitive)
    }
}

/// A projected splat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScreenSplat<R> {
    /// Mean, pixels.
    pub mean: [R; 2],
    /// Covariance xx, xy, yy, dilation included; px².
    pub covariance: [R; 3],
    /// Opacity, compensation included.
    pub opacity: R,
    /// Colour, not negative.
    pub color: Vec3<R>,
    /// z in the view, world units.
    pub depth: R,
    /// The surfel in the view, if it is one; its covariance on the screen is that of its first-order projection.
    pub disc: Option<SurfelDisc<R>>,
}

impl<R: Real> ScreenSplat<R> {
    /// All numbers in one row: mean, covariance, opacity, colour, depth. A surfel's disc is not among them.
    pub fn row(&self) -> [R; 10] {
        let (m, c, rgb) = (self.mean, self.covariance, self.color);
        [
            m[0],
            m[1],
            c[0],
            c[1],
            c[2],
            self.opacity,
            rgb[0],
            rgb[1],
            rgb[2],
            self.depth,
        ]
    }

    /// Inverse of [`ScreenSplat::row`] for 3D Gaussians.
    pub fn from_row(row: [R; 10]) -> ScreenSplat<R> {
        ScreenSplat {
            mean: [row[0], row[1]],
            covariance: [row[2], row[3], row[4]],
            opacity: row[5],
            color: [row[6], row[7], row[8]],
            depth: row[9],
            disc: None,
        }
    }
}

/// Projects a splat; `None` if it is in front of the near plane, without an orientation, or not finite.
pub fn project<R: Real>(splat: &Splat<R>, view: &Viewpoint) -> Option<ScreenSplat<R>> {
    let (rotation, position) = (matrix(view.camera.rotation), vector(view.camera.position));
    let length = splat.quaternion.iter().map(|q| q.value().powi(2)).sum::<f64>().sqrt();
    let from_camera = sub(splat.mean, position);
    let mean_view = transform(rotation, from_camera);
    let finite = splat.parameters().iter().all(|p| p.value().is_finite());
    if !(finite && mean_view[2].value() >= view.near && length > f64::from(QUATERNION_MIN)) {
        return None;
    }
    let [x, y, z] = mean_view;
    let focal = view.camera.focal.to_array().map(R::of);
    let center = view.camera.center.to_array().map(R::of);
    let spread = screen_covariance(splat, view, rotation, mean_view);
    let dilation = R::of(view.dilation);
    let dilated = [spread[0] + dilation, spread[1], spread[2] + dilation];
    let mut opacity = splat.opacity_logit.sigmoid();
    if view.compensated {
        opacity = opacity * compensation(spread, dilated);
    }
    let disc = (view.primitive == Primitive::Surfel).then(|| surfel_of(splat, mean_view, view));
    if disc.is_some_and(|disc| disc.is_edge_on && !disc.has_spot) {
        return None;
    }
    // The direction of a pixel's ray, and how much a world unit across it is in units of the focal lengths.
    let (direction, along) = match view.projection {
        Projection::Perspective => (normalize(from_camera), z),
        Projection::Orthographic => (rotation[2], R::of(1.0)),
    };
    let screen = ScreenSplat {
        mean: [focal[0] * x / along + center[0], focal[1] * y / along + center[1]],
        covariance: dilated,
        opacity,
        color: sh::unclamped_color(view.sh_degree, &splat.sh, direction)
            .map(|c| c.at_least(0.0).at_most(f64::from(COLOR_MAX))),
        depth: z,
        disc,
    };
    screen.row().iter().all(|x| x.value().is_finite()).then_some(screen)
}

/// The surfel of a splat with its mean in the view.
pub fn surfel_of<R: Real>(splat: &Splat<R>, mean_view: Vec3<R>, view: &Viewpoint) -> SurfelDisc<R> {
    let shape = (splat.quaternion, splat.log_scale);
    SurfelDisc::of(mean_view, shape, &view.camera, view.near, !view.compensated)
}

/// `J W Σ Wᵀ Jᵀ`, as xx, xy, yy. The Jacobian of a perspective projection is taken at x/z and y/z clamped to the
/// limits; the clamped quotients are constants, the remaining 1/z is not.
pub fn screen_covariance<R: Real>(
    splat: &Splat<R>,
    view: &Viewpoint,
    rotation: Mat3<R>,
    mean_view: Vec3<R>,
) -> Vec3<R> {
    let [x, y, z] = mean_view;
    let focal = view.camera.focal.to_array().map(R::of);
    let slope_x = (x / z).at_least(view.limit[0]).at_most(view.limit[1]);
    let slope_y = (y / z).at_least(view.limit[2]).at_most(view.limit[3]);
    let zero = R::of(0.0);
    let jacobian: Mat3<R> = match view.projection {
        Projection::Perspective => [
            [focal[0] / z, zero, -focal[0] * slope_x / z],
            [zero, focal[1] / z, -focal[1] * slope_y / z],
            [zero, zero, zero],
        ],
        Projection::Orthographic => [[focal[0], zero, zero], [zero, focal[1], zero], [zero, zero, zero]],
    };
    let screen_from_world = product(jacobian, rotation);
    let mut log_scale = splat.log_scale;
    if view.primitive == Primitive::Surfel {
        log_scale[2] = R::of(f64::NEG_INFINITY);
    }
    let world = covariance(splat.quaternion, log_scale);
    let screen = product(product(screen_from_world, world), transpose(screen_from_world));
    [screen[0][0], screen[0][1], screen[1][1]]
}

/// Determinant of a symmetric 2 × 2 matrix given as xx, xy, yy.
pub fn determinant<R: Real>([xx, xy, yy]: Vec3<R>) -> R {
    xx * yy - xy * xy
}

/// `√(det spread / det dilated)`: keeps a splat's integral unchanged by the dilation.
fn compensation<R: Real>(spread: Vec3<R>, dilated: Vec3<R>) -> R {
    let ratio = determinant(spread) / determinant(dilated);
    if ratio.value() > 0.0 { ratio.sqrt() } else { R::of(0.0) }
}

/// Distances of a splat's projection from its discontinuities, relative to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Margins {
    /// |z / near − 1|.
    pub near: f64,
    /// Distance of x/z and y/z to the nearest limit, over the width of the limits.
    pub limit: f64,
    /// Smallest magnitude of a colour channel before it is clamped at 0.
    pub color: f64,
}

/// [`Margins`] of a splat, which must lie in front of the camera.
pub fn margins(splat: &Splat<f64>, view: &Viewpoint) -> Margins {
    let from_camera = sub(splat.mean, vector(view.camera.position));
    let [x, y, z] = transform(matrix(view.camera.rotation), from_camera);
    let apart = |slope: f64, low: f64, high: f64| (slope - low).abs().min((slope - high).abs()) / (high - low);
    let [x_min, x_max, y_min, y_max] = view.limit;
    let color = sh::unclamped_color(view.sh_degree, &splat.sh, normalize(from_camera));
    Margins {
        near: (z / view.near - 1.0).abs(),
        limit: apart(x / z, x_min, x_max).min(apart(y / z, y_min, y_max)),
        color: color.iter().fold(f64::INFINITY, |m, c| m.min(c.abs())),
    }
}
