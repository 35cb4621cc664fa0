//! The page: what every scene needs and what that is worth, scene by scene, and the numbers. It needs no other file and no
//! script.

use super::{Recipe, Survey, panel, tables};
use crate::Result;
use crate::lab::chart::figure::glyph;
use crate::lab::chart::tables::escaped;
use crate::lab::report::needs::{Against, sentence};

/// The look that all pages share, and what is this one's own.
const STYLE: [&str; 2] = [include_str!("../chart/page.css"), include_str!("page.css")];

const OF_FIGURES: &str = "Every scene is trained on the same photographs for as many steps by each recipe, from several \
seeds: the fixed recipe (adaptive density control with its usual constants), <em>parsimony</em> (splats for as long as a \
tenth more is worth the preference on held-out training views, and then no more than those miss), and MCMC allowed as many \
splats as parsimony ended with. <em>Same rates</em> stands for the same at the learning rates that parsimony has: what \
rates do is no merit of pruning. Percentages are of the fixed recipe’s. Differences and ratios are means over pairs of one \
seed, ± half their 95 % interval (Student’s t); decibels are those of test views, which no decision has seen. Red: the aim \
is missed.";

const OF_MEASURES: &str = "SH floats are those of harmonics, each splat at its own degree; the <em>others’ worth</em> is by \
how much the same run that keeps them all (<em>all harmonics</em>) is better; where all go before any splats do, the two end \
with other counts. The count by seed is half its range over the middle. Times of frames are the device’s, of training those \
of the processor, with all that is done between steps.";

const OF_PANELS: &str = "Marks are runs, one for each seed. The line is the law that a run found on its way on held-out \
training views, through what its rounds measured (dots), moved to its mark, since other views have other decibels; a red \
ring is the law’s knee, where a tenth more splats is worth just the preference, unless it is far from all that was measured.";

/// The page's text.
///
/// # Errors
/// When a figure cannot be drawn.
pub fn html(survey: &Survey) -> Result<String> {
    let mut body = String::from("<h1>No more than a scene needs</h1>\n<dl class=\"facts\">\n");
    for (name, value) in &survey.facts {
        body += &format!("<dt>{}</dt><dd>{}</dd>\n", escaped(name), escaped(value));
    }
    body += "</dl>\n";
    if !survey.runs.is_empty() {
        body += &format!(
            "<h2>Against the fixed recipe and MCMC</h2>\n<p>{OF_FIGURES}</p>\n\
             <div class=\"scroll\">\n{}</div>\n<p>{OF_MEASURES}</p>\n{}",
            tables::of_scenes(survey),
            tables::of_intricacy(survey)
        );
        body += &format!(
            "<h2>Quality over splats</h2>\n<p>{OF_PANELS}</p>\n{}<div class=\"figures\">\n",
            legend(survey)?
        );
        for scene in survey.scenes() {
            body += &section(survey, scene)?;
        }
        body += &format!(
            "</div>\n<h2>Every run</h2>\n<div class=\"scroll\">\n{}</div>\n",
            tables::of_runs(survey)
        );
    }
    Ok(format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>ashfall: no more than a scene needs</title>\n<style>\n{}{}</style>\n</head>\n\
         <body>\n{body}</body>\n</html>\n",
        STYLE[0], STYLE[1]
    ))
}

/// The signs of the recipes that were run.
fn legend(survey: &Survey) -> Result<String> {
    let mut text = String::from("<ul class=\"legend\">\n");
    for recipe in Recipe::ALL {
        if survey.runs.iter().any(|run| run.recipe == recipe) {
            let sign = glyph(panel::series(recipe))?;
            text += &format!("<li>{sign}{}</li>\n", recipe.title());
        }
    }
    Ok(text + "</ul>\n")
}

