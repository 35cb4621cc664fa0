//! The page: the sentence, the curve, where the bytes are, and what every step did. It needs no other file and no script.

use super::curve;
use super::needs::{Needs, grouped};
use crate::Result;
use crate::lab::chart::tables::escaped;
use crate::simplify::HalfResolution;

const STYLE: &str = include_str!("../chart/page.css");

const OF_CURVE: &str = "Blue: while splats were added, with training going on, so that these points rise with time, \
too. Orange: what so many splats are worth, from rounds that took the same steps from the same state with the least \
important splats and without, added up from the last one; the line is the law PSNR = a − b N<sup>−γ</sup> through them. A \
red circle marks its knee, where a tenth more splats is worth just the preference; where it lies beyond the picture it \
stands at the edge.";

const OF_STEPS: &str = "Scores are means over the held-out views, PSNR, 40 dB at most, since what no eye \
tells is worth nothing; those on the right are without the splats or harmonics that went, or \
would have gone, after the same steps, or at once where none were taken. Where they tell enough, nothing was tried with \
all, and 40 dB stand on the left. The gain is that of a tenth more splats and its lower 95 % bound (Student's t over \
the views): while growing, all that the scores have risen counts, so that growth ends too late rather than too soon.";

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
        body += &format!(
            "<h2>Quality over splats</h2>\n<figure class=\"wide\">\n{}<figcaption>{OF_CURVE}</figcaption></figure>\n",
            curve::svg(needs)?
        );
        body += &format!(
            "<h2>What was done</h2>\n<p>{OF_STEPS}</p>\n{}",
            steps(needs)
        );
    }
    body += &format!("<h2>Splats by degree</h2>\n{}", degrees(needs));
    Ok(format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>ashfall: what the scene needs</title>\n<style>\n{STYLE}</style>\n</head>\n\
         <body>\n{body}</body>\n</html>\n"
    ))
}

fn facts(needs: &Needs) -> String {
    let mut rows = vec![
        (
            "smallest gain worth paying for",
            format!("{} dB for a tenth more splats", needs.preference_db),
        ),
        ("views held out", needs.validation_views.join(", ")),
    ];
    if let Some(from) = needs.settled_from {
        let text = format!("after iteration {from}, from which all training views were seen");
        rows.push(("count decided", text));
    }
    if let Some(half) = &needs.half_size {
        rows.push(("photographs of half the size", of_half(half)));
    }
    if let Some(law) = &needs.law {
        let unit = law.factor.powf(1.0 / law.exponent);
        let text = format!(
            "{:.2} − ({} / N)^{:.2} dB",
            law.limit_db,
            grouped(unit.round() as usize),
            law.exponent
        );
        rows.push(("law", text));
    }
    if let Some(knee) = needs.knee {
        rows.push((
            "its knee",
            format!("{} splats", grouped(knee.round() as usize)),
        ));
    }
    let row = |(name, value): &(&str, String)| {
        format!("<dt>{}</dt><dd>{}</dd>\n", escaped(name), escaped(value))
    };
    let rows: String = rows.iter().map(row).collect();
    format!("<dl class=\"facts\">\n{rows}</dl>\n")
}

fn of_half(half: &HalfResolution) -> String {
    let mut text = match half.until {
        0 => "never enough".into(),
        until => format!("enough until iteration {until}"),
    };
    if let Some(share) = half.hidden_share {
        let percent = 100.0 * share;
        text += &format!(", of whose error they made {percent:.0} % at most");
    }
    if let Some(limit) = half.limit_db {
        text += &format!("; {limit:.1} dB is all that they allow");
    }
    text
}

fn table(head: &[&str], rows: impl Iterator<Item = Vec<String>>) -> String {
    let cells = |tag: &str, cells: &[String]| -> String {
        let cell = |text: &String| format!("<{tag}>{}</{tag}>", escaped(text));
        cells.iter().map(cell).collect()
    };
    let head: Vec<String> = head.iter().map(|name| (*name).to_string()).collect();
    let rows: String = rows
        .map(|row| format!("<tr>{}</tr>\n", cells("td", &row)))
        .collect();
    format!(
        "<div class=\"scroll\">\n<table>\n<tr>{}</tr>\n{rows}</table>\n</div>\n",
        cells("th", &head)
    )
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
    let number = |value: Option<f64>, digits: usize| match value {
        Some(value) => format!("{value:.digits$}"),
        None => "–".into(),
    };
    let rows = needs.steps.iter().map(|step| {
        vec![
            grouped(step.iteration as usize),
            step.act.clone(),
            grouped(step.splats),
            format!("{:.3}", step.psnr_db),
            step.without
                .map_or("–".into(), |(splats, _)| grouped(splats)),
            number(step.without.map(|(_, psnr)| psnr), 3),
            number(step.gain_db.map(|gain| gain[0]), 4),
            number(step.gain_db.map(|gain| gain[1]), 4),
        ]
    });
    table(&head, rows)
}

fn degrees(needs: &Needs) -> String {
    let head = ["degree", "splats", "share", "bytes, each at its own degree"];
    let total = needs.splats_by_degree.iter().sum::<usize>().max(1);
    let rows = (0..4).map(|degree| {
        let count = needs.splats_by_degree[degree];
        vec![
            degree.to_string(),
            grouped(count),
            format!("{:.1} %", 100.0 * count as f64 / total as f64),
            grouped(needs.bytes_by_degree[degree] as usize),
        ]
    });
    let table = table(&head, rows);
    let lost = match needs.sh_lost_db {
        Some(lost) => format!(
            "Harmonics went as far as the held-out views did not miss them: they lost {lost:.3} dB, before the rest was fitted again."
        ),
        None => "All harmonics stayed.".into(),
    };
    format!("<p>{lost}</p>\n{table}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simplify::{Decision, Law};

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
    fn the_page_is_whole_and_escapes_what_it_is_given() -> Result<()> {
        let page = html(&needs())?;
        assert!(page.contains("<h1>This scene needs 5 splats.</h1>"));
        assert_eq!(page.matches("<svg ").count(), 1);
        assert!(page.contains("&lt;view&gt;") && page.contains("a &lt; b"));
        assert!(!page.contains("NaN"));
        let half = "iteration 149, of whose error they made 25 % at most; 30.5 dB is all that";
        assert!(page.contains(half));
        // 900^(1 / 0.6) = 83,895, at which one decibel is missing.
        assert!(
            page.contains("<dd>31.00 − (83,895 / N)^0.60 dB</dd>"),
            "{page}"
        );
        // Every cell has its heading.
        let head = "<th>splats</th><th>PSNR dB</th><th>left</th><th>PSNR dB</th>";
        assert!(page.contains(head));
        let row = "<td>20,000</td><td>28.636</td><td>10,000</td><td>28.636</td>";
        assert!(page.contains(row), "{page}");
        Ok(())
    }

    #[test]
    fn a_run_of_which_nothing_is_known_has_a_page_too() -> Result<()> {
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
