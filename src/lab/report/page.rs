//! Page of a run that chose its splat count: curve, steps, and bytes by SH degree.

use super::curve;
use super::needs::Needs;
use crate::Result;
use crate::lab::page::{self, decimals, document, escaped, grouped, table};
use crate::simplify::{HalfResolution, Law};

const OF_CURVE: &str = "Blue: quality while splats were added, with training going on, so that these points also \
rise with time. Orange: quality by splat count alone, from rounds that took the same steps from the same state \
with and without the least important splats, added up from the last round; the line is the law PSNR = a − b \
N<sup>−γ</sup> fitted to them. A red circle marks its knee, where a tenth more splats gains just the preference; a \
knee outside the figure stands at its edge.";

const OF_STEPS: &str = "Scores are mean PSNR over the held-out views, 40 dB at most; those on the right are \
without the removed or tested splats or harmonics, after the same steps, or at once where none were taken. 40 dB \
on the left stand for a step that was decided without training with all splats. The gain is that of a tenth more \
splats and its lower 95 % bound (Student's t over the views); while growing, it includes the gain of training \
time, so that growth ends too late rather than too soon.";

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
        body += "<h2>Quality over splats</h2>\n";
        body += &page::figure("wide", &curve::svg(needs)?, OF_CURVE);
        body += &format!("<h2>Steps</h2>\n<p>{OF_STEPS}</p>\n{}", steps(needs));
    }
    body += &format!("<h2>Splats by degree</h2>\n{}", degrees(needs));
    Ok(document("splats of the scene", &body))
}

fn facts(needs: &Needs) -> String {
    let settled = |from: u32| format!("after iteration {from}, from which all training views were used");
    let of_law = |law: &Law| {
        let unit = grouped(law.factor.powf(1.0 / law.exponent).round() as usize);
        format!("{:.2} − ({unit} / N)^{:.2} dB", law.limit_db, law.exponent)
    };
    let rows = [
        (
            "smallest gain worth paying for",
            Some(format!("{} dB for a tenth more splats", needs.preference_db)),
        ),
        ("views held out", Some(needs.validation_views.join(", "))),
        ("count decided", needs.settled_from.map(settled)),
        ("photographs of half the size", needs.half_size.as_ref().map(of_half)),
        ("law", needs.law.as_ref().map(of_law)),
        (
            "its knee",
            needs
                .knee
                .map(|knee| format!("{} splats", grouped(knee.round() as usize))),
        ),
    ];
    let rows = rows.into_iter().filter_map(|(name, value)| Some((name.into(), value?)));
    page::facts(&rows.collect::<Vec<_>>())
}

fn of_half(half: &HalfResolution) -> String {
    let mut text = match half.until {
        0 => "never enough".into(),
        until => format!("enough until iteration {until}"),
    };
    if let Some(share) = half.hidden_share {
        let percent = 100.0 * share;
        text += &format!(", at most {percent:.0} % of whose error they caused");
    }
    if let Some(limit) = half.limit_db {
        text += &format!("; they allow {limit:.1} dB at most");
    }
    text
}

fn steps(needs: &Needs) -> String {
    let head = [
        "iteration",
        "step",
        "splats",
        "PSNR dB",
        "left",
        "PSNR dB",
        "gain dB",
        "at least dB",
    ];
    let rows = needs.steps.iter().map(|step| {
        let cells = vec![
            grouped(step.iteration as usize),
            step.act.clone(),
            grouped(step.splats),
            format!("{:.3}", step.psnr_db),
            step.without.map_or("–".into(), |(splats, _)| grouped(splats)),
            decimals(step.without.map(|(_, psnr)| psnr), 3),
            decimals(step.gain_db.map(|gain| gain[0]), 4),
            decimals(step.gain_db.map(|gain| gain[1]), 4),
        ];
        (false, cells)
    });
    table("", &head, rows)
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
    let table = table("", &head, rows);
    let lost = match needs.sh_lost_db {
        Some(lost) => {
            format!("The held-out views lost {lost:.3} dB by the harmonics that were removed, before the last fit.")
        }
        None => "All harmonics were kept.".into(),
    };
    format!("<p>{lost}</p>\n{table}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simplify::Decision;

    fn needs() -> Needs {
        let step = |iteration: u32, splats: usize, psnr_db: f64| Decision {
            iteration,
            act: "a < b".into(),
            splats,
            psnr_db,
            without: (iteration > 100).then_some((splats / 2, psnr_db)),
            gain_db: Some([0.1, 0.05]),
        };
        let law = Law {
            limit_db: 31.0,
            factor: 900.0,
            exponent: 0.6,
        };
        Needs {
            sentence: "this scene needs 5 splats".into(),
            preference_db: 0.02,
            splat_count: 5,
            splats_by_degree: [2, 1, 1, 1],
            bytes_by_degree: [112, 92, 152, 236],
            sh_lost_db: Some(0.01),
            settled_from: Some(300),
            half_size: Some(HalfResolution {
                until: 149,
                limit_db: Some(30.5),
                hidden_share: Some(0.25),
            }),
            validation_views: vec!["<view>".into()],
            law: Some(law),
            knee: Some(law.knee(0.02)),
            steps: vec![step(100, 10_000, 20.0), step(200, 20_000, law.at(2e4))],
            points: vec![[2e4, law.at(2e4)], [1e4, law.at(1e4)]],
            against: None,
        }
    }

    #[test]
    fn the_page_is_whole_and_escaped() -> Result<()> {
        let page = html(&needs())?;
        assert!(page.contains("<h1>This scene needs 5 splats.</h1>"));
        assert_eq!(page.matches("<svg ").count(), 1);
        assert!(page.contains("&lt;view&gt;") && page.contains("a &lt; b"));
        assert!(!page.contains("NaN"));
        let half = "iteration 149, at most 25 % of whose error they caused; they allow 30.5 dB";
        assert!(page.contains(half));
        // 900^(1 / 0.6) = 83,895, the count one decibel below the limit.
        assert!(page.contains("<dd>31.00 − (83,895 / N)^0.60 dB</dd>"), "{page}");
        // Every cell has its heading.
        let head = "<th>splats</th><th>PSNR dB</th><th>left</th><th>PSNR dB</th>";
        assert!(page.contains(head));
        let row = "<td>20,000</td><td>28.636</td><td>10,000</td><td>28.636</td>";
        assert!(page.contains(row), "{page}");
        Ok(())
    }

    #[test]
    fn a_run_without_steps_has_a_page_too() -> Result<()> {
        let empty = Needs {
            steps: Vec::new(),
            law: None,
            knee: None,
            ..needs()
        };
        let page = html(&empty)?;
        assert_eq!(page.matches("<svg ").count(), 0);
        Ok(())
    }
}
