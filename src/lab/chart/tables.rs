//! Tables of the chart.

use super::{Chart, Knob};
use crate::lab::page::{interval, table};
use crate::stats::Interval;

fn knob(knob: &Knob) -> [String; 2] {
    let star = if knob.is_default { " (default)" } else { "" };
    [knob.series.clone(), format!("{}{star}", knob.setting)]
}

fn error(value: f64) -> String {
    format!("{value:.1e}")
}

/// State of a bound; NaN breaks it.
fn verdict(excess: f64) -> String {
    match excess <= 0.0 {
        true => "kept".into(),
        false => format!("broken by {excess:.1e}"),
    }
}

/// A difference in decibels, with its sign and half its interval.
pub(super) fn gain(gain: &Interval) -> String {
    let half = 0.5 * (gain.high - gain.low);
    format!("{:+.2} ± {half:.2}", gain.value)
}

pub(super) fn of_frames(chart: &Chart) -> String {
    let head = [
        "knob",
        "setting",
        "ms a frame",
        "CPU ms",
        "MB",
        "largest error",
        "proven",
        "99 %",
        "proven",
        "PSNR, dB",
        "proven",
        "bound",
    ];
    let rows = chart.frames.iter().map(|p| {
        let mut row = knob(&p.knob).to_vec();
        row.extend([
            interval(&p.time_ms, 2),
            format!("{:.1}", p.cpu_ms),
            format!("{:.2}", p.scene_bytes as f64 * 1e-6),
            error(p.error.max),
            error(p.bound.max),
            error(p.error.p99),
            error(p.bound.p99),
            format!("{:.1}", p.error.psnr_db),
            format!("{:.1}", p.bound.psnr_db),
            verdict(p.excess),
        ]);
        (!p.holds(), row)
    });
    table("", &head, rows)
}

pub(super) fn of_gradients(chart: &Chart) -> String {
    let head = [
        "knob",
        "setting",
        "ms a step",
        "CPU ms",
        "median error",
        "proven",
        "99 %",
        "proven",
        "bound",
    ];
    let rows = chart.gradients.iter().map(|p| {
        let mut row = knob(&p.knob).to_vec();
        row.extend([
            interval(&p.time_ms, 2),
            format!("{:.1}", p.cpu_ms),
            error(p.error.median),
            error(p.bound.median),
            error(p.error.p99),
            error(p.bound.p99),
            verdict(p.excess),
        ]);
        (!p.holds(), row)
    });
    table("", &head, rows)
}

pub(super) fn of_runs(chart: &Chart) -> String {
    let head = [
        "knob",
        "setting",
        "runs",
        "PSNR, dB",
        "to default, dB",
        "SSIM",
        "seconds",
        "splats",
        "MB",
    ];
    let rows = chart.runs.iter().map(|p| {
        let mut row = knob(&p.knob).to_vec();
        row.extend([
            p.psnr_db.count.to_string(),
            interval(&p.psnr_db, 2),
            match p.knob.is_default {
                true => String::new(),
                false => gain(&p.gain_db),
            },
            interval(&p.ssim, 4),
            interval(&p.seconds, 2),
            interval(&p.splats, 0),
            interval(&p.megabytes, 2),
        ]);
        (false, row)
    });
    table("", &head, rows)
}
