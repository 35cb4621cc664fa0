//! The page: what was tried, what came out and what was allowed, and the sweeps as pictures. It needs no other file
//! and no script.

use super::curve;
use super::outcome::{Group, Outcome, Sense, Stress, Sweep};
use crate::Result;
use crate::lab::chart::tables::escaped;

/// The look that all pages share, and what is this one's own.
const STYLE: [&str; 2] = [include_str!("../chart/page.css"), include_str!("page.css")];

/// What to know of a group before its table.
fn introduction(group: Group) -> &'static str {
    match group {
        Group::Device => {
            "What every kernel relies on, asked of the device by kernels that do nothing else. Integers must be exact. \
             Functions may be off by what the Vulkan specification allows, and where single precision has no normal \
             numbers, by the least of those."
        }
        Group::Scenes => {
            "Scenes and cameras that leave formulas without a divisor, an order or anything to see, against the \
             <code>f64</code> reference."
        }
        Group::Poison => {
            "A splat with a number that is none must not be drawn, and no other splat may notice it: the picture and \
             the gradients stay the same to the bit. Finite numbers, however extreme, must give finite pictures."
        }
        Group::Sizes => "Pictures of every shape, against the <code>f64</code> reference.",
        Group::Sweeps => {
            "One parameter over its whole range. A picture is compared with the <code>f64</code> reference pixel by \
             pixel, each with its own bound: the rounding of <code>f32</code> on the way to each alpha, weighted with \
             the light that gets there, and a splat's whole share where it may have crossed a discontinuity (the cut \
             at 1/255, the stop at 1e-4, the near plane, an exchange in depth). The curve shows the pixel that comes \
             closest to its bound."
        }
        Group::Gradients => {
            "The gradient of one training step by every parameter, against the exact one. An error counts relatively \
             to the reference, or to 1 % of its parameter group's root mean square where that is more."
        }
        Group::Determinism => "The same work again gives the same bits.",
    }
}

/// The page's text.
///
/// # Errors
/// When a figure cannot be drawn.
pub fn html(stress: &Stress) -> Result<String> {
    let mut body = heading(stress);
    for group in Group::ALL {
        let outcomes = stress.outcomes.iter().filter(|o| o.group == group);
        let outcomes: Vec<&Outcome> = outcomes.collect();
        let sweeps = stress.sweeps.iter().filter(|s| s.group == group);
        if outcomes.is_empty() {
            continue;
        }
        body += &format!(
            "<h2>{}</h2>\n<p>{}</p>\n",
            group.title(),
            introduction(group)
        );
        body += &table(&outcomes);
        for sweep in sweeps {
            body += &drawn(sweep)?;
        }
    }
    Ok(format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>ashfall: stability</title>\n<style>\n{}{}</style>\n</head>\n\
         <body>\n{body}</body>\n</html>\n",
        STYLE[0], STYLE[1]
    ))
}

fn heading(stress: &Stress) -> String {
    let mut text = String::from("<h1>Stability</h1>\n<dl class=\"facts\">\n");
    for (name, value) in &stress.facts {
        text += &format!("<dt>{}</dt><dd>{}</dd>\n", escaped(name), escaped(value));
    }
    text += "</dl>\n";
    let (failed, count) = (stress.failed(), stress.outcomes.len());
    match failed.is_empty() {
        true => {
            text += &format!("<p class=\"verdict\">All {count} checks keep their bounds.</p>\n");
        }
        false => {
            let name = |o: &&Outcome| format!("<br>{}: {}", o.group.title(), escaped(&o.name));
            let names: String = failed.iter().map(name).collect();
            text += &format!(
                "<p class=\"verdict broken\"><strong>{} of {count} checks failed.</strong>{names}</p>\n",
                failed.len()
            );
        }
    }
    text
}

/// A number in as many digits as it deserves.
pub fn number(value: f64) -> String {
    let size = value.abs();
    match value.fract() == 0.0 {
        _ if !size.is_finite() => "none".into(),
        true if size < 1e6 => grouped(value),
        false if size >= 100.0 => format!("{value:.0}"),
        false if size >= 0.01 => {
            let text = format!("{value:.3}");
            text.trim_end_matches('0').to_owned()
        }
        _ => format!("{value:.1e}"),
    }
}

