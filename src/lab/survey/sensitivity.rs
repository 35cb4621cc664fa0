//! Constants of parsimony at other values: effect on each scene, and the choice of each constant with one scene left
//! out.

use super::{Recipe, SurveyRun, scenes};
use crate::lab::page::{distinct, table};
use crate::stats::mean;
use crate::train::config::AutoConfig;

const OF_EFFECTS: &str = "Each row is a run of parsimony with one constant at another value, less the run with its usual \
value: PSNR and SSIM of test views, and splats in percent, means over seeds. Scores count up to those without visible \
error. The <em>score</em> of a value is the smaller one of its gains in PSNR and in SSIM, less the allowed loss for each \
doubling of the splats, in decibels.";

const OF_CHOICES: &str = "For each scene, each constant takes the value with the best mean score on the other scenes; \
beside it, the score of this value on the scene itself. The usual values have score 0.";

/// A run with one constant at another value, against the run with its usual value.
struct Effect<'a> {
    scene: &'a str,
    setting: &'a str,
    psnr_db: f64,
    ssim: f64,
    /// Splats relative to the other run.
    ratio: f64,
    score: f64,
}

impl<'a> Effect<'a> {
    fn of(run: &'a SurveyRun, usual: &SurveyRun) -> Option<Effect<'a>> {
        let config = AutoConfig::default();
        let capped = |value: Option<f64>, full: f64| value.map(|value| value.min(full));
        let difference = |value: fn(&SurveyRun) -> Option<f64>, full| {
            let (run, usual) = (capped(value(run), full), capped(value(usual), full));
            Some(run? - usual?)
        };
        let psnr_db = difference(|run| run.psnr_db, config.full_db)?;
        let ssim = difference(|run| run.ssim, config.full_ssim())?;
        let ratio = run.splats.max(1) as f64 / usual.splats.max(1) as f64;
        Some(Effect {
            scene: &run.scene,
            setting: &run.setting,
            psnr_db,
            ssim,
            ratio,
            score: psnr_db.min(ssim / config.ssim_per_db) - usual.loss_db * ratio.log2(),
        })
    }

    /// Name of the constant.
    fn name(&self) -> &'a str {
        self.setting.split('=').next().unwrap_or_default()
    }
}

/// Effects of all runs with a setting that have a run without it.
fn effects<'a>(runs: &'a [SurveyRun]) -> Vec<Effect<'a>> {
    let varied = runs.iter().filter(|run| !run.setting.is_empty());
    let effect = |run: &'a SurveyRun| {
        let usual = (run.scene.as_str(), Recipe::Parsimony, run.seed, "");
        Effect::of(run, runs.iter().find(|other| other.key() == usual)?)
    };
    varied.filter_map(effect).collect()
}

