//! Figures of the chart.

use super::pareto::front;
use super::{Chart, FrameErrors, GradientErrors, Knob, RunPoint};
use crate::lab::page::scatter::{Axis, Marker, ScatterPlot};
use crate::stats::Interval;

/// A plot and its caption.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Panel {
    pub(super) plot: ScatterPlot,
    pub(super) caption: String,
}

/// Sizes in pixels: one figure across the page, and two beside each other.
const WIDE: [u32; 2] = [1080, 470];
const HALF: [u32; 2] = [532, 390];

/// Name of the model's own error.
const PROJECTION: &str = "EWA against rays";

const TIME_OF_FRAME: Axis = Axis {
    title: "time of a frame on the device, ms",
    is_log: false,
};

/// Names of all series of the page in the order of their first point; a series has the same glyph everywhere.
pub(super) fn series(chart: &Chart) -> Vec<&str> {
    let frames = chart.frames.iter().map(|p| &p.knob);
    let gradients = chart.gradients.iter().map(|p| &p.knob);
    let runs = chart.runs.iter().map(|p| &p.knob);
    let mut names: Vec<&str> = Vec::new();
    for knob in frames.chain(gradients).chain(runs) {
        if !names.contains(&knob.series.as_str()) {
            names.push(&knob.series);
        }
    }
    names
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

/// Bar from the measured value to its proven bound.
fn bound_bar(value: f64, bound: f64) -> Option<[f64; 2]> {
    let is_bounded = bound.is_finite();
    is_bounded.then_some([value.min(bound), value.max(bound)])
}

/// Pareto front of low x and low y; of high y if `is_high_good`.
fn front_of(markers: &[Marker], is_high_good: bool) -> Vec<usize> {
    let sign = if is_high_good { -1.0 } else { 1.0 };
    let points: Vec<[f64; 2]> = markers.iter().map(|m| [m.x, sign * m.y]).collect();
    front(&points)
}

/// Look of a panel of frames.
struct FrameView {
    size: [u32; 2],
    y: Axis,
    /// Plotted value.
    value: fn(&FrameErrors) -> f64,
    is_high_good: bool,
    caption: &'static str,
}

/// Panels of frame time against errors.
pub(super) fn of_frames(chart: &Chart) -> Vec<Panel> {
    let names = series(chart);
    let views = [
        FrameView {
            size: WIDE,
            y: Axis {
                title: "largest error of any pixel (of 1)",
                is_log: true,
            },
            value: |e| e.max,
            is_high_good: false,
            caption: "Largest error. Each sign is a setting, its upper bar reaches to the largest error that was \
                      proven possible before the frame was drawn; the sign lies below its bar's end, or rounding \
                      explains it, or the point has failed. Left and low is good.",
        },
        FrameView {
            size: HALF,
            y: Axis {
                title: "99th percentile of the error (of 1)",
                is_log: true,
            },
            value: |e| e.p99,
            is_high_good: false,
            caption: "99th percentile of the pixels' errors. Bars end at that of the pixels' own bounds.",
        },
        FrameView {
            size: HALF,
            y: Axis {
                title: "PSNR against the exact frame, dB",
                is_log: false,
            },
            value: |e| e.psnr_db,
            is_high_good: true,
            caption: "The whole frame in one figure. Bars end at the PSNR that the bounds' root mean square \
                      promises: the worst that was possible. Left and high is good.",
        },
    ];
    let panel = |view: FrameView| {
        let markers: Vec<Marker> = chart
            .frames
            .iter()
            .map(|point| {
                let (value, bound) = ((view.value)(&point.error), (view.value)(&point.bound));
                Marker {
                    x_bar: bar(&point.time_ms),
                    y_bar: bound_bar(value, bound),
                    is_broken: !point.holds(),
                    ..mark(&names, &point.knob, point.time_ms.value, value)
                }
            })
            .collect();
        Panel {
            plot: ScatterPlot {
                size: view.size,
                x: TIME_OF_FRAME,
                y: view.y,
                front: front_of(&markers, view.is_high_good),
                markers,
                levels: chart.projection.iter().map(|e| (PROJECTION, (view.value)(e))).collect(),
                are_courses: false,
            },
            caption: view.caption.into(),
        }
    };
    views.into_iter().map(panel).collect()
}

/// Panels of step time against the errors of its gradient.
pub(super) fn of_gradients(chart: &Chart) -> Vec<Panel> {
    let names = series(chart);
    let panel = |title, value: fn(&GradientErrors) -> f64, caption: &str| {
        let markers: Vec<Marker> = chart
            .gradients
            .iter()
            .map(|point| {
                let (error, bound) = (value(&point.error), value(&point.bound));
                Marker {
                    x_bar: bar(&point.time_ms),
                    y_bar: bound_bar(error, bound),
                    is_broken: !point.holds(),
                    ..mark(&names, &point.knob, point.time_ms.value, error)
                }
            })
            .collect();
        Panel {
            plot: ScatterPlot {
                size: HALF,
                x: Axis {
                    title: "time of a training step on the device, ms",
                    is_log: false,
                },
                y: Axis { title, is_log: true },
                front: front_of(&markers, false),
                markers,
                levels: Vec::new(),
                are_courses: false,
            },
            caption: caption.into(),
        }
    };
    vec![
        panel(
            "99th percentile of relative errors",
            |e| e.p99,
            "99 of 100 parameters' gradients are off by at most this, relative to the exact value, or to 1 % of \
             its kind's root mean square where it is smaller than that. Bars end at the same percentile of the \
             parameters' own bounds.",
        ),
        panel(
            "median of relative errors",
            |e| e.median,
            "Half of the gradients are nearer than this, and proven to be nearer than the bar's end.",
        ),
    ]
}

/// Axes, values and caption of a panel of runs.
type RunView = (
    Axis,
    fn(&RunPoint) -> &Interval,
    Axis,
    fn(&RunPoint) -> &Interval,
    &'static str,
);

/// Panels of the quality of training runs against cost, and over time.
pub(super) fn of_runs(chart: &Chart) -> Vec<Panel> {
    let names = series(chart);
    let axis = |title, is_log| Axis { title, is_log };
    let views: [RunView; 4] = [
        (
            axis("training time, s", false),
            |p| &p.seconds,
            axis("PSNR of held-out views, dB", false),
            |p| &p.psnr_db,
            "Quality against time: wall time of the training steps, without loading and evaluation.",
        ),
        (
            axis("training time, s", false),
            |p| &p.seconds,
            axis("SSIM of held-out views", false),
            |p| &p.ssim,
            "The same by structural similarity.",
        ),
        (
            axis("splats", false),
            |p| &p.splats,
            axis("PSNR of held-out views, dB", false),
            |p| &p.psnr_db,
            "Quality against the size of the result: model no more than the scene needs.",
        ),
        (
            axis("megabytes of parameters", false),
            |p| &p.megabytes,
            axis("PSNR of held-out views, dB", false),
            |p| &p.psnr_db,
            "The same in bytes, where fewer harmonics count too.",
        ),
    ];
    let panel = |(x, x_of, y, y_of, caption): RunView| {
        let markers: Vec<Marker> = chart
            .runs
            .iter()
            .map(|point| Marker {
                x_bar: bar(x_of(point)),
                y_bar: bar(y_of(point)),
                ..mark(&names, &point.knob, x_of(point).value, y_of(point).value)
            })
            .collect();
        Panel {
            plot: ScatterPlot {
                size: HALF,
                x,
                y,
                front: front_of(&markers, true),
                markers,
                levels: Vec::new(),
                are_courses: false,
            },
            caption: caption.into(),
        }
    };
    let mut panels: Vec<Panel> = views.into_iter().map(panel).collect();
    panels.push(courses(chart, &names));
    panels
}

/// Quality over time of the last setting of every series; the series' name is at the end of its line.
fn courses(chart: &Chart, names: &[&str]) -> Panel {
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
                    true => format!("{} {}", run.knob.series, run.knob.setting),
                    false => String::new(),
                },
                ..mark(names, &run.knob, *seconds * shift, psnr.value)
            });
        }
    }
    Panel {
        plot: ScatterPlot {
            size: WIDE,
            x: Axis {
                title: "training time, s",
                is_log: true,
            },
            y: Axis {
                title: "PSNR of held-out views, dB",
                is_log: false,
            },
            markers,
            front: Vec::new(),
            levels: Vec::new(),
            are_courses: true,
        },
        caption: "Quality on the way, by wall time with evaluation left out: of every knob the setting turned \
                  farthest, named at its end. A line that lies above another at your budget of seconds is the \
                  better choice there. Signs of one time (0.6, 1.25, 2.5, 5, 10 s and so on) are set apart by a \
                  percent each, for their bars' sake."
            .into(),
    }
}

/// Relative distance of two lines' glyphs at one time.
const APART: f64 = 0.01;
