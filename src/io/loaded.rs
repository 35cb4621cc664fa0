//! Splats as read from a file, collected one by one.

use crate::scene::{Axes, ScreenFilter, Splats};
use std::path::Path;

/// Splats read, with warnings about repairs and omissions, one sentence each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoadedSplats {
    /// Splats; in the axes of the file as a format's own reader returns them.
    pub splats: Splats,
    /// Warnings for the user; each names the file.
    pub warnings: Vec<String>,
    /// Format and axes of the file.
    pub stored: StoredAs,
}

/// Format of a file, and the axes of its splats.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StoredAs {
    /// Name and version of the format, such as `SPZ 4`.
    pub format: String,
    /// Axes of the positions in the file.
    pub axes: Axes,
    /// Source of the axes.
    pub axes_by: AxesBy,
}

impl StoredAs {
    /// Format that fixes its axes as those of 3DGS `.ply` files.
    pub(crate) fn ply(format: &str) -> StoredAs {
        StoredAs {
            format: format.to_owned(),
            axes: Axes::RDF,
            axes_by: AxesBy::Format,
        }
    }
}

/// Source of a file's axes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AxesBy {
    /// The format fixes them.
    #[default]
    Format,
    /// The file states them.
    File,
    /// The file does not state them, and writers of the format differ.
    Assumption,
    /// The user.
    Choice,
}

/// Smallest scale of a flat splat in world units, as zero has no logarithm.
pub(crate) const SCALE_MIN: f32 = 1e-10;

/// Logit of an opacity of 0 or 1, whose own are infinite: e⁻²⁰ from either.
const LOGIT_LIMIT: f32 = 20.0;

/// One splat of a file.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StoredSplat<'a> {
    pub(crate) mean: [f32; 3],
    /// w, x, y, z of any length but zero.
    pub(crate) quaternion: [f32; 4],
    pub(crate) log_scale: [f32; 3],
    pub(crate) opacity_logit: f32,
    /// `[coefficient][rgb]`, the constant one included.
    pub(crate) sh: &'a [f32],
}

/// Collector of a file's splats. Splats with NaN or with an infinite position, rotation, scale or colour are dropped;
/// logits of ±∞, which are opacities of 1 and 0, become ±20, and a log-scale of −∞, which is a flat splat, that of
/// [`SCALE_MIN`]; quaternions of length zero become no rotation.
pub(crate) struct Collector {
    splats: Splats,
    dropped: usize,
    /// Index in the file of the first dropped splat.
    dropped_first: usize,
    unrotated: usize,
}

impl Collector {
    /// Collector with room for `count` splats; the caller has compared the count with the file's size.
    pub(crate) fn new(count: usize, sh_degree: u32, filter: ScreenFilter) -> Collector {
        let mut splats = Splats {
            sh_degree,
            filter,
            ..Splats::default()
        };
        splats.mean.reserve_exact(count);
        splats.quaternion.reserve_exact(count);
        splats.log_scale.reserve_exact(count);
        splats.opacity_logit.reserve_exact(count);
        splats.sh.reserve_exact(count * splats.sh_stride());
        Collector {
            splats,
            dropped: 0,
            dropped_first: 0,
            unrotated: 0,
        }
    }

    /// Splats seen so far.
    fn count(&self) -> usize {
        self.splats.len() + self.dropped
    }

    /// Adds the next splat of the file.
    pub(crate) fn push(&mut self, splat: &StoredSplat) {
        let log_scale = splat
            .log_scale
            .map(|s| if s == f32::NEG_INFINITY { SCALE_MIN.ln() } else { s });
        let opacity_logit = match splat.opacity_logit.is_infinite() {
            true => LOGIT_LIMIT.copysign(splat.opacity_logit),
            false => splat.opacity_logit,
        };
        let geometry = splat.mean.iter().chain(&splat.quaternion).chain(&log_scale);
        if !geometry.chain([&opacity_logit]).chain(splat.sh).all(|v| v.is_finite()) {
            if self.dropped == 0 {
                self.dropped_first = self.splats.len();
            }
            self.dropped += 1;
            return;
        }
        let mut quaternion = splat.quaternion;
        if quaternion.iter().all(|q| q.abs() < f32::MIN_POSITIVE) {
            self.unrotated += 1;
            quaternion = [1.0, 0.0, 0.0, 0.0];
        }
        let splats = &mut self.splats;
        splats.mean.push(splat.mean);
        splats.quaternion.push(quaternion);
        splats.log_scale.push(log_scale);
        splats.opacity_logit.push(opacity_logit);
        splats.sh.extend(splat.sh);
    }

    /// The splats, with a warning for each kind of repair after those given.
    pub(crate) fn finish(self, path: &Path, stored: StoredAs, mut warnings: Vec<String>) -> LoadedSplats {
        let (count, path) = (self.count(), path.display());
        if self.dropped > 0 {
            warnings.push(format!(
                "{path}: {} of {count} splats hold values that are not finite and were dropped, number {} \
                 (counted from 0) the first",
                self.dropped, self.dropped_first
            ));
        }
        if self.unrotated > 0 {
            warnings.push(format!(
                "{path}: {} of {count} splats have a quaternion of length zero, read as no rotation",
                self.unrotated
            ));
        }
        if self.splats.is_empty() {
            warnings.push(format!("{path}: holds no splats"));
        }
        LoadedSplats {
            splats: self.splats,
            warnings,
            stored,
        }
    }
}

/// Opacity of a logit.
pub(crate) fn opacity(logit: f32) -> f32 {
    1.0 / (1.0 + (-logit).exp())
}

/// Logit of an opacity.
pub(crate) fn logit(opacity: f32) -> f32 {
    (opacity / (1.0 - opacity)).ln()
}

/// Logit of an opacity in 255ths. The ends stand for the middle of their rounding interval, because their own logits
/// are infinite.
pub(crate) fn logit_of_byte(byte: u8) -> f32 {
    let opacity = match byte {
        0 => 0.25,
        255 => 254.75,
        other => f32::from(other),
    };
    logit(opacity / 255.0)
}
