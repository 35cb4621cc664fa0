//! Tables of the chart.

use super::{Chart, FramePoint, GeometryPoint, GradientPoint, Knob, RunPoint};
use crate::lab::page::{interval, table};
use crate::stats::Interval;

/// Title and text of a column.
type Column<P> = (&'static str, fn(&P) -> String);

/// Table of points, given by setting and a flag for broken bounds.
fn rows<P>(points: &[P], of: fn(&P) -> (&Knob, bool), columns: &[Column<P>]) -> String {
    let mut head = vec!["knob", "setting"];
    head.extend(columns.iter().map(|(title, _)| *title));
    let row = |point: &P| {
        let (knob, is_broken) = of(point);
        let star = if knob.is_default { " (default)" } else { "" };
        let mut cells = vec![knob.series.clone(), format!("{}{star}", knob.setting)];
        cells.extend(columns.iter().map(|(_, text)| text(point)));
        (is_broken, cells)
    };
    table("", &head, points.iter().map(row))
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
    let columns: [Column<FramePoint>; 10] = [
        ("ms a frame", |p| interval(&p.time_ms, 2)),
        ("CPU ms", |p| format!("{:.1}", p.cpu_ms)),
        ("MB", |p| format!("{:.2}", p.scene_bytes as f64 * 1e-6)),
        ("largest error", |p| error(p.error.max)),
        ("proven", |p| error(p.bound.max)),
        ("99 %", |p| error(p.error.p99)),
        ("proven", |p| error(p.bound.p99)),
        ("PSNR, dB", |p| format!("{:.1}", p.error.psnr_db)),
        ("proven", |p| format!("{:.1}", p.bound.psnr_db)),
        ("bound", |p| verdict(p.excess)),
    ];
    rows(&chart.frames, |p| (&p.knob, !p.holds()), &columns)
}

pub(super) fn of_gradients(chart: &Chart) -> String {
    let columns: [Column<GradientPoint>; 7] = [
        ("ms a step", |p| interval(&p.time_ms, 2)),
        ("CPU ms", |p| format!("{:.1}", p.cpu_ms)),
        ("median error", |p| error(p.error.median)),
        ("proven", |p| error(p.bound.median)),
        ("99 %", |p| error(p.error.p99)),
        ("proven", |p| error(p.bound.p99)),
        ("bound", |p| verdict(p.excess)),
    ];
    rows(&chart.gradients, |p| (&p.knob, !p.holds()), &columns)
}

pub(super) fn of_runs(chart: &Chart) -> String {
    let columns: [Column<RunPoint>; 7] = [
        ("runs", |p| p.psnr_db.count.to_string()),
        ("PSNR, dB", |p| interval(&p.psnr_db, 2)),
        ("to default, dB", |p| match p.knob.is_default {
            true => String::new(),
            false => gain(&p.gain_db),
        }),
        ("SSIM", |p| interval(&p.ssim, 4)),
        ("seconds", |p| interval(&p.seconds, 2)),
        ("splats", |p| interval(&p.splats, 0)),
        ("MB", |p| interval(&p.megabytes, 2)),
    ];
    rows(&chart.runs, |p| (&p.knob, false), &columns)
}

pub(super) fn of_geometry(chart: &Chart) -> String {
    let columns: [Column<GeometryPoint>; 7] = [
        ("runs", |p| p.chamfer.count.to_string()),
        ("chamfer, pixels", |p| interval(&p.chamfer, 3)),
        ("depth, median error", |p| error(p.depth.value)),
        ("normals, degrees", |p| interval(&p.normal, 2)),
        ("PSNR, dB", |p| interval(&p.psnr_db, 2)),
        ("seconds", |p| interval(&p.seconds, 2)),
        ("splats", |p| interval(&p.splats, 0)),
    ];
    rows(&chart.geometry, |p| (&p.knob, false), &columns)
}
