//! The figures of the page, as HTML tables.

use super::targets::{Figures, Target, intricacy};
use super::{Recipe, Run, Survey};
use crate::lab::chart::tables::escaped;
use crate::lab::report::needs::grouped;
use crate::stats::Interval;

/// How a figure reads.
#[derive(Clone, Copy)]
enum Unit {
    /// A ratio in percent; the column says so.
    Percent,
    /// A difference, in decibels.
    Decibels,
    /// To either side, as a percentage.
    Spread,
    /// A factor.
    Times,
}

fn text(found: &Interval, unit: Unit) -> String {
    let half = 0.5 * (found.high - found.low);
    let with = |value: String, half: String| match found.count > 1 {
        true => format!("{value} ± {half}"),
        false => value,
    };
    match unit {
        Unit::Percent => with(
            format!("{:.0}", 100.0 * found.value),
            format!("{:.0}", 100.0 * half),
        ),
        Unit::Decibels => with(format!("{:+.2}", found.value), format!("{half:.2}")),
        Unit::Spread => format!("± {:.0} %", 100.0 * found.value),
        Unit::Times => format!("{:.1} ×", found.value),
    }
}

/// A cell; red where its aim is missed.
fn cell(target: Option<&Target>, unit: Unit) -> String {
    match target {
        None => "<td>–</td>".into(),
        Some(target) => {
            let class = match target.is_missed() {
                true => " class=\"missed\"",
                false => "",
            };
            format!("<td{class}>{}</td>", text(&target.found, unit))
        }
    }
}

fn aim(figures: &[Figures], of: fn(&Figures) -> Option<Target>, unit: Unit) -> String {
    let target = figures.iter().find_map(of);
    let Some((aim, is_floor)) = target.and_then(|t| Some((t.aim?, t.is_floor))) else {
        return String::new();
    };
    let aim = Interval::new(aim, aim, aim, 1);
    let aim = text(&aim, unit);
    match unit {
        Unit::Spread => aim,
        _ if is_floor => format!("≥ {aim}"),
        _ => format!("≤ {aim}"),
    }
}

/// A column of figures: what it is called, where it is, how it reads.
type Column = (&'static str, fn(&Figures) -> Option<Target>, Unit);

const COLUMNS: [Column; 12] = [
    ("splats, % of fixed", |f| f.splats_ratio, Unit::Percent),
    ("dB to fixed", |f| f.against_fixed_db, Unit::Decibels),
    ("same rates", |f| f.against_rates_db, Unit::Decibels),
    ("dB to MCMC", |f| f.against_mcmc_db, Unit::Decibels),
    ("same rates", |f| f.against_mcmc_rates_db, Unit::Decibels),
    ("SH floats left, %", |f| f.sh_share, Unit::Percent),
    ("others’ worth, dB", |f| f.sh_worth_db, Unit::Decibels),
    ("count by seed", |f| f.spread, Unit::Spread),
    ("file, %", |f| f.file_ratio, Unit::Percent),
    ("device bytes, %", |f| f.device_ratio, Unit::Percent),
    ("frame time, %", |f| f.frame_ratio, Unit::Percent),
    ("training time, %", |f| f.time_ratio, Unit::Percent),
];

/// What sets parsimony apart, a line for each scene, and what was aimed at.
pub(super) fn of_scenes(survey: &Survey) -> String {
    let scenes = survey.scenes();
    let figures: Vec<Figures> = scenes
        .iter()
        .map(|scene| Figures::of(survey, scene))
        .collect();
    let mut head = String::from("<th>scene</th><th>splats</th><th>fixed recipe</th>");
    let mut aims = String::from("<td>aim</td><td></td><td></td>");
    for (name, of, unit) in COLUMNS {
        head += &format!("<th>{name}</th>");
        aims += &format!("<td>{}</td>", aim(&figures, of, unit));
    }
    let mut rows = String::new();
    for (scene, figures) in scenes.iter().zip(&figures) {
        rows += &format!("<tr><td>{}</td>", escaped(scene));
        for count in [figures.splats[1], figures.splats[0]] {
            let count = count.map_or("–".into(), |count| grouped(count.value.round() as usize));
            rows += &format!("<td>{count}</td>");
        }
        for (_, of, unit) in COLUMNS {
            rows += &cell(of(figures).as_ref(), unit);
        }
        rows += "</tr>\n";
    }
    format!(
        "<table class=\"needs\">\n<tr>{head}</tr>\n<tr class=\"aim\">{aims}</tr>\n{rows}</table>\n"
    )
}

/// How many times as many splats the most intricate scene needs.
pub(super) fn of_intricacy(survey: &Survey) -> String {
    let Some((richest, others)) = intricacy(survey).filter(|(_, others)| !others.is_empty()) else {
        return String::new();
    };
    let times = |(scene, target): &(&str, Target)| {
        let class = if target.is_missed() {
            " class=\"missed\""
        } else {
            ""
        };
        format!(
            "<span{class}>{} as many as {}</span>",
            self::text(&target.found, Unit::Times),
            escaped(scene)
        )
    };
    let times: Vec<String> = others.iter().map(times).collect();
    let aim = others.iter().find_map(|(_, target)| target.aim);
    let aim = aim.map_or(String::new(), |aim| {
        format!(" (aim: {aim:.0} × as many as each trivial one)")
    });
    format!(
        "<p>The most intricate scene, {}, needs {}{aim}.</p>\n",
        escaped(richest),
        times.join(", ")
    )
}

const RUN_HEAD: [&str; 16] = [
    "scene",
    "recipe",
    "seed",
    "splats",
    "degree 0",
    "1",
    "2",
    "3",
    "PSNR dB",
    "SSIM",
    "SH floats left",
    "file MB",
    "device MB",
    "frame ms",
    "training s",
    "CPU s",
];

/// Every run.
pub(super) fn of_runs(survey: &Survey) -> String {
    let head: String = RUN_HEAD
        .iter()
        .map(|name| format!("<th>{name}</th>"))
        .collect();
    let mut text = format!("<table class=\"runs\">\n<tr>{head}</tr>\n");
    for scene in survey.scenes() {
        for recipe in Recipe::ALL {
            for run in survey.of(scene, recipe) {
                let cells = cells(run).map(|cell| format!("<td>{}</td>", escaped(&cell)));
                text += &format!("<tr>{}</tr>\n", cells.concat());
            }
        }
    }
    text + "</table>\n"
}

fn cells(run: &Run) -> [String; 16] {
    let number = |value: Option<f64>, digits: usize| match value {
        Some(value) => format!("{value:.digits$}"),
        None => "–".into(),
    };
    let of_degree = |degree: usize| {
        let count = run.splats_by_degree.get(degree);
        grouped(count.copied().unwrap_or(0))
    };
    [
        run.scene.clone(),
        run.recipe.title().into(),
        run.seed.to_string(),
        grouped(run.splats),
        of_degree(0),
        of_degree(1),
        of_degree(2),
        of_degree(3),
        number(run.psnr_db, 2),
        number(run.ssim, 4),
        format!("{:.0} %", 100.0 * run.sh_share()),
        format!("{:.2}", 1e-6 * run.ply_bytes as f64),
        format!("{:.2}", 1e-6 * run.device_bytes() as f64),
        format!("{:.2}", run.frame_ms),
        format!("{:.1}", run.train_seconds),
        number(run.cpu_seconds, 1),
    ]
}
