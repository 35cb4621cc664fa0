//! Scenes of the command line: reading, and the axes of files that do not state them.

use super::engine::evaluator;
use crate::Result;
use crate::gpu::Gpu;
use crate::io::{self, AxesBy, LoadedSplats};
use crate::scene::{Axes, Dataset, PhotoSource, Splats, Split};
use clap::{Args, ValueEnum};
use std::path::Path;

/// Options for reading a scene.
#[derive(Clone, Copy, Debug, Default, Args)]
#[command(next_help_heading = "Scene")]
pub(super) struct SceneArgs {
    /// Axes of the scene's file: ply (x right, y down, z front), rub (x right, y up, z back) or gltf (x left, y up, z
    /// front); auto: those of the format or the file, and of files that leave them open rub or, with photographs, the
    /// best fit to one
    #[arg(long, value_name = "AXES", default_value = "auto")]
    axes: AxesArg,
}

/// Axes of a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum AxesArg {
    #[default]
    Auto,
    Ply,
    Rub,
    Gltf,
}

impl SceneArgs {
    /// Reads a scene and prints repairs, omissions and, unless the format fixes them, its axes.
    pub(super) fn read(self, path: &Path) -> Result<LoadedSplats> {
        let axes = match self.axes {
            AxesArg::Auto => None,
            AxesArg::Ply => Some(Axes::RDF),
            AxesArg::Rub => Some(Axes::RUB),
            AxesArg::Gltf => Some(Axes::LUF),
        };
        let loaded = io::splats::read_in_axes(path, axes)?;
        for warning in &loaded.warnings {
            eprintln!("warning: {warning}");
        }
        let stored = &loaded.stored;
        let by = match stored.axes_by {
            AxesBy::Format => return Ok(loaded),
            AxesBy::File => "as the file states",
            AxesBy::Assumption => "assumed, since the file does not state them; --axes takes others",
            AxesBy::Choice => "as chosen",
        };
        eprintln!("{}: {}, axes {}, {by}", path.display(), stored.format, stored.axes);
        Ok(loaded)
    }
}

/// The splats of a scene; those of assumed axes turned to the axes in which the rendering of a training view is closest
/// to its photograph. The data set has the scene's origin.
pub(super) fn fit_axes(
    path: &Path,
    mut loaded: LoadedSplats,
    gpu: &Gpu,
    dataset: &Dataset,
    background: [f32; 3],
) -> Result<Splats> {
    let views = dataset.split(Split::Train);
    let photographed = |&&i: &&usize| !matches!(dataset.views[i].photo, PhotoSource::Absent);
    let view = match views.iter().find(photographed) {
        Some(&view) if loaded.stored.axes_by == AxesBy::Assumption => view,
        _ => return Ok(loaded.splats),
    };
    let mut evaluator = evaluator(gpu, dataset, &[view], background);
    let assumed = loaded.stored.axes;
    let mut current = assumed;
    let mut turn = |splats: &mut Splats, axes| {
        splats.change_axes(Axes::RDF, current);
        splats.change_axes(axes, Axes::RDF);
        current = axes;
    };
    let mut found: Vec<(f64, Axes)> = Vec::new();
    let others = [Axes::RDF, Axes::RUB, Axes::LUF]
        .into_iter()
        .filter(|axes| *axes != assumed);
    for axes in std::iter::once(assumed).chain(others) {
        turn(&mut loaded.splats, axes);
        let psnr_db = evaluator.scores(&loaded.splats)?[0].psnr_db;
        found.push((psnr_db.unwrap_or(f64::INFINITY), axes));
    }
    // The first of equal ones, which is the assumption.
    let best = found.iter().rev().max_by(|a, b| a.0.total_cmp(&b.0));
    let (psnr_db, axes) = best.copied().unwrap_or(found[0]);
    turn(&mut loaded.splats, axes);
    let name = &dataset.views[view].name;
    let file = path.display();
    match axes == assumed {
        true => eprintln!("{file}: the axes fit {name}: {psnr_db:.2} dB"),
        false => eprintln!(
            "{file}: axes {axes} are taken, which fit {name} better: {psnr_db:.2} dB, {assumed} {:.2} dB",
            found[0].0
        ),
    }
    Ok(loaded.splats)
}
