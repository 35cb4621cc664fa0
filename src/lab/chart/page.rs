//! Page of the chart: figures, their explanation, and tables.

use super::panels::{self, series};
use super::{Chart, Knob, RunPoint, tables};
use crate::Result;
use crate::lab::page::scatter::ScatterPlot;
use crate::lab::page::{self, document, escaped};

const OF_FRAMES: &str = include_str!("frames.html");

const OF_GRADIENTS: &str = include_str!("gradients.html");

const OF_RUNS: &str = include_str!("runs.html");

const OF_GEOMETRY: &str = include_str!("geometry.html");

/// The page's text.
///
/// # Errors
/// When a figure cannot be drawn.
pub fn html(chart: &Chart) -> Result<String> {
    let mut body = heading(chart);
    let details = |table| format!("<details open>\n<summary>The numbers</summary>\n{table}</details>\n");
    if !chart.frames.is_empty() {
        let knobs = chart.frames.iter().map(|p| &p.knob);
        body += &format!("<h2>Rendering: time against error</h2>\n{OF_FRAMES}");
        body += &legend(chart, knobs, true)?;
        body += &figures(&panels::of_frames(chart))?;
        body += &details(tables::of_frames(chart));
    }
    if !chart.gradients.is_empty() {
        let knobs = chart.gradients.iter().map(|p| &p.knob);
        body += &format!("<h2>Gradients: time against error</h2>\n{OF_GRADIENTS}");
        body += &legend(chart, knobs, true)?;
        body += &figures(&panels::of_gradients(chart))?;
        body += &details(tables::of_gradients(chart));
    }
    if !chart.runs.is_empty() {
        let knobs = chart.runs.iter().map(|p| &p.knob);
        body += &format!("<h2>Training: quality against cost</h2>\n{OF_RUNS}");
        body += &costs(&chart.runs);
        body += &legend(chart, knobs, false)?;
        body += &figures(&panels::of_runs(chart))?;
        body += &details(tables::of_runs(chart));
    }
    if !chart.geometry.is_empty() {
        let knobs = chart.geometry.iter().map(|p| &p.knob);
        body += &format!("<h2>Geometry: error against cost</h2>\n{OF_GEOMETRY}");
        body += &legend(chart, knobs, false)?;
        body += &figures(&panels::of_geometry(chart))?;
        body += &details(tables::of_geometry(chart));
    }
    Ok(document("speed against accuracy", &body))
}

fn heading(chart: &Chart) -> String {
    let text = format!("<h1>Speed against accuracy</h1>\n{}", page::facts(&chart.facts));
    let (broken, count) = (chart.broken(), chart.bounded());
    let summary = match broken.len() {
        0 if count == 0 => return text,
        0 => format!("All {count} settings keep their proven bounds."),
        failed => format!("{failed} of {count} settings break their bounds."),
    };
    text + &page::verdict(&summary, &broken)
}

/// Glyphs of the series of some points, and the meaning of their parts.
fn legend<'a>(chart: &Chart, knobs: impl Iterator<Item = &'a Knob>, is_bounded: bool) -> Result<String> {
    let used: Vec<&str> = knobs.map(|knob| knob.series.as_str()).collect();
    let names = series(chart).into_iter().enumerate();
    let names = names.filter(|(_, name)| used.contains(name));
    let mut parts = vec![
        "filled: on the Pareto front (grey steps)",
        "hollow: beaten",
        "ringed: the default",
        "horizontal bar: 95 % interval",
    ];
    if is_bounded {
        parts.extend(["vertical bar: to the proven bound", "red cross: bound broken"]);
    }
    let parts: String = parts.iter().map(|part| format!("<li>{part}</li>\n")).collect();
    Ok(page::legend(names)? + &format!("<ul class=\"legend\">\n{parts}</ul>\n"))
}