/// A scene: its name, the sentence to quote, the figure.
fn section(survey: &Survey, scene: &str) -> Result<String> {
    let told = quoted(survey, scene).map_or(String::new(), |mut told| {
        if let Some(first) = told.get_mut(..1) {
            first.make_ascii_uppercase();
        }
        format!("<p>{}.</p>\n", escaped(&told))
    });
    Ok(format!(
        "<section class=\"scene\">\n<h3>{}</h3>\n{told}<figure class=\"half\">\n{}</figure>\n</section>\n",
        escaped(scene),
        panel::svg(survey, scene)?
    ))
}

/// The sentence to quote of a scene, of means over its seeds; `None` where no run has looked for its needs.
pub fn quoted(survey: &Survey, scene: &str) -> Option<String> {
    let degrees = [0, 1, 2, 3].map(|degree| {
        let counts = survey.of(scene, Recipe::Parsimony);
        let counts: Vec<usize> = counts
            .map(|run| run.splats_by_degree.get(degree).copied().unwrap_or(0))
            .collect();
        let sum: usize = counts.iter().sum();
        (sum as f64 / counts.len().max(1) as f64).round() as usize
    });
    survey.of(scene, Recipe::Parsimony).next()?;
    let fixed = survey.mean(scene, Recipe::Fixed, |run| Some(run.splats as f64));
    let better = survey.change(scene, [Recipe::Fixed, Recipe::Parsimony], |run| run.psnr_db);
    let against = fixed.zip(better).map(|(splats, better)| Against {
        splat_count: splats.value.round() as usize,
        better_db: better.value,
    });
    Some(sentence(degrees, against.as_ref()))
}

#[cfg(test)]
mod tests {
    use super::super::Run;
    use super::super::tests::{run, survey};
    use super::*;

    #[test]
    fn the_page_has_every_scene_and_needs_nothing_else() -> Result<()> {
        let page = html(&survey())?;
        assert_eq!(page.matches("<figure ").count(), 2);
        assert!(page.contains("<h3>a&lt;b</h3>") && page.contains("<h3>rich</h3>"));
        assert!(page.contains("x&lt;y") && !page.contains("a<b") && !page.contains("NaN"));
        // Three recipes in the legend, twelve runs in the last table.
        assert_eq!(page.matches("<li><svg").count(), 3);
        assert_eq!(page.matches("<td>parsimony</td>").count(), 4);
        for (at, _) in page.match_indices("http") {
            assert!(page[at..].starts_with("http://www.w3.org/"));
        }
        assert!(!page.contains("<script") && !page.contains(" src="));
        Ok(())
    }

    #[test]
    fn what_misses_its_aim_is_red() -> Result<()> {
        let mut survey = survey();
        let missed = |survey: &Survey| {
            Ok::<_, crate::Error>(html(survey)?.matches("class=\"missed\"").count())
        };
        // Decibels over MCMC, of both scenes.
        assert_eq!(missed(&survey)?, 2);
        survey.runs.push(Run {
            sh_floats: 48 * 100,
            ..run("a<b", Recipe::Parsimony, 5, 100, 30.0)
        });
        survey.runs.push(Run {
            sh_floats: 48 * 100,
            ..run("a<b", Recipe::Parsimony, 6, 100, 30.0)
        });
        assert_eq!(missed(&survey)?, 3);
        Ok(())
    }

    #[test]
    fn the_sentence_is_of_means_over_seeds() {
        let told = quoted(&survey(), "a<b");
        let wanted = "this scene needs 105 splats, 100 % at degree 0; the fixed recipe used 400 for 0.10 dB less";
        assert_eq!(told.as_deref(), Some(wanted));
        assert_eq!(quoted(&survey(), "none"), None);
    }

    #[test]
    fn a_survey_without_runs_or_with_one_is_a_page_too() -> Result<()> {
        assert!(!html(&Survey::default())?.contains("<figure"));
        let single = Survey {
            runs: vec![Run {
                psnr_db: None,
                ..run("one", Recipe::Mcmc, 0, 0, 30.0)
            }],
            ..Survey::default()
        };
        let page = html(&single)?;
        assert!(page.contains("<figure ") && !page.contains("NaN"));
        Ok(())
    }
}
