//! Report of `ashfall prune` as text and JSON.

use super::PruneArgs;
use crate::cli::output::{bytes, grouped, score_text};
use crate::metrics::MeanScore;
use crate::scene::{Splats, sh_coefficient_count};
use crate::simplify::{Difference, MeasuredChange, MergeResult, PruneResult, ShReduction};
use serde_json::json;

/// Bytes of a scene as a .ply: position, normal, harmonics, opacity, scale and rotation in 32 bits each.
fn ply_bytes(splats: &Splats) -> u64 {
    let floats = 14 + 3 * sh_coefficient_count(splats.sh_degree);
    4 * floats as u64 * splats.len() as u64
}

/// Result of merging.
pub(super) struct MergeFigures {
    pub merged: MergeResult,
    /// Change of the training views' pictures.
    pub moved: Difference,
    /// Score of the merged scene.
    pub test: MeanScore,
}

impl MergeFigures {
    fn text(&self, share: f64) -> Vec<String> {
        let MergeResult { splats, gone } = &self.merged;
        let moved = &self.moved;
        let psnr = match moved.rms {
            0.0 => "they are the same".to_string(),
            _ => format!("PSNR {:.2} dB", moved.psnr_db()),
        };
        vec![
            format!(
                "merged: {} splats went into neighbours ({share} of all asked for), {} are left; no bound of that is proven",
                grouped(*gone),
                grouped(splats.len()),
            ),
            format!(
                "change of the training views' pictures by merging, measured at {} pixels: largest {:.6}, root mean square \
                 {:.6}, {psnr} of merged against before",
                grouped(moved.pixels),
                moved.most,
                moved.rms,
            ),
        ]
    }

    fn json(&self, share: f64) -> serde_json::Value {
        let moved = &self.moved;
        // JSON has no infinity: the PSNR of identical pictures is null.
        json!({
            "share": share,
            "merged_away": self.merged.gone,
            "splats_after_merge": self.merged.splats.len(),
            "bound": null,
            "train_change": {
                "pixels": moved.pixels,
                "most": moved.most,
                "rms": moved.rms,
                "psnr_db": moved.psnr_db(),
            },
            "test_after_merge": self.test,
        })
    }
}

/// Figures of the report.
pub(super) struct Figures {
    pub views: usize,
    pub merging: Option<MergeFigures>,
    /// Splats found in the scene, or in the merged one.
    pub pruned: PruneResult,
    /// Remaining splats after SH reduction.
    pub reduced: ShReduction,
    /// Change against the scene, or the merged one.
    pub change: MeasuredChange,
    /// Scores of the original scene, of the pruned one, and of that after a refit.
    pub test: Vec<MeanScore>,
}

impl Figures {
    pub(super) fn text(&self, args: &PruneArgs, before: &Splats) -> String {
        let (pruned, change) = (&self.pruned, &self.change);
        let after = &self.reduced.splats;
        let mut lines = Vec::new();
        let mut scene = before;
        if let Some((merging, share)) = self.merging.as_ref().zip(args.merge) {
            scene = &merging.merged.splats;
            lines = merging.text(share);
            lines.push("pruned after that, and proven against the merged scene, not the one before it:".into());
        }
        let share = 100.0 * pruned.count as f64 / scene.len().max(1) as f64;
        lines.extend([
            format!(
                "{} splats, {} → {} splats, {}: {} went ({share:.1} %), {} of them seen by no training view",
                grouped(scene.len()),
                bytes(ply_bytes(scene)),
                grouped(after.len()),
                bytes(ply_bytes(after)),
                grouped(pruned.count),
                grouped(pruned.unseen),
            ),
            format!(
                "{} contribution no more than {:.6} wherever they are seen; {} rounds over {} training views",
                grouped(pruned.light),
                args.error,
                pruned.rounds,
                self.views,
            ),
            format!(
                "largest change of {} pixels: {:.6}, where {:.6} was the bound; nearest to a bound: {:.3} of it",
                grouped(change.pixels),
                change.most,
                change.bound_there,
                change.nearest,
            ),
        ]);
        let [zero, one, two, three] = self.reduced.count_from_degree.map(grouped);
        let stored = before.sh_stride() * after.len();
        lines.push(format!(
            "degrees 0 to 3: {zero} · {one} · {two} · {three} splats, {:.1} % of their harmonics",
            100.0 * self.reduced.floats as f64 / stored.max(1) as f64
        ));
        let merged = self.merging.as_ref().map(|m| ("test views merged", &m.test));
        let names = ["test views before", "test views after ", "after the re-fit "];
        let mut scores: Vec<_> = names.into_iter().zip(&self.test).collect();
        scores.splice(1..1, merged);
        lines.extend(
            scores
                .iter()
                .map(|(name, score)| format!("{name}: {}", score_text(score))),
        );
        lines.push(match &args.out {
            Some(out) => format!("scene: {}", out.display()),
            None => "nothing was written: no --out".into(),
        });
        lines.join("\n")
    }

    pub(super) fn json(&self, args: &PruneArgs, before: &Splats) -> serde_json::Value {
        let (change, after) = (&self.change, &self.reduced.splats);
        json!({
            "scene": args.scene,
            "out": args.out,
            "error": args.error,
            "train_views": self.views,
            "splats_before": before.len(),
            "splats_after": after.len(),
            "ply_bytes_before": ply_bytes(before),
            "ply_bytes_after": ply_bytes(after),
            "merge": self.merging.as_ref().zip(args.merge).map(|(merging, share)| merging.json(share)),
            "removed": self.pruned.count,
            "unseen": self.pruned.unseen,
            "light": self.pruned.light,
            "rounds": self.pruned.rounds,
            "sh_error": args.sh_error,
            "splats_by_degree": self.reduced.count_from_degree,
            "sh_floats": self.reduced.floats,
            "change": {
                "pixels": change.pixels,
                "most": change.most,
                "bound_there": change.bound_there,
                "nearest": change.nearest,
                "broken": change.broken,
                "color_range": change.range,
            },
            "refit_iterations": args.refit,
            "test_before": self.test.first(),
            "test_after": self.test.get(1),
            "test_after_refit": self.test.get(2),
        })
    }
}
