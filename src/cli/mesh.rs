//! `ashfall mesh`: a triangle mesh of a scene's surface.

mod decimate;
mod pictures;

use super::args::{DataArgs, DeviceArgs, SplitArg};
use super::engine::near;
use super::interrupt::Interrupt;
use super::output::{Output, bytes, grouped};
use super::scene::{SceneArgs, fit_axes};
use super::{Outcome, engine, parse};
use crate::gpu::Gpu;
use crate::io::mesh::MeshFormat;
use crate::io::splats::readable;
use crate::mesh::{
    ColorFitOptions, DepthMap, DepthMaps, FusionOptions, FusionPhase, FusionReport, clean, fit_colors, fuse,
};
use crate::render::{Compatibility, Outputs, RenderedImage};
use crate::scene::{Camera, Dataset, Mesh, Splats, Split};
use crate::{Error, Result, io};
use clap::{Args, ValueEnum};
use indicatif::ProgressBar;
use serde_json::json;
use std::path::PathBuf;

/// Write a triangle mesh of a scene's surface
///
/// Depths of the data set's views are smoothed within surfaces, moved so that the pictures agree, and fused to a
/// volume of signed distances around the surface, whose zero is the mesh. Where no two views saw anything the mesh is
/// open. Small pieces are left out. Colours are fitted to the views.
#[derive(Clone, Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct MeshArgs {
    #[arg(value_name = "SCENE", help = format!("The scene, {}", readable()))]
    scene: PathBuf,
    /// Data set or transforms.json with the cameras; photographs need not exist
    #[arg(value_name = "DATA")]
    data: PathBuf,
    /// Output file: .ply, .obj or .glb
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Edge of a voxel, world units [default: a pixel's footprint at the median depth, but at most 2048 across]
    #[arg(long, value_name = "H", value_parser = parse::positive)]
    voxel: Option<f64>,
    /// Distance from the surface at which views are fused, world units [default: 4 voxels]
    #[arg(long, value_name = "H", value_parser = parse::positive)]
    truncation: Option<f64>,
    /// Keep the N largest pieces [default: those of 100 triangles and a hundredth of the largest one's area]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    largest: Option<u32>,
    /// Reduce the mesh to at most N triangles
    #[arg(long, value_name = "N", value_parser = parse::count)]
    triangles: Option<usize>,
    /// Close the mesh: unseen parts are solid, and a surface seen from one side gets a back
    #[arg(long)]
    closed: bool,
    /// Depth of a pixel. interquartile: mean of the middle half, smooth; median: on one surface, in steps; expected:
    /// mean of all, between surfaces at borders; means: that of the splats' means, for comparison
    #[arg(long, value_name = "DEPTH", default_value = "interquartile")]
    depth: DepthArg,
    /// Standard deviation of the smoothing of depths within surfaces, pixels; 0 for none
    #[arg(long, value_name = "PIXELS", default_value = "1.5", value_parser = parse::deviation)]
    smooth: f64,
    /// Leave depths where the splats have them, not moved so that the views' pictures agree
    #[arg(long)]
    unaligned: bool,
    /// Views to fuse
    #[arg(long, value_name = "SPLIT", default_value = "all")]
    split: SplitArg,
    /// Memory for voxels, e.g. 512M; a volume beyond is fused in slabs
    #[arg(long, value_name = "SIZE", default_value = "160M", value_parser = parse::size)]
    volume_memory: u64,
    /// Write photograph | splats | mesh | normals of each held-out view, of all without any, to DIR, and score mesh and
    /// splats against the photographs
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
    /// Print one JSON object instead of text
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    scene_options: SceneArgs,
    #[command(flatten)]
    options: DataArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

const EXAMPLES: &str = "\
Examples:
  ashfall mesh run/scene.ply photos/ --out mesh.ply
  ashfall mesh run/scene.ply photos/ --out mesh.glb --voxel 0.01 --largest 1
  ashfall mesh run/scene.ply photos/ --out mesh.ply --pictures views/
  ashfall mesh run/scene.ply photos/ --out print.obj --closed --triangles 100000";

/// Depth of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum DepthArg {
    Interquartile,
    Median,
    Expected,
    Means,
}

pub(super) fn run(args: &MeshArgs) -> Result<Outcome> {
    let output = Output { json: args.json };
    MeshFormat::of(&args.out)?;
    let folder = args.out.parent().filter(|folder| !folder.as_os_str().is_empty());
    if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
        return Err(Error::file(folder, "is no folder"));
    }
    let scene = args.scene_options.read(&args.scene)?;
    let mut dataset = args.options.open(&args.data, args.pictures.is_some())?;
    dataset.set_origin(scene.splats.origin);
    let views = dataset.split(args.split.into());
    if views.is_empty() {
        return Err(Error::file(&args.data, "no view belongs to that split"));
    }
    let interrupt = Interrupt::listen()?;
    let gpu = engine::open(&args.device)?;
    let splats = fit_axes(&args.scene, scene, &gpu, &dataset, [0.0; 3])?;
    let outputs = Outputs {
        surface: true,
        depth: args.depth == DepthArg::Means,
        ..Outputs::default()
    };
    let mut draw = engine::scene_renderer(&gpu, &splats, near(&dataset), outputs, Compatibility::Engine)?;
    let mut maps = DepthMaps::new(views.len(), |view| {
        let camera = &dataset.views[views[view]].camera;
        let mut map = map_of(camera, &draw(camera, [0.0; 3])?, args.depth);
        map.smooth(args.smooth);
        Ok(map)
    });
    let bar = output.bar(6 * views.len() as u64, "views");
    let fused = mesh(args, (&bar, &interrupt), (&mut maps, views.len(), near(&dataset)));
    bar.finish_and_clear();
    let fused = match fused {
        Err(_) if interrupt.is_requested() => {
            eprintln!("interrupted; nothing was written");
            return Ok(Outcome::Interrupted);
        }
        fused => fused?,
    };
    drop(maps);
    engine::check(&gpu)?;
    finish(args, output, &fused, (&splats, &gpu, &dataset))
}

