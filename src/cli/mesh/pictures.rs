//! Pictures of a mesh beside photographs, and its scores.

use crate::Result;
use crate::cli::engine;
use crate::cli::output::{Output, figure, file_stem};
use crate::cli::render::picture::normal_picture;
use crate::gpu::Gpu;
use crate::lab::report::side_by_side;
use crate::mesh::draw;
use crate::metrics::MeanScore;
use crate::scene::{Dataset, Mesh, Splats};
use serde::Serialize;
use std::path::Path;

/// Mean scores against the photographs of some views.
#[derive(Debug, Serialize)]
pub(super) struct MeshScores {
    pub(super) mesh: MeanScore,
    pub(super) splats: MeanScore,
}

impl MeshScores {
    /// One line of text, with its beginning.
    pub(super) fn line(&self) -> String {
        let MeshScores { mesh, splats } = self;
        format!(
            "\n{} views: mesh {} dB, SSIM {}; splats {} dB, SSIM {}",
            mesh.views,
            figure(mesh.psnr_db, 2),
            figure(mesh.ssim, 4),
            figure(splats.psnr_db, 2),
            figure(splats.ssim, 4)
        )
    }
}

/// Writes photograph | splats | mesh | normals of the mesh of each view to a folder, under the view's name.
pub(super) fn write(
    folder: &Path,
    output: Output,
    gpu: &Gpu,
    (dataset, views): (&Dataset, &[usize]),
    (splats, mesh): (&Splats, &Mesh),
) -> Result<MeshScores> {
    let background = [0.0; 3];
    let mut evaluator = engine::evaluator(gpu, dataset, views, background);
    let bar = output.bar(views.len() as u64, "pictures");
    let near = engine::near(dataset);
    let scores = evaluator.map(splats, |evaluated| {
        let (target, camera) = (evaluated.target, &evaluated.view.camera);
        let picture = draw(mesh, camera, near, background);
        let opaque = |[r, g, b, _]: [f32; 4]| [r, g, b];
        let normals: Vec<[f32; 3]> = normal_picture(camera, &picture.normal)
            .into_iter()
            .map(opaque)
            .collect();
        let path = folder.join(file_stem(&evaluated.view.name) + ".png");
        let pictures = [&target.rgb, &evaluated.rendered.rgb, &picture.rgb, &normals];
        side_by_side(
            &path,
            [target.width, target.height],
            &pictures.map(|pixels| &pixels[..]),
        )?;
        bar.inc(1);
        let score = target.score(&evaluated.view.name, &picture.rgb);
        Ok([score, evaluated.score()])
    })?;
    bar.finish_and_clear();
    let [mesh, splats] = [0, 1].map(|of| {
        let scores: Vec<_> = scores.iter().map(|pair| pair[of].clone()).collect();
        MeanScore::of(&scores)
    });
    Ok(MeshScores { mesh, splats })
}
