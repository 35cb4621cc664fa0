//! Speed ratio of two implementations.

use crate::lab::bench::session::Times;
use crate::stats::Summary;
use serde::Serialize;

/// Ratio of two times measured in turns.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Ratio {
    /// Task: `forward`, `backward`, `sort`.
    pub what: String,
    /// Name of the engine's choice.
    pub ours: String,
    /// Name of the baseline.
    pub baseline: String,
    /// The baseline's time over ours, the median of the rounds' ratios.
    pub ratio: f64,
    /// The 95 % interval of that median.
    pub interval: [f64; 2],
    /// Clock: `processor` (all threads, on a software device) or `device`.
    pub by: &'static str,
}

impl Ratio {
    /// Median ratio over rounds in which both ran once, by processor time or by device time.
    pub fn of(what: &str, [ours, baseline]: [(&str, &[Times]); 2], by_processor: bool) -> Ratio {
        let time = |times: &Times| match times.cpu_ns {
            Some(ns) if by_processor => ns,
            _ => times.stages.iter().map(|(_, ns)| ns).sum::<f64>(),
        };
        let rounds = ours.1.iter().zip(baseline.1);
        let ratios: Vec<f64> = rounds.map(|(ours, baseline)| time(baseline) / time(ours)).collect();
        let summary = Summary::of(&ratios);
        Ratio {
            what: what.into(),
            ours: ours.0.into(),
            baseline: baseline.0.into(),
            ratio: summary.median,
            interval: summary.interval,
            by: if by_processor { "processor" } else { "device" },
        }
    }

    /// One line of text.
    pub fn line(&self) -> String {
        let [low, high] = self.interval;
        format!(
            "{:<9} {:.2} × {} ({low:.2} to {high:.2}, {} time, {})",
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
        // The machine is half as fast in the second round, for both.
        let (ours, baseline) = (times([1.0, 2.0, 1.0]), times([6.0, 12.0, 7.0]));
        let pair = [("a", ours.as_slice()), ("b", baseline.as_slice())];
        for (by_processor, by) in [(true, "processor"), (false, "device")] {
            let ratio = Ratio::of("forward", pair, by_processor);
            assert_eq!((ratio.ratio, ratio.by), (6.0, by));
            assert!(ratio.line().contains("6.00 × b"), "{}", ratio.line());
        }
    }
}
