//! Result of a reconstruction: which photographs have poses, and why the others may have none.

use super::frames::{PhotoQuality, quality};
use super::photographs;
use crate::io::colmap;
use crate::stats::quantile;
use crate::{Error, Result};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// RegistrationReport photographs that the others are compared with, at most.
const COMPARED_MAX: usize = 12;

/// Photographs without a pose that are named, at most.
const NAMED_MAX: usize = 20;

/// Share of the usual sharpness, and of the usual brightness, below which a photograph counts as blurred or dark.
const BLURRED: f64 = 0.25;
const DARK: f64 = 0.4;

/// Makes the model with the most photographs `sparse/0`, for COLMAP begins another where a photograph does not fit.
pub(super) fn keep_largest(out: &Path) -> Result<()> {
    let sparse = out.join("sparse");
    let mut models: Vec<(usize, PathBuf)> = Vec::new();
    for index in 0.. {
        let model = sparse.join(index.to_string());
        if !model.is_dir() {
            break;
        }
        models.push((colmap::read(&model, &out.join("images"))?.views.len(), model));
    }
    let Some((place, _)) = models
        .iter()
        .enumerate()
        .max_by_key(|(place, (count, _))| (*count, usize::MAX - place))
    else {
        let what = "COLMAP found no two photographs that show the same: they need more overlap, or texture";
        return Err(Error::file(out, what));
    };
    if place == 0 {
        return Ok(());
    }
    let (first, largest, aside) = (&models[0].1, &models[place].1, sparse.join("aside"));
    for (from, to) in [(first, &aside), (largest, first), (&aside, largest)] {
        std::fs::rename(from, to).map_err(Error::io(from))?;
    }
    Ok(())
}

/// Photographs with and without a pose.
pub(super) struct RegistrationReport {
    registered: usize,
    all: usize,
    points: usize,
    /// Names of those without, with a likely reason.
    missing: Vec<(String, &'static str)>,
    /// Further models of photographs that do not connect to these.
    others: usize,
}

/// Reads the result in a folder.
pub(super) fn report(out: &Path) -> Result<RegistrationReport> {
    let images = out.join("images");
    let names = photographs(&images)?;
    if !super::has_model(out) {
        return Err(Error::file(out, "has no model: begin anew with --overwrite"));
    }
    let listing = colmap::read(&out.join("sparse/0"), &images)?;
    let found: BTreeSet<&str> = listing.views.iter().map(|view| view.name.as_str()).collect();
    let step = found.len().div_ceil(COMPARED_MAX).max(1);
    let of = |name: &str| quality(&images.join(name));
    let usual: Vec<PhotoQuality> = found.iter().step_by(step).map(|name| of(name)).collect::<Result<_>>()?;
    let median = |of: fn(&PhotoQuality) -> f64| {
        let mut values: Vec<f64> = usual.iter().map(of).collect();
        quantile(&mut values, 0.5).unwrap_or(0.0)
    };
    let (sharp, bright) = (median(|q| q.sharpness), median(|q| q.brightness));
    let mut missing = Vec::new();
    for name in names.iter().filter(|name| !found.contains(name.as_str())) {
        let quality = of(name)?;
        let reason = if quality.sharpness < BLURRED * sharp {
            "blurred, or of a plain surface"
        } else if quality.brightness < DARK * bright {
            "dark"
        } else {
            "too little overlap with the others"
        };
        missing.push((name.clone(), reason));
    }
    let others = (1..)
        .take_while(|index| out.join(format!("sparse/{index}")).is_dir())
        .count();
    Ok(RegistrationReport {
        registered: found.len(),
        all: names.len(),
        points: listing.points.len(),
        missing,
        others,
    })
}

impl RegistrationReport {
    pub(super) fn text(&self, out: &Path) -> String {
        let mut text = format!(
            "{} of {} photographs have poses, {} points",
            self.registered, self.all, self.points
        );
        for (name, reason) in self.missing.iter().take(NAMED_MAX) {
            text += &format!("\n  without: {name} (likely {reason})");
        }
        if self.missing.len() > NAMED_MAX {
            text += &format!("\n  and {} more", self.missing.len() - NAMED_MAX);
        }
        if self.others > 0 {
            text += &format!(
                "\n{} further groups of photographs do not connect to these: take some between them",
                self.others
            );
        }
        let out = out.display();
        text + &format!("\nnext: ashfall info {out}; ashfall train {out} --out run")
    }

    pub(super) fn value(&self) -> Value {
        json!({
            "event": "done",
            "registered": self.registered,
            "photographs": self.all,
            "points": self.points,
            "further_models": self.others,
            "missing": self.missing.iter().map(|(name, reason)| json!({"name": name, "likely": reason})).collect::<Vec<_>>(),
        })
    }
}
