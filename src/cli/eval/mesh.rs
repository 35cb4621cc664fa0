//! `ashfall eval --mesh`: distances between a mesh and the true one.

use super::super::Outcome;
use super::super::args::DataArgs;
use super::super::output::{Output, grouped};
use super::super::parse;
use crate::io;
use crate::mesh::{ComparisonOptions, DistanceSummary, MeshComparison, compare};
use crate::scene::Split;
use crate::{Error, Result};
use clap::Args;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Options of a mesh's scores.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Meshes")]
pub(super) struct MeshScoreArgs {
    /// Score a mesh (.ply, .obj) against the true one instead of a scene against photographs
    #[arg(long, value_name = "MESH", requires = "truth", conflicts_with_all = ["scene", "data"])]
    pub(super) mesh: Option<PathBuf>,
    /// The true mesh, in the same axes and units
    #[arg(long, value_name = "MESH", requires = "mesh")]
    truth: Option<PathBuf>,
    /// Data set or transforms.json: only points that its training cameras see count, and distances are told in pixels
    #[arg(long, value_name = "DATA", requires = "mesh")]
    cameras: Option<PathBuf>,
    /// Distance at which a point counts as met, world units [default: a pixel's footprint with --cameras, else a 200th
    /// of the diagonal of the true mesh]
    #[arg(long, value_name = "D", requires = "mesh", value_parser = parse::positive)]
    threshold: Option<f64>,
    /// Points on each mesh
    #[arg(long, value_name = "N", requires = "mesh", default_value = "200000", value_parser = parse::count)]
    points: usize,
}

/// Scores a mesh.
pub(super) fn run(args: &MeshScoreArgs, mesh_path: &Path, data: &DataArgs, output: Output) -> Result<Outcome> {
    let truth_path = args.truth.as_deref().unwrap_or(mesh_path);
    let (mesh, origin) = io::mesh::read(mesh_path)?;
    let (truth, true_origin) = io::mesh::read(truth_path)?;
    let mut options = ComparisonOptions {
        samples: args.points,
        threshold: args.threshold,
        ..ComparisonOptions::default()
    };
    if let Some(path) = &args.cameras {
        let mut dataset = data.open(path, false)?;
        dataset.set_origin(true_origin);
        let views = dataset.split(Split::Train);
        options.cameras = views.iter().map(|&i| dataset.views[i].camera).collect();
        if options.cameras.is_empty() {
            return Err(Error::file(path, "holds no training camera"));
        }
    }
    let found = compare(&mesh, origin - true_origin, &truth, &options)?;
    output.result(table(&found), || {
        json!({
            "mesh": mesh_path,
            "truth": truth_path,
            "triangles": mesh.triangles.len(),
            "true_triangles": truth.triangles.len(),
            "comparison": found,
        })
    });
    Ok(Outcome::Done)
}

fn table(found: &MeshComparison) -> String {
    let mut text = format!(
        "{:28} {:>10} {:>10} {:>10} {:>10} {:>9}\n",
        "distance", "mean", "median", "95 %", "largest", "points"
    );
    let mut line = |name: &str, d: &DistanceSummary| {
        let points = grouped(d.points);
        let row = [d.mean, d.median, d.p95, d.max]
            .map(|x| format!("{x:>10.3e}"))
            .join(" ");
        text += &format!("{name:28} {row} {points:>9}\n");
    };
    line("accuracy, mesh to truth", &found.accuracy);
    line("completeness, truth to mesh", &found.completeness);
    text += &format!(
        "chamfer (mean of both means): {:.3e}, {:.3} % of the diagonal",
        found.chamfer,
        100.0 * found.chamfer / found.diagonal
    );
    if let Some(pixel) = found.footprint {
        text += &format!(", {:.3} pixels of {pixel:.3e}", found.chamfer / pixel);
    }
    for score in &found.scores {
        text += &format!(
            "\nwithin {:.3e}: precision {:.4}, recall {:.4}, F1 {:.4}",
            score.threshold, score.precision, score.recall, score.f1
        );
    }
    let normal = &found.normal_deg;
    text + &format!(
        "\nnormals: mean {:.2}°, median {:.2}°; outward sides {:.2}°",
        normal.mean, normal.median, normal.mean_outward
    )
}
