//! Page of the stability suite: checks with measurements and bounds, and sweeps as curves and pictures.

use super::curve;
use super::outcome::{CheckGroup, Sense, StressCheck, StressReport, Sweep};
use crate::Result;
use crate::lab::page::{self, document, escaped, number};

/// Introductions of the groups' tables.
const INTRODUCTIONS: [&str; CheckGroup::ALL.len()] = [
    "Operations that every kernel relies on, tested by kernels of their own. Integers must be exact. Functions may \
     have the errors that the Vulkan specification allows, and below the normal numbers of single precision the \
     smallest of those.",
    "Scenes and cameras that leave formulas without a divisor, an order or anything to see, against the \
     <code>f64</code> reference.",
    "A splat with NaN or infinities must not be drawn, and must not change other splats: the picture and the \
     gradients stay the same to the bit. Extreme finite numbers must give finite pictures.",
    "Pictures of every shape, against the <code>f64</code> reference.",
    "One parameter over its whole range. A picture is compared with the <code>f64</code> reference pixel by pixel, \
     each with its own bound: the rounding of <code>f32</code> on the way to each alpha, weighted with the light that \
     gets there, and a splat's whole share where it may have crossed a discontinuity (the cut at 1/255, the stop at \
     1e-4, the near plane, an exchange in depth). The curve shows the pixel that comes closest to its bound.",
    "The gradient of one training step by every parameter, against the exact one. An error counts relatively to the \
     reference, or to 1 % of its parameter group's root mean square where that is more.",
    "The same work again gives the same bits.",
];

/// The page's text.
///
/// # Errors
/// When a figure cannot be drawn.
pub fn html(report: &StressReport) -> Result<String> {
    let mut body = heading(report);
    for (group, introduction) in CheckGroup::ALL.into_iter().zip(INTRODUCTIONS) {
        let outcomes = report.outcomes.iter().filter(|o| o.group == group);
        let outcomes: Vec<&StressCheck> = outcomes.collect();
        let sweeps = report.sweeps.iter().filter(|s| s.group == group);
        if outcomes.is_empty() {
            continue;
        }
        body += &format!("<h2>{}</h2>\n<p>{introduction}</p>\n", group.title());
        body += &table(&outcomes);
        for sweep in sweeps {
            body += &drawn(sweep)?;
        }
    }
    Ok(document("stability", &body))
}

fn heading(report: &StressReport) -> String {
    let text = format!("<h1>Stability</h1>\n{}", page::facts(&report.facts));
    let (failed, count) = (report.failed(), report.outcomes.len());
    let summary = match failed.len() {
        0 => format!("All {count} checks keep their bounds."),
        failed => format!("{failed} of {count} checks failed."),
    };
    let name = |check: &&StressCheck| format!("{}: {}", check.group.title(), check.name);
    let failed: Vec<String> = failed.iter().map(name).collect();
    text + &page::verdict(&summary, &failed)
}

fn table(checks: &[&StressCheck]) -> String {
    let row = |check: &&StressCheck| {
        let sense = match check.sense {
            Sense::AtMost => "≤",
            Sense::AtLeast => "≥",
        };
        let cells = vec![
            check.name.clone(),
            check.what.clone(),
            number(check.measured),
            format!("{sense} {}", number(check.bound)),
            check.unit.to_owned(),
            if check.passed { "pass" } else { "FAIL" }.to_owned(),
        ];
        (!check.passed, cells)
    };
    let head = ["check", "method", "measured", "bound", "unit", ""];
    page::table("checks", &head, checks.iter().map(row))
}

/// The curve, then the pictures.
fn drawn(sweep: &Sweep) -> Result<String> {
    let title = escaped(sweep.title);
    let mut text = format!("<section class=\"sweep\">\n<h3>{title}</h3>\n");
    text += &format!("<p>{}</p>\n", escaped(sweep.caption));
    text += "<div class=\"both\">\n";
    if !sweep.points.is_empty() {
        let caption = "<span class=\"measured\">measured</span> <span class=\"bound\">bound</span>";
        text += &page::figure("half", &curve::svg(sweep)?, caption);
    }
    if !sweep.thumbnails.is_empty() {
        text += "<div class=\"thumbnails\">\n";
        for thumbnail in &sweep.thumbnails {
            let label = escaped(&thumbnail.label);
            let [width, height] = enlarged(thumbnail.size);
            // Least width for the caption.
            let whole = width.max(60);
            text += &format!(
                "<figure style=\"width: {whole}px\"><img src=\"{}\" alt=\"{title}: {label}\" width=\"{width}\" \
                 height=\"{height}\"><figcaption>{label}</figcaption></figure>\n",
                thumbnail.address()?
            );
        }
        text += "</div>\n";
    }
    Ok(text + "</div>\n</section>\n")
}

/// Displayed size; very small pictures are enlarged.
fn enlarged(size: [u32; 2]) -> [u32; 2] {
    let scale = match size[0].max(size[1]) {
        0..=24 => 4,
        25..=48 => 2,
        _ => 1,
    };
    size.map(|side| side * scale)
}

#[cfg(test)]
mod tests {
    use super::super::outcome::tests::sweep;
    use super::*;
    use crate::lab::page::tests::is_alone;

    fn stress(measured: f64) -> StressReport {
        let sweep = sweep(&[[1.0, 1e-6, 1e-4], [10.0, measured, 1e-4]]);
        StressReport {
            facts: vec![("scene".into(), "a<b".into())],
            outcomes: vec![
                StressCheck::at_most(CheckGroup::Device, "atomics", "x", [0.0, 0.0], "wrong counts"),
                sweep.outcome("of the colour range"),
            ],
            sweeps: vec![sweep],
        }
    }

    #[test]
    fn the_page_holds_all_and_needs_nothing_else() -> Result<()> {
        let page = html(&stress(1e-5))?;
        assert!(page.contains("All 2 checks keep their bounds."));
        assert!(page.contains("a&lt;b") && page.contains("thin &amp; thinner"));
        assert_eq!(page.matches("<svg ").count(), 1);
        assert!(is_alone(&page) && !page.contains("FAIL"));
        Ok(())
    }

    #[test]
    fn a_failure_is_shown_as_such() -> Result<()> {
        for measured in [2e-4, f64::NAN] {
            let page = html(&stress(measured))?;
            assert!(page.contains("1 of 2 checks failed") && page.contains("FAIL"));
            assert!(page.contains("<tr class=\"broken\">") && page.contains("#C80000"));
        }
        Ok(())
    }
}
