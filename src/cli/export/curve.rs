//! Curve of an export: every format and setting, and given files.

use super::ExportArgs;
use crate::cli::Outcome;
use crate::cli::interrupt::Interrupt;
use crate::cli::output::Output;
use crate::export::{ExportFormat, ExportSource, Ladder, Pictures};
use crate::io::AxesBy;
use crate::io::atomic::write_atomically;
use crate::lab::report::curve::{CurvePoint, csv, html};
use crate::scene::Axes;
use crate::{Error, Result};
use serde_json::json;
use std::io::Write;
use std::path::Path;

/// Measures all and writes the page and its numbers.
pub(super) fn run(
    args: &ExportArgs,
    source: &ExportSource,
    pictures: &mut Pictures<'_>,
    interrupt: &Interrupt,
    output: Output,
) -> Result<Outcome> {
    let Some(dir) = &args.curve else {
        return Ok(Outcome::Done);
    };
    std::fs::create_dir_all(dir).map_err(Error::io(dir))?;
    let mut points = Vec::new();
    for target in ExportFormat::names().filter_map(ExportFormat::parse) {
        let mut ladder = Ladder::new(source, target, pictures);
        let bar = output.bar(ladder.rung_count() as u64, target.name());
        for rung in 0..ladder.rung_count() {
            if interrupt.is_requested() {
                return Ok(Outcome::Interrupted);
            }
            let measured = ladder.measure(rung)?;
            points.push(CurvePoint {
                series: target.name().to_owned(),
                setting: measured.encoded.setting.describe(target),
                bytes: measured.encoded.bytes,
                error: measured.error,
                is_given: false,
            });
            bar.inc(1);
        }
        bar.finish_and_clear();
    }
    for path in &args.with {
        points.push(given(args, path, pictures)?);
    }
    let splats = source.splats().len();
    let mut facts = vec![
        ("scene".to_owned(), format!("{}, {splats} splats", args.scene.display())),
        ("views".to_owned(), format!("{}", pictures.view_count())),
    ];
    if let Some([psnr_db, ssim]) = pictures.original_scores() {
        let text = format!("{psnr_db:.2} dB, SSIM {ssim:.4} against the photographs of these views");
        facts.push(("original".to_owned(), text));
    }
    let (page, numbers) = (dir.join("curve.html"), dir.join("curve.csv"));
    write(&numbers, &csv(&points, splats)?)?;
    write(&page, html(&points, splats, &facts)?.as_bytes())?;
    output.result(
        format_args!("Look at {}", page.display()),
        || json!({"page": page, "csv": numbers, "points": points.len()}),
    );
    Ok(Outcome::Done)
}

/// Point of a file by another program.
fn given(args: &ExportArgs, path: &Path, pictures: &mut Pictures<'_>) -> Result<CurvePoint> {
    let loaded = args.scene_options.read(path)?;
    let mut splats = loaded.splats;
    let mut error = pictures.error(&splats)?;
    if loaded.stored.axes_by == AxesBy::Assumption {
        // Back to the file's axes, and taken for those of a `.ply`.
        splats.change_axes(Axes::RDF, loaded.stored.axes);
        let as_ply = pictures.error(&splats)?;
        if as_ply.mean_squared < error.mean_squared {
            eprintln!("{}: axes {} are taken, which fit better", path.display(), Axes::RDF);
            error = as_ply;
        }
    }
    Ok(CurvePoint {
        series: path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        setting: "given".to_owned(),
        bytes: std::fs::metadata(path).map_err(Error::io(path))?.len(),
        error,
        is_given: true,
    })
}

fn write(path: &Path, contents: &[u8]) -> Result<()> {
    write_atomically(path, |file| file.write_all(contents))
}
