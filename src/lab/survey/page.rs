//! Page of a survey: a table of all scenes and recipes, and a figure of quality over splats for each scene.

use super::{Recipe, SurveyRun, mean, paired_difference, scenes, sensitivity};
use crate::Result;
use crate::lab::page::scatter::{Marker, ScatterPlot};
use crate::lab::page::{self, Fact, document, escaped, figure, interval, legend, table};
use crate::simplify::loss_at;
use crate::stats::Interval;

const OF_TABLE: &str = "Every scene is trained on the same photographs for the same number of steps by each \
recipe, from several seeds: the fixed recipe (adaptive density control with its usual constants), \
<em>parsimony</em> (as few splats as held-out training views allow), and MCMC limited to the \
splats that parsimony ended with. <em>Same rates</em> stands for the learning rates of parsimony. Values are means \
over seeds, ± half their 95 % interval (Student’s t). PSNR and SSIM are those of test views, which no decision has \
used, and beside them of the views trained on. <em>Parsimony to it</em> is parsimony’s test views less the row’s, \
paired by seed. <em>A third</em> is the loss of held-out training views with a third of the row’s splats, where parsimony took \
more and its rounds measured so few. SH floats count each splat at its own degree. Times of frames are the device’s.";

/// Title, value and decimals of a column.
type Column = (&'static str, fn(&SurveyRun) -> Option<f64>, usize);

const COLUMNS: [Column; 11] = [
    ("splats", |run| Some(run.splats as f64), 0),
    ("PSNR, dB", |run| run.psnr_db, 2),
    ("SSIM", |run| run.ssim, 4),
    ("training PSNR, dB", |run| run.train_psnr_db, 2),
    ("training SSIM", |run| run.train_ssim, 4),
    ("SH floats, %", |run| Some(100.0 * run.sh_share()), 0),
    ("file, MB", |run| Some(1e-6 * run.ply_bytes as f64), 2),
    ("device, MB", |run| Some(1e-6 * run.device_bytes() as f64), 2),
    ("frame, ms", |run| Some(run.frame_ms), 2),
    ("training, s", |run| Some(run.train_seconds), 1),
    ("training, CPU s", |run| run.cpu_seconds, 1),
];

/// The page's text.
///
/// # Errors
/// Those of drawing a figure.
pub fn html(facts: &[Fact], runs: &[SurveyRun]) -> Result<String> {
    let mut body = format!("<h1>Splat counts by recipe</h1>\n{}", page::facts(facts));
    let sensitivity = sensitivity::html(runs);
    let runs: Vec<SurveyRun> = runs.iter().filter(|run| run.setting.is_empty()).cloned().collect();
    let runs = runs.as_slice();
    if !runs.is_empty() {
        body += &format!("<p>{OF_TABLE}</p>\n{}", results(runs));
        let used = |recipe: &Recipe| runs.iter().any(|run| run.recipe == *recipe);
        let recipes = Recipe::ALL.into_iter().filter(used);
        body += "<h2>Quality over splats</h2>\n<p>A mark for each run.</p>\n";
        body += &legend(recipes.map(|recipe| (recipe as usize, recipe.title())))?;
        body += "<div class=\"figures\">\n";
        for scene in scenes(runs) {
            let figure = figure("half", &plot(runs, scene).svg()?, "");
            let title = escaped(scene);
            body += &format!("<section class=\"scene\">\n<h3>{title}</h3>\n{figure}</section>\n");
        }
        body += "</div>\n";
    }
    body += &sensitivity;
    Ok(document("splat counts by recipe", &body))
}

fn results(runs: &[SurveyRun]) -> String {
    let mut head = vec!["scene", "recipe", "runs"];
    head.extend(COLUMNS.map(|(title, ..)| title));
    head.extend([
        "parsimony to it, dB",
        "parsimony to it, SSIM",
        "a third, dB",
        "a third, SSIM",
    ]);
    let mut rows = Vec::new();
    for scene in scenes(runs) {
        for recipe in Recipe::ALL {
            let of = |recipe| -> Vec<&SurveyRun> {
                let mine = runs.iter().filter(|run| run.scene == scene && run.recipe == recipe);
                mine.collect()
            };
            let mine = of(recipe);
            if mine.is_empty() {
                continue;
            }
            let text = |found: Option<_>, digits| found.map_or("–".into(), |found| interval(&found, digits));
            let mut cells = vec![scene.into(), recipe.title().into(), mine.len().to_string()];
            cells.extend(COLUMNS.map(|(_, value, digits)| text(mean(&mine, value), digits)));
            let parsimony = of(Recipe::Parsimony);
            let difference = |value, digits| match recipe {
                Recipe::Parsimony => String::new(),
                _ => text(paired_difference(&parsimony, &mine, value), digits),
            };
            cells.extend([difference(|run| run.psnr_db, 2), difference(|run| run.ssim, 4)]);
            let thirds = [0, 1].map(|measure| text(third(&parsimony, &mine, measure), 2 + 2 * measure));
            cells.extend(thirds);
            rows.push((false, cells));
        }
    }
    table("", &head, rows)
}

/// Loss of held-out views in a measure, PSNR or SSIM, with a third of the splats of `others`, by the rounds of
/// `parsimony` runs of the same seeds that took more.
fn third(parsimony: &[&SurveyRun], others: &[&SurveyRun], measure: usize) -> Option<Interval> {
    let lost = |run: &&SurveyRun| {
        let third = others.iter().find(|other| other.seed == run.seed)?.splats as f64 / 3.0;
        let found = loss_at(&run.points(), third).filter(|_| run.splats as f64 > third)?;
        Some(found[measure])
    };
    let lost: Vec<f64> = parsimony.iter().filter_map(lost).collect();
    (!lost.is_empty()).then(|| Interval::of_mean(&lost))
}

fn plot(runs: &[SurveyRun], scene: &str) -> ScatterPlot {
    let runs = runs.iter().filter(|run| run.scene == scene);
    let marker = |run: &SurveyRun| {
        Some(Marker {
            series: run.recipe as usize,
            x: run.splats.max(1) as f64,
            y: run.psnr_db?,
            ..Marker::default()
        })
    };
    ScatterPlot {
        size: [532, 390],
        titles: ["splats", "PSNR of test views, dB"],
        are_log: [true, false],
        markers: runs.filter_map(marker).collect(),
        ..ScatterPlot::default()
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{run, survey};
    use super::*;

    #[test]
    fn the_page_has_a_row_for_each_recipe_and_a_figure_for_each_scene() -> Result<()> {
        let facts = [("device".into(), "x<y".into())];
        let page = html(&facts, &survey())?;
        assert_eq!(page.matches("<figure ").count(), 2);
        assert_eq!(page.matches("<table").count(), 1);
        assert!(page.contains("<h3>a&lt;b</h3>") && page.contains("<h3>rich</h3>"));
        assert!(page.contains("x&lt;y") && !page.contains("a<b") && !page.contains("NaN"));
        // Three recipes in the legend, and for each scene in the table.
        assert_eq!(page.matches("<li><svg").count(), 3);
        assert_eq!(page.matches("<td>parsimony</td><td>2</td>").count(), 2);
        // Seeds drift together: the paired difference is more precise than either mean.
        assert!(page.contains("<td>0.10") && page.contains("<td>0.0010"), "{page}");
        assert!(page.contains("<td>32.60 ± 6.35</td>"), "{page}");
        assert!(page.contains("<td>30.60 ± 6.35</td>"), "{page}");
        Ok(())
    }

    #[test]
    fn a_third_is_priced_by_the_rounds_where_parsimony_took_more() {
        let parsimony = SurveyRun {
            point_splats: vec![400.0, 100.0],
            point_lost_db: vec![0.0, 0.5],
            point_lost_ssim: vec![0.0, 0.02],
            ..run("a", Recipe::Parsimony, 1, 250, 30.0)
        };
        let fixed = |splats| run("a", Recipe::Fixed, 1, splats, 30.0);
        let lost = |splats, measure| third(&[&parsimony], &[&fixed(splats)], measure).map(|found| found.value);
        assert!(lost(600, 0).is_some_and(|lost| (lost - 0.25).abs() < 1e-12));
        assert!(lost(600, 1).is_some_and(|lost| (lost - 0.01).abs() < 1e-12));
        assert_eq!([lost(900, 0), lost(240, 0)], [None; 2]);
    }

    #[test]
    fn missing_values_are_dashes() -> Result<()> {
        assert!(!html(&[], &[])?.contains("<figure"));
        let single = SurveyRun {
            psnr_db: None,
            ..run("one", Recipe::Mcmc, 0, 0, 30.0)
        };
        let page = html(&[], &[single])?;
        assert!(page.contains("<figure ") && page.contains("<td>–</td>") && !page.contains("NaN"));
        Ok(())
    }
}