/// One line for every setting of training: its change in decibels and in time.
fn costs(runs: &[RunPoint]) -> String {
    let default = runs.iter().find(|run| run.knob.is_default);
    let Some(usual) = default.map(|run| run.seconds.value) else {
        return String::new();
    };
    let line = |run: &RunPoint| {
        let RunPoint { knob, gain_db, .. } = run;
        let is_significant = gain_db.low > 0.0 || gain_db.high < 0.0;
        format!(
            "<li>{}: {} dB{} at {:.2} of the time</li>\n",
            escaped(&knob.name()),
            tables::gain(gain_db),
            if is_significant { "" } else { " (within the interval)" },
            run.seconds.value / usual
        )
    };
    let others = runs.iter().filter(|run| !run.knob.is_default);
    let lines: String = others.map(line).collect();
    format!("<ul class=\"costs\">\n{lines}</ul>\n")
}

fn figures(plots: &[ScatterPlot]) -> Result<String> {
    let mut text = String::from("<div class=\"figures\">\n");
    for plot in plots {
        let class = if plot.size[0] > 600 { "wide" } else { "half" };
        text += &page::figure(class, &plot.svg()?, &escaped(plot.caption));
    }
    Ok(text + "</div>\n")
}

#[cfg(test)]
mod tests {
    use super::super::tests::frame;
    use super::super::{GeometryPoint, GradientErrors, GradientPoint};
    use super::*;
    use crate::lab::page::tests::is_alone;
    use crate::stats::Interval;

    fn chart(excess: f64) -> Chart {
        Chart {
            facts: vec![("scene".into(), "a<b".into())],
            frames: vec![frame("1e-4", -1e-4), frame("1e-2", excess)],
            projection: Some(frame("", 0.0).error),
            gradients: vec![GradientPoint {
                error: GradientErrors {
                    median: 1e-6,
                    p99: 1e-4,
                },
                ..GradientPoint::default()
            }],
            runs: vec![RunPoint {
                course: vec![
                    (1.0, Interval::of_mean(&[20.0, 21.0])),
                    (2.0, Interval::of_mean(&[23.0])),
                ],
                ..RunPoint::default()
            }],
            geometry: vec![GeometryPoint::default()],
        }
    }

    #[test]
    fn the_page_holds_every_figure_and_needs_nothing_else() -> Result<()> {
        let page = html(&chart(-1.0))?;
        assert_eq!(page.matches("<figure ").count(), 3 + 2 + 5 + 4);
        assert!(page.contains("All 3 settings keep their proven bounds."));
        assert!(page.contains("a&lt;b") && !page.contains("a<b"));
        assert_eq!(page.matches("EWA against rays").count(), 3);
        assert!(is_alone(&page) && !page.contains(" src="));
        Ok(())
    }

    #[test]
    fn a_broken_bound_is_shown_as_such() -> Result<()> {
        let page = html(&chart(2e-3))?;
        assert!(page.contains("1 of 3 settings break their bounds"));
        assert!(page.contains("<tr class=\"broken\">") && page.contains("broken by 2.0e-3"));
        // The colour of alarms, in every panel of frames.
        assert!(page.matches("#C80000").count() >= 3, "no alarm is drawn");
        assert!(!html(&chart(-1.0))?.contains("#C80000"));
        Ok(())
    }

    #[test]
    fn costs_of_training_are_decibels_with_their_interval() -> Result<()> {
        let run = |setting: &str, seconds: f64, gains: &[f64]| RunPoint {
            knob: Knob {
                is_default: gains.is_empty(),
                ..Knob::new("loss", setting)
            },
            seconds: Interval::of_mean(&[seconds]),
            gain_db: Interval::of_mean(gains),
            ..RunPoint::default()
        };
        let page = html(&Chart {
            runs: vec![
                run("usual", 4.0, &[]),
                run("every 2nd", 3.0, &[-0.5, -0.6, -0.7]),
                run("every 4th", 2.0, &[-0.5, 0.6, -0.7]),
            ],
            ..Chart::default()
        })?;
        let told = "<li>loss every 2nd: -0.60 ± 0.25 dB at 0.75 of the time</li>";
        assert!(page.contains(told), "{page}");
        assert!(page.contains("dB (within the interval) at 0.50"));
        assert_eq!(page.matches("<li>loss ").count(), 2);
        assert!(page.contains("<td>-0.60 ± 0.25</td>"));
        Ok(())
    }

    #[test]
    fn an_empty_chart_is_a_page_too() -> Result<()> {
        let page = html(&Chart::default())?;
        assert!(page.contains("<h1>") && !page.contains("<figure"));
        Ok(())
    }
}
