//! Points of the chart as CSV, one number a line.

use super::{Chart, FrameErrors, Knob};
use crate::stats::Interval;

/// Columns. `bound` is the proven bound of the value, `count` the number of measurements behind it; fields that do not
/// apply are empty.
pub const HEADER: &str = "chart,series,setting,default,quantity,value,low,high,bound,count";

/// All points.
pub fn csv(chart: &Chart) -> String {
    let mut lines = CsvLines(format!("{HEADER}\n"));
    for point in &chart.frames {
        let knob = ("rendering", &point.knob);
        lines.interval(knob, "time_ms", &point.time_ms);
        lines.number(knob, "cpu_ms", point.cpu_ms, None);
        lines.number(knob, "scene_bytes", point.scene_bytes as f64, None);
        let FrameErrors { max, p99, psnr_db } = point.error;
        lines.number(knob, "max_error", max, Some(point.bound.max));
        lines.number(knob, "p99_error", p99, Some(point.bound.p99));
        lines.number(knob, "psnr_db", psnr_db, Some(point.bound.psnr_db));
        lines.number(knob, "excess", point.excess, Some(0.0));
        lines.number(knob, "rounding", point.rounding, None);
    }
    if let Some(FrameErrors { max, p99, psnr_db }) = chart.projection {
        let knob = Knob::new("linear projection", "against rays");
        for (quantity, value) in [("max_error", max), ("p99_error", p99), ("psnr_db", psnr_db)] {
            lines.number(("model", &knob), quantity, value, None);
        }
    }
    for point in &chart.gradients {
        let knob = ("gradients", &point.knob);
        lines.interval(knob, "time_ms", &point.time_ms);
        lines.number(knob, "cpu_ms", point.cpu_ms, None);
        let (error, bound) = (&point.error, &point.bound);
        lines.number(knob, "median_relative_error", error.median, Some(bound.median));
        lines.number(knob, "p99_relative_error", error.p99, Some(bound.p99));
        lines.number(knob, "excess", point.excess, Some(0.0));
    }
    for point in &chart.runs {
        let knob = ("training", &point.knob);
        for (quantity, interval) in [
            ("psnr_db", &point.psnr_db),
            ("psnr_gain_db", &point.gain_db),
            ("ssim", &point.ssim),
            ("seconds", &point.seconds),
            ("splats", &point.splats),
            ("megabytes", &point.megabytes),
        ] {
            lines.interval(knob, quantity, interval);
        }
        for (seconds, psnr) in &point.course {
            lines.interval(knob, &format!("psnr_db_at_{seconds}_s"), psnr);
        }
    }
    for point in &chart.geometry {
        let knob = ("geometry", &point.knob);
        for (quantity, interval) in [
            ("chamfer_px", &point.chamfer),
            ("depth_median_error", &point.depth),
            ("normal_deg", &point.normal),
            ("psnr_db", &point.psnr_db),
            ("seconds", &point.seconds),
            ("splats", &point.splats),
        ] {
            lines.interval(knob, quantity, interval);
        }
    }
    lines.0
}

struct CsvLines(String);

impl CsvLines {
    fn push(&mut self, (chart, knob): (&str, &Knob), quantity: &str, numbers: [String; 5]) {
        // Settings of two numbers contain a comma; `;` replaces it, so that lines can be split without a parser.
        let [series, setting] = [&knob.series, &knob.setting].map(|name| name.replace(',', ";"));
        let default = if knob.is_default { "yes" } else { "" };
        let numbers = numbers.join(",");
        self.0 += &format!("{chart},{series},{setting},{default},{quantity},{numbers}\n");
    }

    fn interval(&mut self, knob: (&str, &Knob), quantity: &str, interval: &Interval) {
        let [value, low, high] = [interval.value, interval.low, interval.high].map(number);
        let count = interval.count.to_string();
        self.push(knob, quantity, [value, low, high, String::new(), count]);
    }

    fn number(&mut self, knob: (&str, &Knob), quantity: &str, value: f64, bound: Option<f64>) {
        let empty = String::new;
        let bound = bound.map_or_else(empty, number);
        self.push(knob, quantity, [number(value), empty(), empty(), bound, empty()]);
    }
}

/// Six significant digits.
fn number(value: f64) -> String {
    if value == 0.0 || (1e-3..1e6).contains(&value.abs()) {
        let digits = 5 - (value.abs().max(1e-3).log10().floor() as i32).clamp(-3, 5);
        return format!("{value:.0$}", digits.unsigned_abs() as usize);
    }
    format!("{value:.5e}")
}

#[cfg(test)]
mod tests {
    use super::super::tests::frame;
    use super::*;

    #[test]
    fn every_line_has_every_column() {
        let mut point = frame("a,b", -1.0);
        point.knob.is_default = true;
        let chart = Chart {
            frames: vec![point],
            gradients: vec![Default::default()],
            runs: vec![crate::lab::chart::RunPoint {
                course: vec![(5.0, Interval::of_mean(&[20.0, 21.0]))],
                ..Default::default()
            }],
            ..Chart::default()
        };
        let text = csv(&chart);
        let columns = HEADER.split(',').count();
        assert!(text.lines().all(|line| line.split(',').count() == columns), "{text}");
        assert!(
            text.contains("\nrendering,stop alone,a;b,yes,max_error,0.00200000,,,0.00300000,\n"),
            "{text}"
        );
        assert!(text.contains(",psnr_db_at_5_s,20.5000,"), "{text}");
    }

    #[test]
    fn numbers_keep_six_digits() {
        let texts = [0.0, 1.0 / 3.0, 123_456.7, 1.5e-7, f64::INFINITY].map(number);
        assert_eq!(texts, ["0.00000000", "0.333333", "123457", "1.50000e-7", "inf"]);
    }
}
