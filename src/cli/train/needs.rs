//! Section of the report on the splats that a scene needs.

use crate::lab::report::Report;
use crate::lab::report::needs::{Needs, bytes_by_degree};
use crate::scene::{Dataset, Splats};
use crate::simplify::{History, reduce_harmonics, split_views};
use crate::{Error, Result};
use std::path::Path;

/// Report section of a run's history and its final scene.
pub(super) fn found(dataset: &Dataset, history: &History, splats: &Splats) -> Needs {
    // Removed degrees have zero coefficients.
    let reduced = reduce_harmonics(splats, 0.0);
    let (_, held) = split_views(dataset, &history.config);
    let needs = Needs {
        sentence: String::new(),
        loss_db: history.config.loss_db,
        loss_ssim: history.config.loss_db * history.config.ssim_per_db,
        splat_count: splats.len(),
        too_few: history.least_splats(splats.len()),
        splats_by_degree: reduced.count_from_degree,
        bytes_by_degree: bytes_by_degree(reduced.count_from_degree),
        settled_from: history.settled_from,
        validation_views: held.iter().map(|&v| dataset.views[v].name.clone()).collect(),
        points: history.points(),
        steps: history.steps(),
        against: None,
    };
    needs.beside(None)
}

/// Reads the report of a run to compare with.
pub(super) fn read(path: &Path) -> Result<Report> {
    let text = std::fs::read(path).map_err(Error::io(path))?;
    serde_json::from_slice(&text).map_err(|e| Error::file(path, format!("is no report of a run: {e}")))
}
