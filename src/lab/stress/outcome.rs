//! Results of the stability suite: every check with its bound and measurement, the sweeps behind them, and JSON.

use crate::lab::page::{Fact, short_number};
use serde::Serialize;

pub use super::thumbnail::Thumbnail;

/// Groups of checks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum CheckGroup {
    /// Basic operations of the device.
    #[default]
    Device,
    /// Degenerate scenes and cameras.
    Scenes,
    /// NaN, infinities and extreme values in every parameter.
    Poison,
    /// Images of all sizes.
    Sizes,
    /// One parameter varied over its range.
    Sweeps,
    /// Gradients of training steps.
    Gradients,
    /// Repetition, compared to the bit.
    Determinism,
}

impl CheckGroup {
    /// All, in the order of the page.
    pub const ALL: [CheckGroup; 7] = [
        CheckGroup::Device,
        CheckGroup::Scenes,
        CheckGroup::Poison,
        CheckGroup::Sizes,
        CheckGroup::Sweeps,
        CheckGroup::Gradients,
        CheckGroup::Determinism,
    ];

    /// Heading on the page.
    pub fn title(self) -> &'static str {
        match self {
            CheckGroup::Device => "The device's own tests",
            CheckGroup::Scenes => "Degenerate scenes and cameras",
            CheckGroup::Poison => "Poisoned parameters",
            CheckGroup::Sizes => "Sizes of images",
            CheckGroup::Sweeps => "Sweeps",
            CheckGroup::Gradients => "Gradients",
            CheckGroup::Determinism => "Determinism",
        }
    }
}

/// Direction of a bound.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Sense {
    /// Upper bound.
    #[default]
    AtMost,
    /// Lower bound.
    AtLeast,
}

/// A check with its bound and measurement.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StressCheck {
    /// Its group.
    pub group: CheckGroup,
    /// Subject, in a few words.
    pub name: String,
    /// Method and origin of the bound, in a sentence.
    pub what: String,
    /// Measured value; NaN (null in JSON) if the result holds a NaN.
    pub measured: f64,
    /// Bound of the measured value.
    pub bound: f64,
    /// Direction of the bound.
    pub sense: Sense,
    /// Unit of both.
    pub unit: &'static str,
    /// True if the bound is kept.
    pub passed: bool,
}

impl StressCheck {
    /// StressCheck of an upper bound; NaN breaks it.
    pub fn at_most(
        group: CheckGroup,
        name: impl Into<String>,
        what: impl Into<String>,
        [measured, bound]: [f64; 2],
        unit: &'static str,
    ) -> StressCheck {
        StressCheck {
            group,
            name: name.into(),
            what: what.into(),
            measured,
            bound,
            sense: Sense::AtMost,
            unit,
            passed: measured <= bound,
        }
    }

    /// StressCheck of a lower bound; NaN breaks it.
    pub fn at_least(
        group: CheckGroup,
        name: impl Into<String>,
        what: impl Into<String>,
        [measured, bound]: [f64; 2],
        unit: &'static str,
    ) -> StressCheck {
        StressCheck {
            sense: Sense::AtLeast,
            passed: measured >= bound,
            ..StressCheck::at_most(group, name, what, [measured, bound], unit)
        }
    }
}

/// One value of a sweep's parameter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SweepPoint {
    /// The parameter.
    pub x: f64,
    /// Measured value.
    pub measured: f64,
    /// Upper bound.
    pub bound: f64,
}

impl SweepPoint {
    /// True if the bound is kept; NaN breaks it.
    pub fn holds(&self) -> bool {
        self.measured <= self.bound
    }

    /// Share of the bound; NaN, with its sign cleared, is the greatest of all.
    pub(super) fn share(&self) -> f64 {
        (self.measured / self.bound).abs()
    }
}

/// A parameter varied over its range.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Sweep {
    /// Its group.
    pub group: CheckGroup,
    /// Heading on the page.
    pub title: &'static str,
    /// Title of the horizontal axis, with its unit.
    pub parameter: &'static str,
    /// Logarithmic horizontal axis.
    pub is_log: bool,
    /// Title of the vertical axis, with its unit; always logarithmic.
    pub quantity: &'static str,
    /// Explanation of the figure.
    pub caption: &'static str,
    /// Curve, by ascending parameter; empty for pictures alone.
    pub points: Vec<SweepPoint>,
    /// Pictures of some points.
    #[serde(skip)]
    pub thumbnails: Vec<Thumbnail>,
}

impl Sweep {
    /// The point closest to its bound, or farthest beyond it.
    pub fn closest(&self) -> Option<SweepPoint> {
        let points = self.points.iter().copied();
        // The first of equal ones.
        points.min_by(|a, b| b.share().total_cmp(&a.share()))
    }

