//! What the stability suite has found on a device: every check with its bound and what was measured, and the sweeps
//! behind them.
//!
//! Outcomes come from [`stress`](crate::lab::stress); here they are judged ([`Stress::failed`]) and written, as one page
//! that needs no other file ([`page`]) and as JSON ([`Stress::json`]).

use serde::Serialize;

pub use super::still::Still;

/// What belongs together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Group {
    /// What the device does with the basic operations.
    Device,
    /// Scenes and cameras at the edge of sense.
    Scenes,
    /// Numbers that are none, or hardly, in every parameter.
    Poison,
    /// Images of all sizes.
    Sizes,
    /// One parameter varied over its range.
    Sweeps,
    /// Gradients of training steps.
    Gradients,
    /// The same again, to the bit.
    Determinism,
}

impl Group {
    /// All, in the order of the page.
    pub const ALL: [Group; 7] = [
        Group::Device,
        Group::Scenes,
        Group::Poison,
        Group::Sizes,
        Group::Sweeps,
        Group::Gradients,
        Group::Determinism,
    ];

    /// As a heading.
    pub fn title(self) -> &'static str {
        match self {
            Group::Device => "The device's own tests",
            Group::Scenes => "Degenerate scenes and cameras",
            Group::Poison => "Poisoned parameters",
            Group::Sizes => "Sizes of images",
            Group::Sweeps => "Sweeps",
            Group::Gradients => "Gradients",
            Group::Determinism => "Determinism",
        }
    }
}

/// How measured and bound are to be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Sense {
    /// No more than the bound.
    #[default]
    AtMost,
    /// No less.
    AtLeast,
}

/// A check, and how it went.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Outcome {
    /// Where it belongs.
    pub group: Group,
    /// What is tried, in a few words.
    pub name: String,
    /// What was done and what the bound is, in a sentence.
    pub what: String,
    /// What was found; NaN (null in JSON) if a number came out that is none.
    pub measured: f64,
    /// What it must not exceed, or not fall below.
    pub bound: f64,
    /// Which of both.
    pub sense: Sense,
    /// Of both numbers.
    pub unit: &'static str,
    /// Whether it keeps its bound.
    pub passed: bool,
}

impl Outcome {
    /// Something that must not exceed its bound. What is no number does.
    pub fn at_most(
        group: Group,
        name: impl Into<String>,
        what: impl Into<String>,
        [measured, bound]: [f64; 2],
        unit: &'static str,
    ) -> Outcome {
        Outcome {
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

    /// Something that must not fall below its bound.
    pub fn at_least(
        group: Group,
        name: impl Into<String>,
        what: impl Into<String>,
        [measured, bound]: [f64; 2],
        unit: &'static str,
    ) -> Outcome {
        Outcome {
            sense: Sense::AtLeast,
            passed: measured >= bound,
            ..Outcome::at_most(group, name, what, [measured, bound], unit)
        }
    }
}

/// One value of a sweep's parameter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Point {
    /// The parameter.
    pub x: f64,
    /// What was found there.
    pub measured: f64,
    /// What it must not exceed.
    pub bound: f64,
}

impl Point {
    /// What is no number keeps no bound.
    pub fn holds(&self) -> bool {
        self.measured <= self.bound
    }
}

/// A parameter varied over its range.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sweep {
    /// Where it belongs.
    pub group: Group,
    /// What is varied.
    pub title: String,
    /// What the horizontal axis shows, with its unit.
    pub parameter: &'static str,
    /// Whether that axis is logarithmic.
    pub is_log: bool,
    /// What the vertical axis shows, with its unit; always logarithmic.
    pub quantity: &'static str,
    /// What to see in it.
    pub caption: String,
    /// The curve, by ascending parameter; empty where there are only pictures.
    pub points: Vec<Point>,
    /// Pictures on the way.
    #[serde(skip)]
    pub stills: Vec<Still>,
}

impl Sweep {
    /// The point that comes closest to its bound, or lies farthest beyond it.
    pub fn closest(&self) -> Option<Point> {
        let mut points = self.points.iter().copied();
        let first = points.next()?;
        Some(points.fold(first, |worst, point| {
            let share = |p: &Point| p.measured / p.bound;
            let is_worse = share(&point) > share(&worst) || share(&point).is_nan();
            if is_worse && !share(&worst).is_nan() {
                point
            } else {
                worst
            }
        }))
    }

    /// Its point closest to the bound as a check.
    pub fn outcome(&self, unit: &'static str) -> Outcome {
        let at = |p: &Point| format!("closest to its bound at {}", super::page::short(p.x));
        let (pair, at) = match self.closest() {
            Some(p) => ([p.measured, p.bound], at(&p)),
            None => ([f64::NAN; 2], "nothing was measured".into()),
        };
        let count = self.points.len();
        let what = format!("{count} values; {at}");
        Outcome {
            passed: count > 0 && self.points.iter().all(Point::holds),
            ..Outcome::at_most(self.group, self.title.clone(), what, pair, unit)
        }
    }
}

/// All that was found.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Stress {
    /// On what, when and with which version: name and value.
    pub facts: Vec<(String, String)>,
    /// The checks.
    pub outcomes: Vec<Outcome>,
    /// The sweeps.
    pub sweeps: Vec<Sweep>,
}

impl Stress {
    /// The checks that failed.
    pub fn failed(&self) -> Vec<&Outcome> {
        self.outcomes.iter().filter(|o| !o.passed).collect()
    }

    /// All but the pictures, for machines.
    ///
    /// # Errors
    /// Those of serialising; there are none of these types.
    pub fn json(&self) -> serde_json::Result<String> {
        #[derive(Serialize)]
        struct Whole<'a> {
            passed: bool,
            facts: serde_json::Map<String, serde_json::Value>,
            outcomes: &'a [Outcome],
            sweeps: &'a [Sweep],
        }
        let facts = self.facts.iter().cloned();
        serde_json::to_string_pretty(&Whole {
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
        let point = |&[x, measured, bound]: &[f64; 3]| Point { x, measured, bound };
        Sweep {
            group: Group::Sweeps,
            title: "needles".into(),
            parameter: "aspect",
            is_log: true,
            quantity: "error, of the colour range",
            caption: "thin & thinner".into(),
            points: points.iter().map(point).collect(),
            stills: vec![Still::new("1", [2, 1], &[[0.0; 3], [1.0; 3]])],
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
        assert!(
            !sweep(&[]).outcome("of 1").passed,
            "nothing measured is no success"
        );
    }

    #[test]
    fn what_machines_read_says_what_failed() -> serde_json::Result<()> {
        let stress = Stress {
            facts: vec![("device".into(), "a device".into())],
            outcomes: vec![
                Outcome::at_most(Group::Device, "atomics", "…", [0.0, 0.0], "wrong counts"),
                Outcome::at_least(Group::Device, "loops", "…", [65_535.0, 1e6], "turns"),
                Outcome::at_most(Group::Sizes, "1 × 1", "…", [f64::NAN, 1.0], "of 1"),
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