/// Mean of a value over the effects of a setting in scenes that `holds`; `None` without any.
fn mean_of(
    effects: &[Effect<'_>],
    setting: &str,
    holds: impl Fn(&str) -> bool,
    value: fn(&Effect<'_>) -> f64,
) -> Option<f64> {
    let of = effects
        .iter()
        .filter(|effect| effect.setting == setting && holds(effect.scene));
    let values: Vec<f64> = of.map(value).collect();
    (!values.is_empty()).then(|| mean(&values))
}

/// Sections of the page; empty without runs of other values.
pub(super) fn html(runs: &[SurveyRun]) -> String {
    let effects = effects(runs);
    if effects.is_empty() {
        return String::new();
    }
    let scenes: Vec<&str> = scenes(runs)
        .into_iter()
        .filter(|scene| effects.iter().any(|effect| effect.scene == *scene))
        .collect();
    format!(
        "<h2>Constants at other values</h2>\n<p>{OF_EFFECTS}</p>\n{}<h2>One scene left out</h2>\n<p>{OF_CHOICES}</p>\n{}",
        effect_table(&effects, &scenes),
        choice_table(&effects, &scenes)
    )
}

fn effect_table(effects: &[Effect<'_>], scenes: &[&str]) -> String {
    let head = [&["setting"], scenes, &["score"]].concat();
    let row = |setting: &str| {
        let cell = |scene: &str| {
            let of = |value| mean_of(effects, setting, |other| other == scene, value);
            match (of(|e| e.psnr_db), of(|e| e.ssim), of(|e| e.ratio)) {
                (Some(psnr), Some(ssim), Some(ratio)) => {
                    format!("{psnr:+.2} dB, {ssim:+.4}, {:+.0} %", 100.0 * (ratio - 1.0))
                }
                _ => "–".into(),
            }
        };
        let score = mean_of(effects, setting, |_| true, |e| e.score).unwrap_or(f64::NAN);
        let mut cells = vec![setting.to_owned()];
        cells.extend(scenes.iter().map(|scene| cell(scene)));
        cells.push(format!("{score:+.2}"));
        (false, cells)
    };
    table(
        "",
        &head,
        distinct(effects.iter().map(|effect| effect.setting))
            .into_iter()
            .map(row),
    )
}

fn choice_table(effects: &[Effect<'_>], scenes: &[&str]) -> String {
    let head = [&["constant"], scenes, &["score"]].concat();
    let row = |name: &str| {
        let chosen: Vec<(Option<&str>, f64)> = scenes.iter().map(|scene| choice(effects, name, scene)).collect();
        let cell = |(setting, score): &(Option<&str>, f64)| match setting.and_then(|setting| setting.split_once('=')) {
            Some((_, value)) => format!("{value}: {score:+.2}"),
            None => "usual".into(),
        };
        let mut cells = vec![name.to_owned()];
        cells.extend(chosen.iter().map(cell));
        let scores: Vec<f64> = chosen.iter().map(|(_, score)| *score).collect();
        cells.push(format!("{:+.2}", mean(&scores)));
        (false, cells)
    };
    table(
        "",
        &head,
        distinct(effects.iter().map(Effect::name)).into_iter().map(row),
    )
}

/// Setting of a constant with the best mean score on the other scenes, `None` for the usual value, and its score on
/// this scene.
fn choice<'a>(effects: &[Effect<'a>], name: &str, scene: &str) -> (Option<&'a str>, f64) {
    let settings = distinct(
        effects
            .iter()
            .filter(|effect| effect.name() == name)
            .map(|effect| effect.setting),
    );
    let score = |setting: &&str| mean_of(effects, setting, |other| other != scene, |e| e.score);
    let scored = settings
        .into_iter()
        .filter_map(|setting| Some((setting, score(&setting)?)));
    let best = scored
        .max_by(|(_, a), (_, b)| a.total_cmp(b))
        .filter(|(_, score)| *score > 0.0);
    let here = |setting: &str| mean_of(effects, setting, |other| other == scene, |e| e.score);
    match best {
        Some((setting, _)) => (Some(setting), here(setting).unwrap_or(0.0)),
        None => (None, 0.0),
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::run;
    use super::*;

    fn with(setting: &str, scene: &str, splats: usize, psnr: f64) -> SurveyRun {
        SurveyRun {
            setting: setting.into(),
            loss_db: 0.1,
            ssim: Some(0.9),
            ..run(scene, Recipe::Parsimony, 0, splats, psnr)
        }
    }

    /// Twice the splats for 0.3 dB in two scenes, and for a loss in the third one.
    fn survey() -> Vec<SurveyRun> {
        let scene = |scene, gain| [with("", scene, 100, 30.0), with("auto.x=2", scene, 200, 30.0 + gain)];
        [scene("a", 0.3), scene("b", 0.3), scene("c", -0.3)].concat()
    }

    #[test]
    fn scores_weigh_quality_against_splats() {
        let survey = survey();
        let effects = effects(&survey);
        // SSIM does not gain, so that the splats are all there is.
        let scores: Vec<f64> = effects.iter().map(|effect| effect.score).collect();
        let near = |wanted: f64, found: f64| assert!((wanted - found).abs() < 1e-9, "{found}");
        near(-0.1, scores[0]);
        near(-0.4, scores[2]);
        let full = [with("", "s", 100, 45.0), with("auto.x=2", "s", 50, 41.0)];
        near(0.1, super::effects(&full)[0].score);
    }

    #[test]
    fn a_value_is_chosen_on_the_other_scenes() {
        let mut survey = survey();
        survey
            .iter_mut()
            .for_each(|run| run.ssim = Some(run.psnr_db.unwrap_or(0.0) * 0.02));
        let effects = effects(&survey);
        let chosen = |scene| choice(&effects, "auto.x", scene);
        let (setting, score) = chosen("c");
        assert!(setting == Some("auto.x=2") && (score + 0.4).abs() < 1e-9);
        // On b and c it loses.
        assert_eq!(chosen("a"), (None, 0.0));
        let page = html(&survey);
        assert!(
            page.contains("<td>2: -0.40</td>") && page.contains("<td>usual</td>"),
            "{page}"
        );
        assert!(page.contains("<td>+0.30 dB, +0.0060, +100 %</td>"), "{page}");
        assert_eq!(html(&survey[..1]), "");
    }
}
