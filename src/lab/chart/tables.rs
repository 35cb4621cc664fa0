//! The numbers of the page, as HTML tables.

use super::{Chart, Knob};
use crate::stats::Interval;

/// Text as it may stand in HTML.
pub(in crate::lab) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

/// A table from its head and rows of finished cells.
fn table(head: &[&str], rows: impl Iterator<Item = (bool, Vec<String>)>) -> String {
    let cells = |tag: &str, cells: &[String]| -> String {
        let cell = |text: &String| format!("<{tag}>{text}</{tag}>");
        cells.iter().map(cell).collect()
    };
    let head: Vec<String> = head.iter().map(|name| (*name).to_owned()).collect();
    let mut text = format!("<table>\n<tr>{}</tr>\n", cells("th", &head));
    for (is_broken, row) in rows {
        let class = if is_broken { " class=\"broken\"" } else { "" };
        text += &format!("<tr{class}>{}</tr>\n", cells("td", &row));
    }
    text + "</table>\n"
}

fn knob(knob: &Knob) -> [String; 2] {
    let star = if knob.is_default { " (default)" } else { "" };
    [escaped(&knob.series), escaped(&knob.setting) + star]
}

fn error(value: f64) -> String {
    format!("{value:.1e}")
}

/// Whether nothing lies beyond its bound. What is no number keeps none.
fn verdict(excess: f64) -> String {
    match excess <= 0.0 {
        true => "kept".into(),
        false => format!("broken by {excess:.1e}"),
    }
}

/// A figure with half its interval.
fn interval(interval: &Interval, digits: usize) -> String {
    let half = 0.5 * (interval.high - interval.low);
    match half > 0.0 {
        true => format!("{:.digits$} ± {half:.digits$}", interval.value),
        false => format!("{:.digits$}", interval.value),
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
    table(&head, rows)
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
    table(&head, rows)
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
    table(&head, rows)
}
