//! Cameras of views, moved before they are scored: by a similarity to other poses, or to fit their photographs.

use super::EvalArgs;
use crate::Result;
use crate::cli::cameras::{CameraPairs, similarity_value};
use crate::cli::engine;
use crate::cli::output::Output;
use crate::gpu::Gpu;
use crate::render::Model;
use crate::scene::{Camera, Dataset, PoseDifference, Similarity, Splats};
use crate::train::poses::PoseAdjustment;
use serde_json::{Value, json};

/// Moves of cameras before the evaluation.
#[derive(Default)]
pub(super) struct CameraMoves {
    similarity: Option<Similarity>,
    /// Root mean squares of the motions of aligned views; distance in percent of the extent.
    alignment: Option<PoseDifference>,
}

impl CameraMoves {
    /// With `--poses`, gives training views the poses of another reconstruction, and moves the others by the similarity
    /// to it. No test view takes part in it.
    pub(super) fn to_poses(args: &EvalArgs, dataset: &mut Dataset) -> Result<CameraMoves> {
        let Some(path) = &args.poses else {
            return Ok(CameraMoves::default());
        };
        let pairs = CameraPairs::read(dataset, &args.options, path)?;
        let (similarity, others) = (pairs.similarity(), pairs.others());
        for view in &mut dataset.views {
            view.camera = match others.get(view.name.as_str()) {
                Some(other) => Camera {
                    rotation: other.rotation,
                    position: other.position,
                    ..view.camera
                },
                None => similarity.moved(&view.camera),
            };
        }
        Ok(CameraMoves {
            similarity: Some(similarity),
            alignment: None,
        })
    }

    /// With `--align`, moves each view to fit its photograph to the scene.
    pub(super) fn align(
        &mut self,
        args: &EvalArgs,
        splats: &Splats,
        gpu: &Gpu,
        (dataset, views): (&mut Dataset, &[usize]),
    ) -> Result<()> {
        if !args.align {
            return Ok(());
        }
        let extent = dataset.extent();
        let adjustment = PoseAdjustment {
            dataset,
            views,
            extent,
            options: engine::view_options(dataset, args.background, splats.filter),
        };
        let bar = Output { json: args.json }.bar(views.len() as u64, "views aligned");
        let cameras = adjustment.resect(gpu, &Model::upload(gpu, splats)?, || bar.inc(1))?;
        bar.finish_and_clear();
        let mut differences = Vec::new();
        for (&view, camera) in views.iter().zip(cameras) {
            let moved = &mut dataset.views[view].camera;
            differences.push(PoseDifference::of(moved, &camera));
            *moved = camera;
        }
        let rms = PoseDifference::rms(&differences);
        self.alignment = Some(PoseDifference {
            distance: 100.0 * rms.distance / extent,
            ..rms
        });
        Ok(())
    }

    /// Poses that were scored: as given (`raw`), moved by a similarity (`sim3`), or fitted (`aligned`).
    fn name(&self) -> &'static str {
        match (&self.similarity, &self.alignment) {
            (_, Some(_)) => "aligned",
            (Some(_), None) => "sim3",
            (None, None) => "raw",
        }
    }

    /// Lines for people; empty for poses as given.
    pub(super) fn text(&self) -> String {
        let mut text = String::new();
        if let Some(similarity) = &self.similarity {
            text += &format!(
                "\nposes: sim3, test cameras moved by the similarity of scale {:.6} and {:.4}°",
                similarity.scale,
                similarity.degrees()
            );
        }
        if let Some(rms) = &self.alignment {
            text += &format!(
                "\nposes: aligned, each camera fitted to its photograph by 6 numbers: {:.4}° and {:.4} % of the extent \
                 (rms)",
                rms.degrees, rms.distance
            );
        }
        text
    }

    /// Values `poses`, `similarity` and `alignment`.
    pub(super) fn values(&self) -> [Value; 3] {
        let alignment = self.alignment.map(|rms| {
            json!({
                "rms_degrees": rms.degrees,
                "rms_percent_of_extent": rms.distance,
            })
        });
        let similarity = self.similarity.as_ref().map(similarity_value);
        [json!(self.name()), json!(similarity), json!(alignment)]
    }
}
