//! Comments that hold facts beyond the layout: kind of the splats, filter on the screen, origin of the means, and
//! upward direction.

use super::super::reader::excerpt;
use crate::error::{Error, Result};
use crate::scene::{Primitive, ScreenFilter, Splats};
use glam::DVec3;
use std::path::Path;

/// Prefix of the comment with the origin of the means: three numbers follow.
const ORIGIN: &str = "SplatOrigin:";

/// Prefix of the comment with the upward direction: three numbers follow.
const UP: &str = "SplatUp:";

/// Render mode of surfels.
const SURFELS: &str = "2dgs";

/// Header lines of the kind or the filter and, unless it is zero, the origin; and of the upward direction, if known.
/// The mip filter of surfels has a line of its own.
pub(super) fn comments(splats: &Splats) -> String {
    let mode = match (splats.primitive, splats.filter) {
        (Primitive::Gaussian3d, filter) => filter.name().to_owned(),
        (Primitive::Surfel, ScreenFilter::Classic) => SURFELS.to_owned(),
        (Primitive::Surfel, ScreenFilter::Mip) => format!("{SURFELS}\ncomment antialiased 1"),
    };
    let origin = match splats.origin {
        DVec3::ZERO => String::new(),
        DVec3 { x, y, z } => format!("comment {ORIGIN} {x} {y} {z}\n"),
    };
    let up = match splats.up {
        None => String::new(),
        Some(DVec3 { x, y, z }) => format!("comment {UP} {x} {y} {z}\n"),
    };
    format!("comment SplatRenderMode: {mode}\n{origin}{up}")
}

/// Kind, if stated, and screen filter of the comments; the last wins, as with the programs that write them.
pub(super) fn render_mode(
    path: &Path,
    comments: &[String],
    warnings: &mut Vec<String>,
) -> (Option<Primitive>, ScreenFilter) {
    let mut primitive = None;
    let mut filter = ScreenFilter::Classic;
    for comment in comments {
        if let Some(name) = comment.strip_prefix("SplatRenderMode:") {
            match name.trim() {
                "default" => (primitive, filter) = (Some(Primitive::Gaussian3d), ScreenFilter::Classic),
                "mip" => (primitive, filter) = (Some(Primitive::Gaussian3d), ScreenFilter::Mip),
                SURFELS => (primitive, filter) = (Some(Primitive::Surfel), ScreenFilter::Classic),
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
    (primitive, filter)
}

/// Origin of the means, if a comment gives it.
pub(super) fn origin(path: &Path, comments: &[String]) -> Result<DVec3> {
    Ok(vector(path, comments, ORIGIN, "the origin")?.unwrap_or(DVec3::ZERO))
}

/// Upward direction, if a comment gives it.
pub(super) fn up(path: &Path, comments: &[String]) -> Result<Option<DVec3>> {
    let name = "the upward direction";
    let up = vector(path, comments, UP, name)?;
    match up.is_some_and(|up| !(1e-9..1e9).contains(&up.length())) {
        true => Err(Error::file(path, format!("{name} has no length between 1e-9 and 1e9"))),
        false => Ok(up),
    }
}

/// Three finite numbers behind a prefix, if a comment has it.
fn vector(path: &Path, comments: &[String], prefix: &str, name: &str) -> Result<Option<DVec3>> {
    let Some(text) = comments.iter().find_map(|c| c.strip_prefix(prefix)) else {
        return Ok(None);
    };
    let numbers: Option<Vec<f64>> = text.split_whitespace().map(|n| n.parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, z]) if [x, y, z].iter().all(|v| v.is_finite()) => Ok(Some(DVec3::new(x, y, z))),
        _ => {
            let what = format!("{name} is not three numbers: {}", excerpt(text));
            Err(Error::file(path, what))
        }
    }
}
