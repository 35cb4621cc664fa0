//! `ashfall eval --depths`: depths and normals of a scene against the true ones.

use super::super::output::{Output, file_stem};
use super::super::{Outcome, engine};
use super::EvalArgs;
use crate::gpu::Gpu;
use crate::io;
use crate::io::exr::DepthImage;
use crate::mesh::{SurfaceImage, SurfaceScore};
use crate::render::{Compatibility, Outputs, RenderedImage};
use crate::scene::{Dataset, Splats};
use crate::{Error, Result};
use serde::Serialize;
use serde_json::json;
use std::path::Path;

/// Scores of a view by the depths of a picture.
#[derive(Serialize)]
struct ViewSurface {
    view: String,
    median: SurfaceScore,
    interquartile: SurfaceScore,
    expected: SurfaceScore,
}

/// Scores depths and normals of a scene in the views of which `truth` has a file.
pub(super) fn run(
    args: &EvalArgs,
    truth: &Path,
    (splats, gpu): (&Splats, &Gpu),
    (dataset, views): (&Dataset, &[usize]),
) -> Result<Outcome> {
    let outputs = Outputs {
        depth: true,
        surface: true,
        ..Outputs::default()
    };
    let near = engine::near(dataset);
    let mut draw = engine::scene_renderer(gpu, splats, near, outputs, Compatibility::Engine)?;
    let mut scores = Vec::new();
    for &index in views {
        let view = &dataset.views[index];
        let path = truth.join(format!("{}.exr", file_stem(&view.name)));
        if !path.exists() {
            continue;
        }
        let exact = io::exr::read_depth(&path)?;
        let (camera, size) = (&view.camera, [exact.width, exact.height]);
        if size != [camera.width, camera.height] {
            let [width, height] = size;
            let what = format!(
                "is {width} x {height} pixels, its view {} x {}",
                camera.width, camera.height
            );
            return Err(Error::file(&path, what));
        }
        let picture = draw(camera, args.background)?;
        scores.extend(score(&view.name, &picture, &exact));
    }
    engine::check(gpu)?;
    if scores.is_empty() {
        return Err(Error::file(truth, "holds depths (NAME.exr) of no view of that split"));
    }
    let mean = |of: fn(&ViewSurface) -> SurfaceScore| SurfaceScore::average(&scores.iter().map(of).collect::<Vec<_>>());
    let (median, expected) = (mean(|view| view.median), mean(|view| view.expected));
    let interquartile = mean(|view| view.interquartile);
    let named = [
        ("median", &median),
        ("interquartile", &interquartile),
        ("expected", &expected),
    ];
    Output { json: args.json }.result(table(scores.len(), named), || {
        json!({
            "scene": args.scene,
            "depths": truth,
            "splat_count": splats.len(),
            "mean": {"median": median, "interquartile": interquartile, "expected": expected},
            "views": scores,
        })
    });
    Ok(Outcome::Done)
}

/// Scores of a picture; `None` only if it was drawn without a surface.
fn score(view: &str, picture: &RenderedImage, exact: &DepthImage) -> Option<ViewSurface> {
    let surface = picture.surface.as_ref()?;
    let image = |depth, normal| SurfaceImage {
        width: exact.width as usize,
        depth,
        normal,
    };
    let truth = image(&exact.depth, &exact.normal);
    let by = |depth| SurfaceScore::of(&image(depth, &surface.normal), &truth);
    Some(ViewSurface {
        view: view.to_owned(),
        median: by(&surface.median_depth),
        interquartile: by(&surface.interquartile_depth),
        expected: by(&surface.expected_depth),
    })
}

fn table(views: usize, means: [(&str, &SurfaceScore); 3]) -> String {
    let (_, first) = means[0];
    let mut text = format!(
        "{views} views; {:.1} % of the pixels left out near borders, {:.2} % of the others without a surface",
        100.0 * first.border_share,
        100.0 * first.missing_share
    );
    for (name, score) in means {
        text += &format!(
            "\n{name:13} depth: error mean {:.3} %, median {:.3} %, signed median {:+.3} %; within 1 %: {:.1} %",
            100.0 * score.depth_mean,
            100.0 * score.depth_median,
            100.0 * score.depth_bias,
            100.0 * score.within_percent
        );
    }
    text + &format!(
        "\nnormals: mean {:.2}°, median {:.2}°; below 11.25°: {:.1} %",
        first.normal_mean_deg,
        first.normal_median_deg,
        100.0 * first.within_11_deg
    )
}
