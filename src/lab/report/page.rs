//! Page of a run that chose its splat count: losses by count, steps, and bytes by SH degree.

use super::needs::Needs;
use crate::Result;
use crate::lab::page::scatter::{Marker, ScatterPlot};
use crate::lab::page::{self, decimals, document, escaped, grouped, legend, table};
use crate::simplify::{Estimate, LossPoint, Measure, QualityLoss, ViewSet};

/// Largest loss in the figure, relative to the allowed one.
const SHOWN: f64 = 4.0;

const OF_LOSSES: &str = "Loss of the held-out views against the best scene since the end of growth, relative to the \
allowed loss, from rounds that took the same steps from the same state with and without the least important splats. \
Marks are means over views, with their one-sided 95 % bounds to either side (Student's t); filled marks are counts \
that were kept. A count is kept if the upper bounds are at most 1, or, where zero lies between the bounds, if those of \
views trained on are. Means above 4 are left out.";

const OF_STEPS: &str = "Scores are means over the held-out views, a PSNR of 40 dB and an SSIM of 0.99 at most. Losses \
are those of the scene with fewer splats or SH coefficients, with the upper bound of held-out views; losses of splats \
are summed since the end of growth. The last column names the views and the measure that came nearest to the allowed \
loss. It is four times as large for the mean of views trained on, but where zero lies between the bounds of held-out \
views: there, upper bounds of views trained on decide in their place.";

/// The page's text.
///
/// # Errors
/// When a figure cannot be drawn.
pub fn html(needs: &Needs) -> Result<String> {
    let mut sentence = needs.sentence.clone();
    if let Some(first) = sentence.get_mut(..1) {
        first.make_ascii_uppercase();
    }
    let mut body = format!("<h1>{}.</h1>\n{}", escaped(&sentence), facts(needs));
    if !needs.steps.is_empty() {
        let series = [(0, "PSNR"), (1, "SSIM")];
        let figure = page::figure("wide", &losses(needs).svg()?, OF_LOSSES);
        body += &format!("<h2>Loss by splats</h2>\n{}{figure}", legend(series)?);
        body += &format!("<h2>Steps</h2>\n<p>{OF_STEPS}</p>\n{}", steps(needs));
    }
    body += &format!("<h2>Splats by degree</h2>\n{}", degrees(needs));
    Ok(document("splats of the scene", &body))
}

fn facts(needs: &Needs) -> String {
    let settled = |from: u32| format!("after iteration {from}, from which all training views were used");
    let allowed = format!("{} dB, {:.4} SSIM", needs.loss_db, needs.loss_ssim);
    let rows = [
        ("loss allowed", Some(allowed)),
        ("views held out", Some(needs.validation_views.join(", "))),
        ("count decided", needs.settled_from.map(settled)),
    ];
    let rows = rows.into_iter().filter_map(|(name, value)| Some((name.into(), value?)));
    page::facts(&rows.collect::<Vec<_>>())
}

fn losses(needs: &Needs) -> ScatterPlot {
    let marker = |point: &LossPoint, series: usize, loss: Estimate, allowed: f64| Marker {
        series,
        x: point.splats.max(1) as f64,
        y: loss.mean / allowed,
        y_bar: Some([loss.low / allowed, loss.high / allowed]),
        is_default: point.is_removed,
        ..Marker::default()
    };
    let markers = needs.points.iter().flat_map(|point| {
        [
            marker(point, 0, point.loss.held_out.psnr_db, needs.loss_db),
            marker(point, 1, point.loss.held_out.ssim, needs.loss_ssim),
        ]
    });
    let mut markers: Vec<Marker> = markers.filter(|marker| marker.y <= SHOWN).collect();
    markers.sort_by(|a, b| a.x.total_cmp(&b.x));
    ScatterPlot {
        size: [1080, 420],
        titles: ["splats", "loss of held-out views, relative to the allowed one"],
        are_log: [true, false],
        markers,
        levels: vec![("allowed", 1.0)],
        ..ScatterPlot::default()
    }
}