/// Mesh of the maps of `count` views, with progress; ends with an error if it is interrupted.
fn mesh(
    args: &MeshArgs,
    (bar, interrupt): (&ProgressBar, &Interrupt),
    (maps, count, near): (&mut DepthMaps<'_>, usize, f64),
) -> Result<FusedMesh> {
    let options = FusionOptions {
        voxel: args.voxel,
        truncation: args.truncation,
        closed: args.closed,
        memory: args.volume_memory,
    };
    let advance = || {
        bar.inc(1);
        match interrupt.is_requested() {
            true => Err(Error::Config("interrupted".into())),
            false => Ok(()),
        }
    };
    // Survey, list and colours; drawing and alignment.
    let once = if args.unaligned { 3 } else { 5 };
    if !args.unaligned {
        maps.align(advance)?;
    }
    let (mut mesh, report) = fuse(&options, maps, |phase, _| {
        if let FusionPhase::Add(_, slabs) = phase {
            let passes = if args.closed { 2 } else { 1 };
            bar.set_length((once + passes * slabs as u64) * count as u64);
        }
        advance()
    })?;
    let removed = clean(&mut mesh, args.largest.map(|count| count as usize));
    if let Some(triangles) = args.triangles {
        decimate::decimate(&mut mesh, triangles)?;
    }
    let options = ColorFitOptions {
        near,
        distance_max: report.truncation,
    };
    fit_colors(&mut mesh, options, maps, |_| advance())?;
    Ok(FusedMesh { mesh, removed, report })
}

fn map_of(camera: &Camera, picture: &RenderedImage, depth: DepthArg) -> DepthMap {
    let Some(surface) = &picture.surface else {
        unreachable!("frames are drawn with surfaces")
    };
    let means;
    let depth = match depth {
        DepthArg::Interquartile => &surface.interquartile_depth,
        DepthArg::Median => &surface.median_depth,
        DepthArg::Expected => &surface.expected_depth,
        DepthArg::Means => {
            let pairs = picture.mean_depth().into_iter().zip(&surface.median_depth);
            means = pairs
                .map(|(mean, at)| if at.is_nan() { f32::NAN } else { mean })
                .collect();
            &means
        }
    };
    DepthMap::new(camera, depth, &surface.normal, &picture.rgb, &picture.alpha())
}

/// A mesh with the figures of its fusion.
struct FusedMesh {
    mesh: Mesh,
    /// Small pieces left out.
    removed: usize,
    report: FusionReport,
}

/// Writes the mesh and its pictures.
fn finish(
    args: &MeshArgs,
    output: Output,
    FusedMesh { mesh, removed, report }: &FusedMesh,
    (splats, gpu, dataset): (&Splats, &Gpu, &Dataset),
) -> Result<Outcome> {
    if mesh.triangles.is_empty() {
        let text = "no two views agree on a surface: the mesh is empty; try a larger --voxel or --truncation";
        return Err(Error::Config(text.into()));
    }
    io::mesh::write(&args.out, mesh, splats.origin)?;
    let scores = args.pictures.as_deref().map(|folder| {
        std::fs::create_dir_all(folder).map_err(Error::io(folder))?;
        let views = match dataset.split(Split::Test) {
            views if views.is_empty() => dataset.split(Split::All),
            views => views,
        };
        pictures::write(folder, output, gpu, (dataset, &views), (splats, mesh))
    });
    let scores = scores.transpose()?;
    let mut text = format!(
        "{} triangles, {} vertices in {}; {removed} small pieces left out\nvoxel {:.3e}, truncation {:.3e}, {} blocks \
         in {} slabs, {} at a time",
        grouped(mesh.triangles.len()),
        grouped(mesh.positions.len()),
        args.out.display(),
        report.voxel,
        report.truncation,
        grouped(report.blocks),
        report.slabs,
        bytes(report.slab_bytes),
    );
    if let Some(scores) = &scores {
        text += &scores.line();
    }
    output.result(text, || {
        json!({
            "mesh": args.out,
            "triangles": mesh.triangles.len(),
            "vertices": mesh.positions.len(),
            "pieces_left_out": removed,
            "voxel": report.voxel,
            "truncation": report.truncation,
            "depth_median": report.depth_median,
            "blocks": report.blocks,
            "slabs": report.slabs,
            "slab_bytes": report.slab_bytes,
            "scores": scores,
        })
    });
    Ok(Outcome::Done)
}
