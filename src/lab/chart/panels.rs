//! Figures of the chart.

use super::pareto::front;
use super::{AccuracyPoint, Chart, FrameErrors, GeometryPoint, GradientErrors, Knob, RunPoint};
use crate::lab::page::distinct;
use crate::lab::page::scatter::{Marker, ScatterPlot};
use crate::stats::Interval;

/// Sizes in pixels: one figure across the page, and two beside each other.
const WIDE: [u32; 2] = [1080, 470];
const HALF: [u32; 2] = [532, 390];

/// Name of the model's own error.
const PROJECTION: &str = "EWA against rays";

const PSNR: &str = "PSNR of held-out views, dB";

/// Names of all series of the page in the order of their first point; a series has the same glyph everywhere.
pub(super) fn series(chart: &Chart) -> Vec<&str> {
    let frames = chart.frames.iter().map(|p| &p.knob);
    let gradients = chart.gradients.iter().map(|p| &p.knob);
    let runs = chart.runs.iter().map(|p| &p.knob);
    let geometry = chart.geometry.iter().map(|p| &p.knob);
    let knobs = frames.chain(gradients).chain(runs).chain(geometry);
    distinct(knobs.map(|knob| knob.series.as_str()))
}

fn mark(names: &[&str], knob: &Knob, x: f64, y: f64) -> Marker {
    Marker {
        series: names.iter().position(|n| *n == knob.series).unwrap_or(0),
        text: match knob.is_default {
            true => "default".into(),
            false => knob.setting.clone(),
        },
        x,
        y,
        is_default: knob.is_default,
        ..Marker::default()
    }
}

/// Ends of an interval, unless it is empty.
fn bar(interval: &Interval) -> Option<[f64; 2]> {
    (interval.high > interval.low).then_some([interval.low, interval.high])
}

