//! What a run has found of its scene's needs, as its report has it.

use crate::parsimony::{Ledger, part, reduce_harmonics};
use crate::report::Report;
use crate::report::needs::{Needs, bytes_by_degree, sentence};
use crate::scene::{Dataset, Splats};
use crate::{Error, Result};
use std::path::Path;

/// What there is to report of a scene and how it came to be.
pub(super) fn found(dataset: &Dataset, ledger: &Ledger, splats: &Splats) -> Needs {
    // Degrees that went have left zeros.
    let reduced = reduce_harmonics(splats, 0.0);
    let law = ledger.law();
    let (_, held) = part(dataset);
    Needs {
        sentence: sentence(reduced.count_from_degree, None),
        preference_db: ledger.preference_db,
        splat_count: splats.len(),
        splats_by_degree: reduced.count_from_degree,
        bytes_by_degree: bytes_by_degree(reduced.count_from_degree),
        sh_lost_db: ledger.sh_lost_db,
        settled_from: ledger.settled_from,
        half_size: ledger.half_size(),
        validation_views: held
            .iter()
            .map(|&v| dataset.views[v].name.clone())
            .collect(),
        knee: law.map(|law| law.knee(ledger.preference_db)),
        law,
        points: ledger.points(),
        steps: ledger.steps(),
        against: None,
    }
}

/// The report of a run to compare with.
pub(super) fn read(path: &Path) -> Result<Report> {
    let text = std::fs::read(path).map_err(Error::io(path))?;
    serde_json::from_slice(&text)
        .map_err(|e| Error::file(path, format!("is no report of a run: {e}")))
}
