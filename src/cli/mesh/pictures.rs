//! Pictures of a mesh beside photographs, and its scores.

use crate::Result;
use crate::cli::engine;
use crate::cli::output::{Output, figure, file_stem};
use crate::cli::render::picture::normal_picture;
use crate::gpu::Gpu;
use crate::lab::report::side_by_side;
use crate::mesh::{MeshPicture, draw};
use crate::metrics::{Image, MeanScore, Target, psnr_db};
use crate::scene::{Dataset, Mesh, Splats};
use crate::stats::mean;
use serde::Serialize;
use std::path::Path;

/// Mean scores against the photographs of some views.
#[derive(Debug, Serialize)]
pub(super) struct MeshScores {
    pub(super) mesh: MeanScore,
    pub(super) splats: MeanScore,
    pub(super) covered: CoveredScores,
}

/// Means of views over the pixels that the mesh covers.
#[derive(Debug, Serialize)]
pub(super) struct CoveredScores {
    /// Share of the photographs' pixels.
    pub(super) share: f64,
    /// `None` if it covers none.
    pub(super) mesh_psnr_db: Option<f64>,
    pub(super) splats_psnr_db: Option<f64>,
}

impl MeshScores {
    /// One line of text, with its beginning.
    pub(super) fn line(&self) -> String {
        let MeshScores { mesh, splats, covered } = self;
        format!(
            "\n{} views: mesh {} dB, SSIM {}; splats {} dB, SSIM {}\nover the {:.1} % of their pixels that the mesh covers: \
             mesh {} dB, splats {} dB",
            mesh.views,
            figure(mesh.psnr_db, 2),
            figure(mesh.ssim, 4),
            figure(splats.psnr_db, 2),
            figure(splats.ssim, 4),
            100.0 * covered.share,
            figure(covered.mesh_psnr_db, 2),
            figure(covered.splats_psnr_db, 2)
        )
    }
}

impl CoveredScores {
    /// Share, and PSNR of mesh and splats, of a view.
    fn of_view(target: &Target, mesh: &MeshPicture, splats: &[[f32; 3]]) -> [f64; 3] {
        let whole = target.weights.clone().unwrap_or_else(|| vec![1.0; mesh.depth.len()]);
        let seen = whole.iter().zip(&mesh.depth);
        let weights: Vec<f32> = seen
            .map(|(weight, depth)| if depth.is_finite() { *weight } else { 0.0 })
            .collect();
        let sum = |of: &[f32]| of.iter().copied().map(f64::from).sum::<f64>();
        let [photo, mesh, splats] =
            [&target.rgb, &mesh.rgb, splats].map(|rgb| Image::new(target.width, target.height, rgb));
        let psnr = |of| psnr_db(of, photo, Some(&weights));
        [sum(&weights) / sum(&whole), psnr(mesh), psnr(splats)]
    }

    fn of(views: &[[f64; 3]]) -> CoveredScores {
        let [share, mesh_psnr_db, splats_psnr_db] = [0, 1, 2].map(|of| {
            let finite: Vec<f64> = views.iter().map(|view| view[of]).filter(|x| x.is_finite()).collect();
            (!finite.is_empty()).then(|| mean(&finite))
        });
        CoveredScores {
            share: share.unwrap_or(0.0),
            mesh_psnr_db,
            splats_psnr_db,
        }
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
        let covered = CoveredScores::of_view(target, &picture, &evaluated.rendered.rgb);
        Ok(([score, evaluated.score()], covered))
    })?;
    bar.finish_and_clear();
    let (scores, covered): (Vec<_>, Vec<_>) = scores.into_iter().unzip();
    let [mesh, splats] = [0, 1].map(|of| {
        let scores: Vec<_> = scores.iter().map(|pair| pair[of].clone()).collect();
        MeanScore::of(&scores)
    });
    Ok(MeshScores {
        mesh,
        splats,
        covered: CoveredScores::of(&covered),
    })
}
