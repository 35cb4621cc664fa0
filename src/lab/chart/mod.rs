//! Chart of speed against accuracy: measurements, their proven bounds, and the bounds that are broken.
//!
//! [`mod@measure`] measures the points; here they are checked ([`Chart::broken`]), compared ([`pareto`]) and written,
//! as one page with figures ([`page`]) and as the CSV behind it ([`csv`]).

pub mod csv;
pub mod measure;
pub mod page;
mod panels;
pub mod pareto;
mod tables;

use crate::lab::page::Fact;
use crate::stats::Interval;

/// All points of the page.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chart {
    /// Scene, device, date and version.
    pub facts: Vec<Fact>,
    /// Frames.
    pub frames: Vec<FramePoint>,
    /// Errors of linear projection, common to all frames and the reference, against perspective along rays.
    pub projection: Option<FrameErrors>,
    /// Training steps.
    pub gradients: Vec<GradientPoint>,
    /// Training runs.
    pub runs: Vec<RunPoint>,
    /// Geometry of trained scenes.
    pub geometry: Vec<GeometryPoint>,
}

/// Knob and setting of a point.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Knob {
    /// Name of the knob: `stop alone`.
    pub series: String,
    /// Its value: `1e-3`.
    pub setting: String,
    /// True for the engine's default.
    pub is_default: bool,
}

impl Knob {
    /// A setting that is not the default.
    pub fn new(series: &str, setting: impl Into<String>) -> Knob {
        Knob {
            series: series.into(),
            setting: setting.into(),
            is_default: false,
        }
    }

    /// `stop alone 1e-3`.
    pub fn name(&self) -> String {
        format!("{} {}", self.series, self.setting)
    }
}

/// Errors of a frame in units of colour, 1 being the brightest that a photograph holds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameErrors {
    /// Largest error of any pixel's channel.
    pub max: f64,
    /// 99th percentile of the pixels' largest errors.
    pub p99: f64,
    /// Peak signal-to-noise ratio, decibels.
    pub psnr_db: f64,
}

/// Relative errors of gradients: of the exact value, or of 1 % of its kind's root mean square if that is more.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GradientErrors {
    /// Median over the parameters.
    pub median: f64,
    /// 99th percentile.
    pub p99: f64,
}

/// Frames or training steps with one setting, against the `f64` reference without any cut.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AccuracyPoint<E> {
    /// Setting.
    pub knob: Knob,
    /// Median time of a frame or step on the device, milliseconds, with the median's 95 % interval.
    pub time_ms: Interval,
    /// Median processor time of the same, milliseconds; on a software device that is the work itself.
    pub cpu_ms: f64,
    /// Bytes that the scene takes on the device; 0 for training steps.
    pub scene_bytes: usize,
    /// Measured errors.
    pub error: E,
    /// Proven bounds, without rounding: the same figures of the pixels' or parameters' own bounds.
    pub bound: E,
    /// Largest error that rounding to `f32` may add to a pixel; 0 for training steps.
    pub rounding: f64,
    /// Largest distance of a pixel beyond its bound and rounding, or of a gradient, relative to it; positive if a bound
    /// is broken.
    pub excess: f64,
}

/// Frames.
pub type FramePoint = AccuracyPoint<FrameErrors>;

/// Training steps.
pub type GradientPoint = AccuracyPoint<GradientErrors>;

impl<E> AccuracyPoint<E> {
    /// True if all bounds are kept; NaN breaks them.
    pub fn holds(&self) -> bool {
        self.excess <= 0.0
    }
}

/// Training runs with one setting and several seeds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RunPoint {
    /// Setting.
    pub knob: Knob,
    /// Mean PSNR of the held-out views, decibels (float values).
    pub psnr_db: Interval,
    /// Difference to the default's, paired by seed, decibels.
    pub gain_db: Interval,
    /// Their mean SSIM.
    pub ssim: Interval,
    /// Wall time of the training steps, seconds; loading and evaluation excluded.
    pub seconds: Interval,
    /// Splats of the result.
    pub splats: Interval,
    /// Megabytes (10⁶ bytes) that its parameters take as `f32`.
    pub megabytes: Interval,
    /// PSNR of the held-out views over time: seconds of training, decibels.
    pub course: Vec<(f64, Interval)>,
}

/// Geometry of runs with one recipe and several seeds, by one kind of depth.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GeometryPoint {
    /// Recipe and depth.
    pub knob: Knob,
    /// Wall time of the training steps, seconds.
    pub seconds: Interval,
    /// Splats of the result.
    pub splats: Interval,
    /// Mean PSNR of the held-out views, decibels.
    pub psnr_db: Interval,
    /// Chamfer distance of the fused mesh, pixels' footprints.
    pub chamfer: Interval,
    /// Median error of depth in held-out views, relative to the depth.
    pub depth: Interval,
    /// Mean angle between normals in held-out views, degrees.
    pub normal: Interval,
}

impl Chart {
    /// Number of points with a bound.
    pub fn bounded(&self) -> usize {
        self.frames.len() + self.gradients.len()
    }

    /// A sentence for every point that breaks its bound.
    pub fn broken(&self) -> Vec<String> {
        let frames = self.frames.iter().filter(|point| !point.holds());
        let frames = frames.map(|point| {
            let (name, excess, rounding) = (point.knob.name(), point.excess, point.rounding);
            format!(
                "{name}: a pixel lies {excess:.2e} beyond its proven bound (largest error {:.2e}, largest bound \
                 {:.2e}, rounding {rounding:.2e})",
                point.error.max, point.bound.max
            )
        });
        let gradients = self.gradients.iter().filter(|point| !point.holds());
        let gradients = gradients.map(|point| {
            let (name, excess) = (point.knob.name(), point.excess);
            format!(
                "{name}: a gradient lies {excess:.2e} of its size beyond its proven bound (99 % of errors up to \
                 {:.2e}, of bounds up to {:.2e})",
                point.error.p99, point.bound.p99
            )
        });
        frames.chain(gradients).collect()
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn frame(setting: &str, excess: f64) -> FramePoint {
        FramePoint {
            knob: Knob::new("stop alone", setting),
            time_ms: Interval::new(2.0, 1.5, 2.5, 9),
            error: FrameErrors {
                max: 2e-3,
                p99: 1e-3,
                psnr_db: 60.0,
            },
            bound: FrameErrors {
                max: 3e-3,
                p99: 2e-3,
                psnr_db: 50.0,
            },
            rounding: 1e-4,
            excess,
            ..FramePoint::default()
        }
    }

    #[test]
    fn a_point_beyond_its_bound_is_named() {
        let chart = Chart {
            frames: vec![frame("1e-4", -1e-3), frame("1e-2", 5e-4), frame("1", f64::NAN)],
            gradients: vec![
                GradientPoint::default(),
                GradientPoint {
                    excess: 0.5,
                    ..GradientPoint::default()
                },
            ],
            ..Chart::default()
        };
        let broken = chart.broken();
        assert_eq!((broken.len(), chart.bounded()), (3, 5));
        assert!(
            broken[0].starts_with("stop alone 1e-2: a pixel lies 5.00e-4 beyond"),
            "{}",
            broken[0]
        );
        assert!(broken[1].contains("NaN"), "{}", broken[1]);
        assert!(broken[2].contains("gradient lies 5.00e-1"), "{}", broken[2]);
    }
}