    /// Check of the point closest to its bound.
    pub fn outcome(&self, unit: &'static str) -> StressCheck {
        let (pair, at) = match self.closest() {
            Some(p) => (
                [p.measured, p.bound],
                format!("closest to its bound at {}", short_number(p.x)),
            ),
            None => ([f64::NAN; 2], "nothing was measured".into()),
        };
        let count = self.points.len();
        let what = format!("{count} values; {at}");
        StressCheck {
            passed: count > 0 && self.points.iter().all(SweepPoint::holds),
            ..StressCheck::at_most(self.group, self.title, what, pair, unit)
        }
    }
}

/// Results of the suite.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct StressReport {
    /// Device, scene, date and version.
    pub facts: Vec<Fact>,
    /// The checks.
    pub outcomes: Vec<StressCheck>,
    /// The sweeps.
    pub sweeps: Vec<Sweep>,
}

impl StressReport {
    /// The checks that failed.
    pub fn failed(&self) -> Vec<&StressCheck> {
        self.outcomes.iter().filter(|o| !o.passed).collect()
    }

    /// JSON of everything but the pictures.
    ///
    /// # Errors
    /// Those of serialising; none for these types.
    pub fn json(&self) -> serde_json::Result<String> {
        #[derive(Serialize)]
        struct StressJson<'a> {
            passed: bool,
            facts: serde_json::Map<String, serde_json::Value>,
            outcomes: &'a [StressCheck],
            sweeps: &'a [Sweep],
        }
        let facts = self.facts.iter().cloned();
        serde_json::to_string_pretty(&StressJson {
            passed: self.failed().is_empty(),
            facts: facts.map(|(name, value)| (name, value.into())).collect(),
            outcomes: &self.outcomes,
            sweeps: &self.sweeps,
        })
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn sweep(points: &[[f64; 3]]) -> Sweep {
        let point = |&[x, measured, bound]: &[f64; 3]| SweepPoint { x, measured, bound };
        Sweep {
            group: CheckGroup::Sweeps,
            title: "needles",
            parameter: "aspect",
            is_log: true,
            quantity: "error, of the colour range",
            caption: "thin & thinner",
            points: points.iter().map(point).collect(),
            thumbnails: vec![Thumbnail::new("1", [2, 1], &[[0.0; 3], [1.0; 3]])],
        }
    }

    #[test]
    fn a_sweep_is_judged_by_every_point() {
        let fine = sweep(&[[1.0, 1e-6, 1e-4], [10.0, 9e-5, 1e-4], [100.0, 0.0, 1e-4]]);
        let outcome = fine.outcome("of 1");
        assert!(outcome.passed && outcome.measured == 9e-5);
        let broken = sweep(&[[1.0, 1e-6, 1e-4], [10.0, 2e-4, 1e-4], [100.0, 1.0, 2.0]]);
        assert!(!broken.outcome("of 1").passed);
        assert_eq!(broken.outcome("of 1").measured, 2e-4);
        let none = sweep(&[[1.0, 1e-6, 1e-4], [10.0, f64::NAN, 1e-4], [1e2, 1.0, 2.0]]);
        assert!(!none.outcome("of 1").passed && none.outcome("of 1").measured.is_nan());
        assert!(!sweep(&[]).outcome("of 1").passed, "nothing measured is no success");
    }

    #[test]
    fn json_has_the_failed_checks() -> serde_json::Result<()> {
        let stress = StressReport {
            facts: vec![("device".into(), "a device".into())],
            outcomes: vec![
                StressCheck::at_most(CheckGroup::Device, "atomics", "…", [0.0, 0.0], "wrong counts"),
                StressCheck::at_least(CheckGroup::Device, "loops", "…", [65_535.0, 1e6], "turns"),
                StressCheck::at_most(CheckGroup::Sizes, "1 × 1", "…", [f64::NAN, 1.0], "of 1"),
            ],
            sweeps: vec![sweep(&[[1.0, 1e-6, 1e-4]])],
        };
        assert_eq!(stress.failed().len(), 2);
        let value: serde_json::Value = serde_json::from_str(&stress.json()?)?;
        assert_eq!(value["passed"], false);
        assert_eq!(value["facts"]["device"], "a device");
        assert_eq!(value["outcomes"][1]["sense"], "at_least");
        assert_eq!(value["outcomes"][2]["measured"], serde_json::Value::Null);
        assert_eq!(value["sweeps"][0]["points"][0]["bound"], 1e-4);
        Ok(())
    }
}
