//! Comments that hold facts beyond the layout: the filter on the screen and the origin of the means.

use super::super::reader::excerpt;
use crate::error::{Error, Result};
use crate::scene::{ScreenFilter, Splats};
use glam::DVec3;
use std::path::Path;

/// Prefix of the comment with the origin of the means: three numbers follow.
const ORIGIN: &str = "SplatOrigin:";

/// Header lines of the filter and, unless it is zero, the origin.
pub(super) fn comments(splats: &Splats) -> String {
    let filter = splats.filter.name();
    let origin = match splats.origin {
        DVec3::ZERO => String::new(),
        DVec3 { x, y, z } => format!("comment {ORIGIN} {x} {y} {z}\n"),
    };
    format!("comment SplatRenderMode: {filter}\n{origin}")
}

/// Screen filter of the comments; the last wins, as with the programs that write them.
pub(super) fn screen_filter(path: &Path, comments: &[String], warnings: &mut Vec<String>) -> Result<ScreenFilter> {
    let mut filter = ScreenFilter::Classic;
    for comment in comments {
        if let Some(name) = comment.strip_prefix("SplatRenderMode:") {
            match name.trim() {
                "default" => filter = ScreenFilter::Classic,
                "mip" => filter = ScreenFilter::Mip,
                "2dgs" => {
                    let what = "SplatRenderMode is 2dgs: 2D Gaussian scenes are not supported";
                    return Err(Error::file(path, what));
                }
                other => warnings.push(format!(
                    "{}: unknown SplatRenderMode {} taken for default",
                    path.display(),
                    excerpt(other)
                )),
            }
        } else if let Some(flag) = comment.strip_prefix("antialiased") {
            filter = match flag.trim() {
                "1" | "true" => ScreenFilter::Mip,
                _ => ScreenFilter::Classic,
            };
        }
    }
    Ok(filter)
}

/// Origin of the means, if a comment gives it.
pub(super) fn origin(path: &Path, comments: &[String]) -> Result<DVec3> {
    let Some(text) = comments.iter().find_map(|c| c.strip_prefix(ORIGIN)) else {
        return Ok(DVec3::ZERO);
    };
    let numbers: Option<Vec<f64>> = text.split_whitespace().map(|n| n.parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, z]) if [x, y, z].iter().all(|v| v.is_finite()) => Ok(DVec3::new(x, y, z)),
        _ => {
            let what = format!("the origin is not three numbers: {}", excerpt(text));
            Err(Error::file(path, what))
        }
    }
}
