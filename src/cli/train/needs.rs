//! Section of the report on the splats that a scene needs.

use crate::lab::report::Report;
use crate::lab::report::needs::{Needs, bytes_by_degree, sentence};
use crate::scene::{Dataset, Splats};
use crate::simplify::{History, reduce_harmonics, split_views};
use crate::{Error, Result};
use std::path::Path;

/// Report section of a run's history and its final scene.
pub(super) fn found(dataset: &Dataset, history: &History, splats: &Splats) -> Needs {
    // Removed degrees have zero coefficients.
    let reduced = reduce_harmonics(splats, 0.0);
    let law = history.law();
    let (_, held) = split_views(dataset, &history.config);
    Needs {
        sentence: sentence(reduced.count_from_degree, None),
        preference_db: history.preference_db,
        splat_count: splats.len(),
        splats_by_degree: reduced.count_from_degree,
        bytes_by_degree: bytes_by_degree(reduced.count_from_degree),
        sh_lost_db: history.sh_lost_db,
        settled_from: history.settled_from,
        half_size: history.half_size(),
        validation_views: held.iter().map(|&v| dataset.views[v].name.clone()).collect(),
        knee: law.map(|law| law.knee(history.preference_db)),
        law,
        points: history.points(),
        steps: history.steps(),
        against: None,
    }
}

/// Reads the report of a run to compare with.
pub(super) fn read(path: &Path) -> Result<Report> {
    let text = std::fs::read(path).map_err(Error::io(path))?;
    serde_json::from_slice(&text).map_err(|e| Error::file(path, format!("is no report of a run: {e}")))
}