fn steps(needs: &Needs) -> String {
    let head = [
        "iteration",
        "step",
        "splats",
        "PSNR dB",
        "SSIM",
        "left",
        "lost dB",
        "at most dB",
        "lost SSIM",
        "at most SSIM",
        "trained on: lost dB",
        "lost SSIM",
        "decided by",
    ];
    let rows = needs.steps.iter().map(|step| {
        let lost = |value: fn(&QualityLoss) -> f64, digits| decimals(step.loss.as_ref().map(value), digits);
        let cells = vec![
            grouped(step.iteration as usize),
            step.act.clone(),
            grouped(step.splats),
            format!("{:.3}", step.psnr_db),
            format!("{:.4}", step.ssim),
            step.left.map_or("–".into(), grouped),
            lost(|loss| loss.held_out.psnr_db.mean, 3),
            lost(|loss| loss.held_out.psnr_db.high, 3),
            lost(|loss| loss.held_out.ssim.mean, 4),
            lost(|loss| loss.held_out.ssim.high, 4),
            lost(|loss| loss.trained.psnr_db.mean, 3),
            lost(|loss| loss.trained.ssim.mean, 4),
            step.decided_by.map_or("–", decider).into(),
        ];
        (false, cells)
    });
    table("", &head, rows)
}

fn decider(by: (ViewSet, Measure)) -> &'static str {
    match by {
        (ViewSet::HeldOut, Measure::Psnr) => "held-out views, PSNR",
        (ViewSet::HeldOut, Measure::Ssim) => "held-out views, SSIM",
        (ViewSet::Trained, Measure::Psnr) => "views trained on, PSNR",
        (ViewSet::Trained, Measure::Ssim) => "views trained on, SSIM",
    }
}

fn degrees(needs: &Needs) -> String {
    let head = ["degree", "splats", "share", "bytes, each at its own degree"];
    let total = needs.splats_by_degree.iter().sum::<usize>().max(1);
    let rows = (0..4).map(|degree| {
        let count = needs.splats_by_degree[degree];
        let cells = vec![
            degree.to_string(),
            grouped(count),
            format!("{:.1} %", 100.0 * count as f64 / total as f64),
            grouped(needs.bytes_by_degree[degree] as usize),
        ];
        (false, cells)
    });
    table("", &head, rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simplify::{Decision, Estimates};

    fn needs() -> Needs {
        let loss = |mean: f64| QualityLoss {
            held_out: Estimates {
                psnr_db: Estimate {
                    mean,
                    low: mean - 0.02,
                    high: mean + 0.02,
                },
                ..Estimates::default()
            },
            ..QualityLoss::default()
        };
        let step = |iteration: u32, splats: usize, lost: Option<f64>| Decision {
            iteration,
            act: "a < b".into(),
            splats,
            psnr_db: 28.636,
            ssim: 0.875,
            left: lost.map(|_| splats / 2),
            loss: lost.map(loss),
            decided_by: lost.map(|_| (ViewSet::HeldOut, Measure::Psnr)),
        };
        let point = |splats, mean| LossPoint {
            splats,
            is_removed: true,
            loss: loss(mean),
        };
        Needs {
            sentence: "this scene needs at most 5 splats".into(),
            loss_db: 0.1,
            loss_ssim: 0.005,
            splat_count: 5,
            too_few: None,
            splats_by_degree: [2, 1, 1, 1],
            bytes_by_degree: [112, 92, 152, 236],
            settled_from: Some(300),
            validation_views: vec!["<view>".into()],
            steps: vec![step(100, 10_000, None), step(200, 20_000, Some(0.05))],
            points: vec![point(20_000, 0.0), point(10_000, 0.05), point(5_000, 0.5)],
            against: None,
        }
    }

    #[test]
    fn the_page_is_whole_and_escaped() -> Result<()> {
        let page = html(&needs())?;
        assert!(page.contains("<h1>This scene needs at most 5 splats.</h1>"));
        assert_eq!(page.matches("<figure ").count(), 1);
        assert!(page.contains("&lt;view&gt;") && page.contains("a &lt; b"));
        assert!(!page.contains("NaN"));
        assert!(page.contains("<dd>0.1 dB, 0.0050 SSIM</dd>"), "{page}");
        // Every cell has its heading.
        let head = "<th>splats</th><th>PSNR dB</th><th>SSIM</th><th>left</th><th>lost dB</th><th>at most dB</th>";
        assert!(page.contains(head));
        let row = "<td>20,000</td><td>28.636</td><td>0.8750</td><td>10,000</td><td>0.050</td><td>0.070</td>";
        assert!(page.contains(row), "{page}");
        assert!(page.contains("<td>held-out views, PSNR</td>"));
        Ok(())
    }

    #[test]
    fn losses_far_beyond_the_allowed_one_do_not_compress_the_figure() {
        assert_eq!(losses(&needs()).markers.len(), 5);
    }

    #[test]
    fn a_run_without_steps_has_a_page_too() -> Result<()> {
        let empty = Needs {
            steps: Vec::new(),
            ..needs()
        };
        let page = html(&empty)?;
        assert_eq!(page.matches("<svg ").count(), 0);
        Ok(())
    }
}