/// Plot with its Pareto front: of low x, and of low errors, which have a logarithmic axis, or of high quality on a
/// linear one.
fn plot(size: [u32; 2], titles: [&'static str; 2], is_log: bool, markers: Vec<Marker>) -> ScatterPlot {
    let sign = if is_log { 1.0 } else { -1.0 };
    let points: Vec<[f64; 2]> = markers.iter().map(|m| [m.x, sign * m.y]).collect();
    ScatterPlot {
        size,
        titles,
        are_log: [false, is_log],
        front: front(&points),
        markers,
        ..ScatterPlot::default()
    }
}

/// Size, vertical axis, true for a logarithmic one, plotted error, and caption of a plot of points with bounds.
type BoundedView<E> = ([u32; 2], &'static str, bool, fn(&E) -> f64, &'static str);

/// Plot of errors over time, with bars to their proven bounds.
fn bounded<E>(
    chart: &Chart,
    time: &'static str,
    points: &[AccuracyPoint<E>],
    &(size, title, is_log, value, caption): &BoundedView<E>,
) -> ScatterPlot {
    let names = series(chart);
    let marker = |point: &AccuracyPoint<E>| {
        let (value, bound) = (value(&point.error), value(&point.bound));
        Marker {
            x_bar: bar(&point.time_ms),
            y_bar: bound.is_finite().then_some([value.min(bound), value.max(bound)]),
            is_broken: !point.holds(),
            ..mark(&names, &point.knob, point.time_ms.value, value)
        }
    };
    ScatterPlot {
        caption,
        ..plot(size, [time, title], is_log, points.iter().map(marker).collect())
    }
}

/// Plots of frame time against errors.
pub(super) fn of_frames(chart: &Chart) -> Vec<ScatterPlot> {
    let views: [BoundedView<FrameErrors>; 3] = [
        (
            WIDE,
            "largest error of any pixel (of 1)",
            true,
            |e| e.max,
            "Largest error. Each sign is a setting, its upper bar reaches to the largest error that was proven \
             possible before the frame was drawn; the sign lies below its bar's end, or rounding explains it, or the \
             point has failed. Left and low is good.",
        ),
        (
            HALF,
            "99th percentile of the error (of 1)",
            true,
            |e| e.p99,
            "99th percentile of the pixels' errors. Bars end at that of the pixels' own bounds.",
        ),
        (
            HALF,
            "PSNR against the exact frame, dB",
            false,
            |e| e.psnr_db,
            "The whole frame in one figure. Bars end at the PSNR that the bounds' root mean square promises: the \
             worst that was possible. Left and high is good.",
        ),
    ];
    let plot = |view: &BoundedView<FrameErrors>| ScatterPlot {
        levels: chart.projection.iter().map(|e| (PROJECTION, view.3(e))).collect(),
        ..bounded(chart, "time of a frame on the device, ms", &chart.frames, view)
    };
    views.iter().map(plot).collect()
}

/// Plots of step time against the errors of its gradient.
pub(super) fn of_gradients(chart: &Chart) -> Vec<ScatterPlot> {
    let views: [BoundedView<GradientErrors>; 2] = [
        (
            HALF,
            "99th percentile of relative errors",
            true,
            |e| e.p99,
            "99 of 100 parameters' gradients are off by at most this, relative to the exact value, or to 1 % of its \
             kind's root mean square where it is smaller than that. Bars end at the same percentile of the \
             parameters' own bounds.",
        ),
        (
            HALF,
            "median of relative errors",
            true,
            |e| e.median,
            "Half of the gradients are nearer than this, and proven to be nearer than the bar's end.",
        ),
    ];
    let time = "time of a training step on the device, ms";
    let plot = |view| bounded(chart, time, &chart.gradients, view);
    views.iter().map(plot).collect()
}

/// Title and value of an axis of training runs.
type RunAxis = (&'static str, fn(&RunPoint) -> &Interval);

/// Plots of the quality of training runs against cost, and over time.
pub(super) fn of_runs(chart: &Chart) -> Vec<ScatterPlot> {
    let names = series(chart);
    let seconds: RunAxis = ("training time, s", |p| &p.seconds);
    let psnr: RunAxis = (PSNR, |p| &p.psnr_db);
    let views: [(RunAxis, RunAxis, &str); 4] = [
        (
            seconds,
            psnr,
            "Quality against time: wall time of the training steps, without loading and evaluation.",
        ),
        (
            seconds,
            ("SSIM of held-out views", |p| &p.ssim),
            "The same by structural similarity.",
        ),
        (
            ("splats", |p| &p.splats),
            psnr,
            "Quality against the size of the result: model no more than the scene needs.",
        ),
        (
            ("megabytes of parameters", |p| &p.megabytes),
            psnr,
            "The same in bytes, where fewer harmonics count too.",
        ),
    ];
    let plot = |((x, x_of), (y, y_of), caption): (RunAxis, RunAxis, _)| {
        let marker = |point: &RunPoint| Marker {
            x_bar: bar(x_of(point)),
            y_bar: bar(y_of(point)),
            ..mark(&names, &point.knob, x_of(point).value, y_of(point).value)
        };
        ScatterPlot {
            caption,
            ..plot(HALF, [x, y], false, chart.runs.iter().map(marker).collect())
        }
    };
    views.into_iter().map(plot).chain([courses(chart, &names)]).collect()
}

/// Title and value of an axis of geometry.
type GeometryAxis = (&'static str, fn(&GeometryPoint) -> &Interval);

/// Plots of the errors of geometry against cost, and against the quality of pictures.
pub(super) fn of_geometry(chart: &Chart) -> Vec<ScatterPlot> {
    let names = series(chart);
    let chamfer: GeometryAxis = ("chamfer distance, pixels", |p| &p.chamfer);
    let seconds: GeometryAxis = ("training time, s", |p| &p.seconds);
    let psnr: GeometryAxis = (PSNR, |p| &p.psnr_db);
    let views: [(GeometryAxis, GeometryAxis, &str); 4] = [
        (seconds, chamfer, "The mesh against time. Left and low is good."),
        (
            ("splats", |p| &p.splats),
            chamfer,
            "The mesh against the size of the scene.",
        ),
        (
            seconds,
            ("error of normals, degrees", |p| &p.normal),
            "Normals of held-out views against time.",
        ),
        (psnr, chamfer, "The mesh against the pictures. Right and low is good."),
    ];
    let plot = |((x, x_of), (y, y_of), caption): (GeometryAxis, GeometryAxis, _)| {
        let marker = |point: &GeometryPoint| Marker {
            x_bar: bar(x_of(point)),
            y_bar: bar(y_of(point)),
            ..mark(&names, &point.knob, x_of(point).value, y_of(point).value)
        };
        let mut plot = ScatterPlot {
            caption,
            are_log: [false; 2],
            ..plot(HALF, [x, y], true, chart.geometry.iter().map(marker).collect())
        };
        // The front is one of low costs, and PSNR is none.
        if x == PSNR {
            plot.front.clear();
        }
        plot
    };
    views.into_iter().map(plot).collect()
}

/// Quality over time of the last setting of every series; the series' name is at the end of its line.
fn courses(chart: &Chart, names: &[&str]) -> ScatterPlot {
    let is_last = |index: usize| {
        let series = &chart.runs[index].knob.series;
        chart.runs[index + 1..].iter().all(|run| run.knob.series != *series)
    };
    let shown: Vec<usize> = (0..chart.runs.len()).filter(|&i| is_last(i)).collect();
    let mut markers = Vec::new();
    for (rank, &index) in shown.iter().enumerate() {
        let run = &chart.runs[index];
        let last = run.course.len().saturating_sub(1);
        // Bars at one time are drawn side by side.
        let apart = 1.0 + APART * (rank as f64 - 0.5 * shown.len() as f64);
        for (i, (seconds, psnr)) in run.course.iter().enumerate() {
            let shift = if i == last { 1.0 } else { apart };
            markers.push(Marker {
                y_bar: bar(psnr),
                is_default: false,
                text: match i == last {
                    true if run.knob.is_default => "default".into(),
                    true => run.knob.name(),
                    false => String::new(),
                },
                ..mark(names, &run.knob, *seconds * shift, psnr.value)
            });
        }
    }
    ScatterPlot {
        size: WIDE,
        titles: ["training time, s", PSNR],
        are_log: [true, false],
        markers,
        are_courses: true,
        caption: "Quality on the way, by wall time with evaluation left out: of every knob the setting turned \
                  farthest, named at its end. A line that lies above another at your budget of seconds is the \
                  better choice there. Signs of one time (0.6, 1.25, 2.5, 5, 10 s and so on) are set apart by a \
                  percent each, for their bars' sake.",
        ..ScatterPlot::default()
    }
}

/// Relative distance of two lines' glyphs at one time.
const APART: f64 = 0.01;
