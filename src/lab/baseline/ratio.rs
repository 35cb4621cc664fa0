//! How much faster one is than another.

use crate::lab::bench::session::Times;
use crate::stats::Summary;
use serde::Serialize;

/// A comparison of two that were measured in turns.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Ratio {
    /// What is compared: `forward`, `backward`, `sort`.
    pub what: String,
    /// The engine's choice.
    pub ours: String,
    /// What it is held against.
    pub baseline: String,
    /// The baseline's time over ours, the median of the rounds' ratios.
    pub ratio: f64,
    /// The 95 % interval of that median.
    pub interval: [f64; 2],
    /// Which time: `processor` (of all threads, where the device is a processor) or `device`.
    pub by: &'static str,
    /// What the ratio should be at least.
    pub demanded: Option<f64>,
    /// Whether it is.
    pub met: Option<bool>,
}

impl Ratio {
    /// The ratio of rounds in which both ran once, by the processor's time or by that of the clock.
    pub fn of(
        what: &str,
        [ours, baseline]: [(&str, &[Times]); 2],
        by_processor: bool,
        demanded: Option<f64>,
    ) -> Ratio {
        let time = |times: &Times| {
            let clock = || times.stages.iter().map(|(_, ns)| ns).sum::<f64>();
            match times.cpu_ns {
                Some(ns) if by_processor => ns,
                _ => clock(),
            }
        };
        let rounds = ours.1.iter().zip(baseline.1);
        let ratios: Vec<f64> = rounds
            .map(|(ours, baseline)| time(baseline) / time(ours))
            .collect();
        let summary = Summary::of(&ratios);
        Ratio {
            what: what.into(),
            ours: ours.0.into(),
            baseline: baseline.0.into(),
            ratio: summary.median,
            interval: summary.interval,
            by: if by_processor { "processor" } else { "device" },
            demanded,
            met: demanded.map(|demanded| summary.median >= demanded),
        }
    }

    /// A line for people.
    pub fn line(&self) -> String {
        let [low, high] = self.interval;
        let verdict = match (self.demanded, self.met) {
            (Some(demanded), Some(true)) => format!("; at least {demanded:.2} demanded: met"),
            (Some(demanded), _) => format!("; at least {demanded:.2} demanded: short of it"),
            _ => String::new(),
        };
        format!(
            "{:<9} {:.2} × {} ({low:.2} to {high:.2}, {} time, {}){verdict}",
            self.what, self.ratio, self.baseline, self.by, self.ours
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratios_are_taken_round_by_round() {
        let times = |list: [f64; 3]| -> Vec<Times> {
            let run = |ns| Times {
                stages: vec![("run", ns)],
                cpu_ns: Some(2.0 * ns),
            };
            list.map(run).into()
        };
        // The machine is half as fast in the second round: for both.
        let (ours, baseline) = (times([1.0, 2.0, 1.0]), times([6.0, 12.0, 7.0]));
        let pair = [("a", ours.as_slice()), ("b", baseline.as_slice())];
        let ratio = Ratio::of("forward", pair, true, Some(6.5));
        assert_eq!((ratio.ratio, ratio.met), (6.0, Some(false)));
        assert!(ratio.line().contains("6.00 × b"), "{}", ratio.line());
        assert_eq!(Ratio::of("forward", pair, false, None).met, None);
    }
}
