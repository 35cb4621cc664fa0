//! Layers of every pixel of an exact frame.

use super::{FAINT, SAME_DEPTH};
use crate::reference::frame::{center, project_all, sorted};
use crate::reference::rasterize::{layer, raw_alpha};
use crate::reference::{Options, Pixel, ScreenSplat, Splat, Thresholds, Viewpoint};
use crate::scene::{Camera, Splats};

/// Squared standard deviations beyond which `raw_alpha` is 0: the power is over 50.
const REACH: f64 = 100.0;

/// Projected splats of a frame, nearest first.
pub(super) struct Screen {
    pub(super) list: Vec<ScreenSplat<f64>>,
    splat_from_rank: Vec<usize>,
    width: usize,
    pub(super) height: usize,
}

/// A splat at a pixel.
pub(super) struct Slice {
    /// Index in the scene.
    pub(super) splat: usize,
    /// Index in the [`Screen`]'s list.
    pub(super) rank: usize,
    pub(super) alpha: f64,
    /// Alpha before its cap.
    pub(super) raw: f64,
    pub(super) color: [f64; 3],
    pub(super) depth: f64,
    /// Transmittance in front of it.
    pub(super) before: f64,
}

/// All layers of a pixel, nearest first.
pub(super) struct Stack {
    pub(super) slices: Vec<Slice>,
    pub(super) pixel: Pixel<f64>,
    /// Centre of the pixel.
    pub(super) at: [f64; 2],
}

/// Consecutive slices of practically the same depth, which may come in any order.
pub(super) struct Group {
    /// Range of slice indices.
    pub(super) slices: std::ops::Range<usize>,
    /// Σ α.
    pub(super) sum: f64,
    /// Σ α α over its pairs.
    pub(super) pairs: f64,
    /// Transmittance in front of it.
    pub(super) before: f64,
}

impl Screen {
    pub(super) fn new(splats: &Splats, camera: &Camera, options: &Options) -> Screen {
        let view = Viewpoint::new(camera, options, splats.filter);
        let (list, splat_from_rank) = sorted(&project_all(&Splat::<f64>::all(splats), &view));
        Screen {
            list,
            splat_from_rank,
            width: camera.width as usize,
            height: camera.height as usize,
        }
    }

    /// Stacks of a row of pixels, from the left.
    pub(super) fn row(&self, row: usize) -> impl Iterator<Item = Stack> {
        let y = row as f64 + 0.5;
        // `power` is at least half the squared distance along one axis, in variances: beyond `REACH` in y, alpha is 0.
        let reaches = |s: &ScreenSplat<f64>| (y - s.mean[1]).powi(2) <= REACH * s.covariance[2];
        let near = (0..self.list.len()).filter(|&i| reaches(&self.list[i]));
        let near: Vec<usize> = near.collect();
        let pixels = row * self.width..(row + 1) * self.width;
        pixels.map(move |pixel| self.stack(&near, center(pixel, self.width)))
    }

    fn stack(&self, near: &[usize], at: [f64; 2]) -> Stack {
        let mut stack = Stack {
            slices: Vec::new(),
            pixel: Pixel::clear(),
            at,
        };
        for &rank in near {
            let splat = &self.list[rank];
            let Some(layer) = layer(splat, at, &Thresholds::NONE) else {
                continue;
            };
            stack.slices.push(Slice {
                splat: self.splat_from_rank[rank],
                rank,
                alpha: layer.alpha,
                raw: raw_alpha(splat, at),
                color: layer.color,
                depth: layer.depth,
                before: stack.pixel.transmittance,
            });
            stack.pixel = stack.pixel.over(&layer);
        }
        stack
    }
}

impl Stack {
    /// Range of each channel among the background and splats of at least this alpha.
    pub(super) fn ranges(&self, background: [f64; 3], alpha_min: f64) -> [f64; 3] {
        let (mut low, mut high) = (background, background);
        for slice in self.slices.iter().filter(|s| s.alpha >= alpha_min) {
            for channel in 0..3 {
                low[channel] = low[channel].min(slice.color[channel]);
                high[channel] = high[channel].max(slice.color[channel]);
            }
        }
        [0, 1, 2].map(|c| high[c] - low[c])
    }

    /// Largest range of a channel.
    pub(super) fn range(&self, background: [f64; 3], alpha_min: f64) -> f64 {
        let ranges = self.ranges(background, alpha_min);
        ranges.into_iter().fold(0.0, f64::max)
    }

    /// Weight of all splats too faint to widen the range.
    pub(super) fn faint(&self) -> f64 {
        let faint = self.slices.iter().filter(|s| s.alpha < FAINT);
        faint.map(|s| s.alpha * s.before).sum()
    }

    /// Slices grouped by depth.
    pub(super) fn groups(&self) -> Vec<Group> {
        let mut groups = Vec::new();
        let mut first = 0;
        for end in 1..=self.slices.len() {
            let apart = |s: &[Slice]| s[end].depth - s[end - 1].depth > SAME_DEPTH * s[end].depth;
            if end < self.slices.len() && !apart(&self.slices) {
                continue;
            }
            let group = &self.slices[first..end];
            let sum: f64 = group.iter().map(|s| s.alpha).sum();
            let squares: f64 = group.iter().map(|s| s.alpha * s.alpha).sum();
            groups.push(Group {
                slices: first..end,
                sum,
                // Σ_{i<j} αᵢ αⱼ; rounding must not make it negative.
                pairs: 0.5 * (sum * sum - squares).max(0.0),
                before: group[0].before,
            });
            first = end;
        }
        groups
    }
}