/// The same where space is scarce.
pub fn short(value: f64) -> String {
    number(value).replace(".0e", "e")
}

/// A whole number below a million, with a separator.
fn grouped(value: f64) -> String {
    match value.abs() < 1e4 {
        true => format!("{value}"),
        false => format!("{},{:03}", (value / 1e3).trunc(), (value % 1e3).abs()),
    }
}

fn table(outcomes: &[&Outcome]) -> String {
    let mut text = String::from(
        "<table class=\"checks\">\n<tr><th>check</th><th>how</th><th>measured</th><th>bound</th><th>unit</th>\
         <th></th></tr>\n",
    );
    for outcome in outcomes {
        let (class, verdict) = match outcome.passed {
            true => ("", "<span class=\"pass\">pass</span>"),
            false => (" class=\"broken\"", "FAIL"),
        };
        let sense = match outcome.sense {
            Sense::AtMost => "≤",
            Sense::AtLeast => "≥",
        };
        text += &format!(
            "<tr{class}><td>{}</td><td>{}</td><td>{}</td><td>{sense} {}</td><td>{}</td><td>{verdict}</td></tr>\n",
            escaped(&outcome.name),
            escaped(&outcome.what),
            number(outcome.measured),
            number(outcome.bound),
            escaped(outcome.unit),
        );
    }
    text + "</table>\n"
}

/// The curve, then the pictures.
fn drawn(sweep: &Sweep) -> Result<String> {
    let title = escaped(&sweep.title);
    let mut text = format!("<section class=\"sweep\">\n<h3>{title}</h3>\n");
    text += &format!("<p>{}</p>\n", escaped(&sweep.caption));
    text += "<div class=\"both\">\n";
    if !sweep.points.is_empty() {
        text += &format!(
            "<figure class=\"half\">\n{}<figcaption><span class=\"measured\">measured</span> \
             <span class=\"bound\">bound</span></figcaption>\n</figure>\n",
            curve::svg(sweep)?
        );
    }
    if !sweep.stills.is_empty() {
        text += "<div class=\"stills\">\n";
        for still in &sweep.stills {
            let label = escaped(&still.label);
            let shown = enlarged(still.size);
            // What stands under it needs some room.
            let width = shown[0].max(60);
            text += &format!(
                "<figure style=\"width: {width}px\"><img src=\"{}\" alt=\"{title}: {label}\" width=\"{}\" \
                 height=\"{}\"><figcaption>{label}</figcaption></figure>\n",
                still.address()?,
                shown[0],
                shown[1],
            );
        }
        text += "</div>\n";
    }
    Ok(text + "</div>\n</section>\n")
}

/// Very small pictures are enlarged, so that they are seen at all.
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

    fn stress(measured: f64) -> Stress {
        let sweep = sweep(&[[1.0, 1e-6, 1e-4], [10.0, measured, 1e-4]]);
        Stress {
            facts: vec![("scene".into(), "a<b".into())],
            outcomes: vec![
                Outcome::at_most(Group::Device, "atomics", "x", [0.0, 0.0], "wrong counts"),
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
        for (at, _) in page.match_indices("http") {
            assert!(page[at..].starts_with("http://www.w3.org/"));
        }
        for (at, _) in page.match_indices(" src=") {
            assert!(page[at..].starts_with(" src=\"data:image/png;base64,"));
        }
        assert!(!page.contains("<script") && !page.contains("FAIL"));
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

    #[test]
    fn numbers_have_as_many_digits_as_they_deserve() {
        assert_eq!(number(0.0), "0");
        assert_eq!(number(65_535.0), "65,535");
        assert_eq!(number(4_194_304.0), "4.2e6");
        assert_eq!([0.5, 1.25, 123.4].map(number), ["0.5", "1.25", "123"]);
        assert_eq!(
            [3e-7, 2.5e-4, 1e6].map(number),
            ["3.0e-7", "2.5e-4", "1.0e6"]
        );
        assert_eq!([1e6, 0.03, 2.5e-4].map(short), ["1e6", "0.03", "2.5e-4"]);
        assert_eq!(number(f64::NAN), "none");
    }
}
