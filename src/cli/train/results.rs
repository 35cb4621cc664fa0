//! Results of a finished run: the scene, pictures of the held-out views, the report.

use super::Session;
use super::state::RunState;
use crate::cli::eval::write_comparison;
use crate::cli::output::{bytes, grouped, score_text, write_text};
use crate::lab::report::needs::Needs;
use crate::lab::report::page;
use crate::lab::report::{MemoryFigures, Report};
use crate::metrics::{MeanScore, ViewScore};
use crate::scene::{Splats, Split};
use crate::train::{StrategyKind, TrainConfig};
use crate::{Error, Result, io};
use serde_json::json;
use std::time::Instant;

/// Writes all results and prints their paths.
pub(super) fn write(
    session: &Session<'_>,
    config: &TrainConfig,
    state: &mut RunState,
    (splats, memory): (&Splats, MemoryFigures),
    (found, ignored): (Option<Needs>, Option<f64>),
) -> Result<()> {
    // The scene first, so that a later failure does not lose the training.
    io::ply::write(&session.dir.join("scene.ply"), splats)?;
    let start = Instant::now();
    let test = test_pictures(session, config, splats)?;
    let train = session.evaluator(config, Split::Train).scores(splats)?;
    state.timings.evaluate_seconds += start.elapsed().as_secs_f64();
    let score = MeanScore::of(&test);
    let needs = found.map(|needs| needs.beside(session.against.and_then(|report| report.comparison(score.psnr_db))));
    let report = Report {
        iterations: state.iteration,
        seed: config.seed,
        strategy: match config.strategy {
            StrategyKind::Adc => "adc".into(),
            StrategyKind::Mcmc => "mcmc".into(),
        },
        device: session.gpu.caps().name.to_string(),
        splat_count: splats.len(),
        sh_degree: splats.sh_degree,
        train_seconds: state.timings.train_seconds,
        loss: state.history.iter().rev().find_map(|entry| entry.loss),
        test: score,
        train: MeanScore::of(&train),
        memory_peak_bytes: session.gpu.memory_peak(),
        memory,
        history: state.history.clone(),
        test_views: test,
        timings: state.timings,
        warnings: state.warnings.clone(),
        config: serde_json::to_value(config).unwrap_or_default(),
        needs,
        ignored_share: ignored,
    };
    if let Some(needs) = &report.needs {
        write_text(&session.dir.join("needs.html"), &page::html(needs)?)?;
    }
    report.write(&session.dir.join("report.json"))?;
    state.is_finished = true;
    state.write(session.dir)?;
    tell(session, &report);
    Ok(())
}

/// Scores the held-out views and writes photograph | rendering | difference of each.
fn test_pictures(session: &Session<'_>, config: &TrainConfig, splats: &Splats) -> Result<Vec<ViewScore>> {
    let dir = session.dir.join("test");
    let mut evaluator = session.evaluator(config, Split::Test);
    if evaluator.view_count() > 0 {
        std::fs::create_dir_all(&dir).map_err(Error::io(&dir))?;
    }
    evaluator.map(splats, |evaluated| {
        write_comparison(&dir, evaluated)?;
        Ok(evaluated.score())
    })
}

fn tell(session: &Session<'_>, report: &Report) {
    let dir = session.dir.display();
    let mut lines = vec![format!(
        "{} iterations in {:.0} s, {} splats",
        grouped(report.iterations as usize),
        report.train_seconds,
        grouped(report.splat_count)
    )];
    if report.test.views > 0 {
        lines.push(format!("test:  {}", score_text(&report.test)));
    }
    lines.push(format!("train: {}", score_text(&report.train)));
    lines.push(memory_line(&report.memory));
    for warning in &report.warnings {
        lines.push(format!("warning: {warning}"));
    }
    if let Some(needs) = &report.needs {
        lines.push(needs.sentence.clone());
        lines.push(format!("why:      {dir}/needs.html"));
    }
    lines.push(format!("scene:    {dir}/scene.ply"));
    lines.push(format!("report:   {dir}/report.json"));
    if report.test.views > 0 {
        lines.push(format!(
            "pictures: {dir}/test/ (photograph | rendering | difference × 4)"
        ));
    }
    session.output.result(lines.join("\n"), || {
        json!({
            "event": "done",
            "iterations": report.iterations,
            "train_seconds": report.train_seconds,
            "splat_count": report.splat_count,
            "test": report.test,
            "train": report.train,
            "needs": report.needs.as_ref().map(|needs| &needs.sentence),
            "scene": session.dir.join("scene.ply"),
            "report": session.dir.join("report.json"),
        })
    });
}

fn memory_line(memory: &MemoryFigures) -> String {
    let share = |of: u64| memory.peak_bytes as f64 / of.max(1) as f64;
    format!(
        "memory: {} at most, {:.2} of what was predicted for {} splats and {} pairs, {:.2} of parameters, moments, \
         photographs and lists alone",
        bytes(memory.peak_bytes),
        share(memory.predicted_bytes),
        grouped(memory.splats_peak),
        grouped(memory.isects_peak),
        share(memory.essential_bytes),
    )
}
