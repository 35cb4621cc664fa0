//! `ashfall demo`: end-to-end check on a synthetic scene: photograph, train, render.

use super::Outcome;
use super::args::{DataArgs, DeviceArgs};
use super::output::{Output, file_stem};
use super::render::orbit_of_cameras;
use super::train::{Session, begin_made};
use super::{engine, parse};
use crate::gpu::Gpu;
use crate::io::mesh::MeshFormat;
use crate::lab::synth::{self, Kind, Scene, SynthOptions};
use crate::render::{Compatibility, Outputs};
use crate::scene::{Camera, Dataset, Split};
use crate::simplify::AutoRun;
use crate::train::{ExposureModel, TrainConfig};
use crate::{Error, Result, io};
use clap::{Args, ValueEnum};
use glam::DVec3;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Make a small scene, photograph it, train on the photographs and draw the result
///
/// Needs no data. The photographs are rays cast on the CPU at a composition of textured shapes; the
/// data set stays in DIR/data, in nerfstudio's form, for `ashfall train` to try other options on. With
/// --perturb it has a fault of real captures, known exactly (truth.json, and truth/ for cameras and masks), and
/// COLMAP's form.
#[derive(Clone, Debug, Args)]
pub(super) struct DemoArgs {
    /// Folder for everything, made if it is not there
    #[arg(long, value_name = "DIR", default_value = "out/demo")]
    out: PathBuf,
    /// Optimisation steps
    #[arg(long, value_name = "N", default_value_t = 1_000)]
    iterations: u32,
    /// Seed of all random numbers
    #[arg(long, value_name = "S", default_value_t = 0)]
    seed: u64,
    /// Photographs
    #[arg(long, value_name = "N", default_value_t = 32, value_parser = clap::value_parser!(u32).range(2..=10_000))]
    photos: u32,
    /// Scene: plane, sphere, solids, demo, intricate, foliage, facade, knot, cage, or a mesh (.ply, .obj), which gets a
    /// texture
    #[arg(long, value_name = "NAME|MESH", default_value = "demo", value_parser = MadeScene::parse)]
    scene: MadeScene,
    /// Write the true mesh, and depths and normals of the test views, to DIR/data/truth
    #[arg(long)]
    truth: bool,
    /// Width and height of the photographs
    #[arg(long, value_name = "WxH", default_value = "192x144", value_parser = parse::image_size)]
    size: [u32; 2],
    /// Fault of the training photographs; the test photographs have none
    #[arg(long, value_name = "FAULT")]
    perturb: Option<PerturbArg>,
    /// Write the data set to DIR/data and stop
    #[arg(long)]
    data_only: bool,
    /// Pictures of the orbit
    #[arg(long, value_name = "N", default_value_t = 24)]
    orbit: u32,
    /// Print JSON lines instead of text
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    device: DeviceArgs,
}

/// Scene to photograph.
#[derive(Clone, Debug, PartialEq, Eq)]
enum MadeScene {
    BuiltIn(Kind),
    Mesh(PathBuf),
}

impl MadeScene {
    fn parse(text: &str) -> std::result::Result<MadeScene, String> {
        let kind = Kind::ALL.into_iter().find(|kind| kind.name() == text);
        let path = PathBuf::from(text);
        match (kind, MeshFormat::of(&path)) {
            (Some(kind), _) => Ok(MadeScene::BuiltIn(kind)),
            (None, Ok(_)) => Ok(MadeScene::Mesh(path)),
            (None, Err(_)) => Err(format!(
                "there are {}, and .ply and .obj meshes",
                Kind::ALL.map(Kind::name).join(", ")
            )),
        }
    }

    fn make(&self) -> Result<Scene> {
        match self {
            MadeScene::BuiltIn(kind) => Ok(synth::scene(*kind)),
            MadeScene::Mesh(path) => {
                let (mesh, _) = io::mesh::read(path)?;
                match mesh.triangles.is_empty() {
                    true => Err(Error::file(path, "has no triangles")),
                    false => Ok(synth::of_mesh(&mesh)),
                }
            }
        }
    }
}

/// Fault of real captures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum PerturbArg {
    /// Exposures within one stop and white balances within a quarter, at random
    Exposure,
    /// Errors of the training cameras, half a degree and half a percent of the extent (rms)
    Poses,
    /// A fisheye lens of 160°
    Fisheye,
    /// Opaque boxes before a fifth of the training photographs
    Transients,
    /// A lens that darkens the corners by 0.7 stops
    Vignetting,
    /// None, but a textured sky without points about the scene
    Sky,
    /// Exposures, half the errors of cameras, and boxes together
    All,
    /// None: the control, in the same form
    None,
}

/// Faults of an argument.
struct MadeFaults {
    exposure: bool,
    /// Size of the errors of cameras, 1 for those of `--perturb poses`; 0: none.
    poses: f64,
    transients: bool,
}

impl MadeFaults {
    fn of(args: &DemoArgs) -> MadeFaults {
        use PerturbArg::{All, Exposure, Poses, Transients};
        MadeFaults {
            exposure: matches!(args.perturb, Some(Exposure | All)),
            poses: match args.perturb {
                Some(Poses) => 1.0,
                Some(All) => 0.5,
                _ => 0.0,
            },
            transients: matches!(args.perturb, Some(Transients | All)),
        }
    }
}

pub(super) fn run(args: &DemoArgs) -> Result<Outcome> {
    let output = Output { json: args.json };
    let start = Instant::now();
    // Opened first: without a device the rest is useless.
    let gpu = (!args.data_only).then(|| engine::open(&args.device)).transpose()?;
    std::fs::create_dir_all(&args.out).map_err(Error::io(&args.out))?;
    let _lock = io::FolderLock::take(&args.out)?;
    let data = make_data(args, output)?;
    let Some(gpu) = gpu else {
        output.result(
            format_args!("data set: {}", data.display()),
            || json!({"event": "data", "data": data}),
        );
        return Ok(Outcome::Done);
    };
    // Trained from the files, like any data set.
    let options = DataArgs {
        vignetting: args.perturb == Some(PerturbArg::Vignetting),
        ..DataArgs::default()
    };
    let dataset = options.open(&data, true)?;
    let mut config = TrainConfig::for_iterations(args.iterations).for_dataset(&dataset);
    config.seed = args.seed;
    let faults = MadeFaults::of(args);
    if faults.exposure {
        config.exposure = ExposureModel::Gain;
    }
    config.refine_poses = faults.poses > 0.0;
    config.ignore_transients = faults.transients;
    config.sky = args.perturb == Some(PerturbArg::Sky);
    config.validate()?;
    let run = AutoRun::new(&gpu, &dataset, config)?;
    let mut state = begin_made(&data, &options, args.iterations)?;
    state.timings.load_seconds = start.elapsed().as_secs_f64();
    let session = Session {
        gpu: &gpu,
        dataset: &dataset,
        dir: &args.out,
        checkpoint_every: 0,
        eval_every: 0,
        against: None,
        output,
    };
    if session.run(run, &mut state)? == Outcome::Interrupted {
        return Ok(Outcome::Interrupted);
    }
    let orbit = args.out.join("orbit");
    draw_orbit(&gpu, &dataset, &args.out, args.orbit)?;
    engine::check(&gpu)?;
    let pictures = args.out.join("test");
    output.result(
        format_args!(
            "Look at:\n  {} (photograph | rendering | difference × 4)\n  {} (around the scene)",
            pictures.display(),
            orbit.display()
        ),
        || json!({"event": "pictures", "comparison": pictures, "orbit": orbit}),
    );
    Ok(Outcome::Done)
}

/// Makes the photographs and returns their folder.
fn make_data(args: &DemoArgs, output: Output) -> Result<PathBuf> {
    let made = args.out.display();
    output.remark(format_args!("making the scene and its photographs in {made}"));
    let data = args.out.join("data");
    std::fs::create_dir_all(&data).map_err(Error::io(&data))?;
    let [width, height] = args.size;
    let faults = MadeFaults::of(args);
    let options = SynthOptions {
        views: args.photos as usize,
        width,
        height,
        tracks: args.perturb.is_some(),
        exposure_seed: faults.exposure.then_some(args.seed),
        pose_seed: (faults.poses > 0.0).then_some(args.seed),
        pose_amount: faults.poses,
        transient_seed: faults.transients.then_some(args.seed),
        dome: args.perturb == Some(PerturbArg::Sky),
        fisheye: args.perturb == Some(PerturbArg::Fisheye),
        vignetting: args.perturb == Some(PerturbArg::Vignetting),
        ..SynthOptions::default()
    };
    let scene = args.scene.make()?;
    let mut dataset = scene.dataset(&options);
    match args.perturb {
        Some(_) => synth::save_colmap(&dataset, &options, &data)?,
        None => synth::save(&dataset, &data)?,
    }
    if options.transient_seed.is_some() {
        synth::save_masks(&scene, &dataset, &options, &data.join("truth/masks"))?;
    }
    if options.pose_seed.is_some() {
        let exact = dataset.views.iter_mut().zip(scene.cameras(&options));
        exact.for_each(|(view, camera)| view.camera = camera);
        synth::save_model(&dataset, &options, &data.join("truth"))?;
    }
    if args.truth {
        write_truth(&scene, &dataset, &data.join("truth"))?;
    }
    Ok(data)
}

/// Writes the true mesh, and pictures of the test views with depths and normals.
fn write_truth(scene: &Scene, dataset: &Dataset, dir: &Path) -> Result<()> {
    std::fs::create_dir_all(dir).map_err(Error::io(dir))?;
    io::mesh::write(&dir.join("mesh.ply"), &scene.mesh(), DVec3::ZERO)?;
    for index in dataset.split(Split::Test) {
        let view = &dataset.views[index];
        let (camera, path) = (&view.camera, dir.join(format!("{}.exr", file_stem(&view.name))));
        let depth = scene.depth(camera);
        let colors = scene.image(camera, 1).into_iter().zip(&depth);
        let rgba: Vec<[f32; 4]> = colors
            .map(|([r, g, b], z)| [r, g, b, f32::from(u8::from(z.is_finite()))])
            .collect();
        let normal = scene.normals(camera);
        io::exr::write(&path, camera.width, camera.height, &rgba, &depth, Some(&normal))?;
    }
    Ok(())
}

/// Draws an orbit of the trained scene, read from its file.
fn draw_orbit(gpu: &Gpu, dataset: &Dataset, dir: &Path, count: u32) -> Result<()> {
    let splats = io::splats::read(&dir.join("scene.ply"))?.splats;
    let mut draw = engine::scene_renderer(
        gpu,
        &splats,
        engine::near(dataset),
        Outputs::default(),
        Compatibility::Engine,
    )?;
    let orbit = dir.join("orbit");
    std::fs::create_dir_all(&orbit).map_err(Error::io(&orbit))?;
    let cameras: Vec<Camera> = dataset.views.iter().map(|view| view.camera).collect();
    let path = orbit_of_cameras(&cameras, dataset.extent(), count);
    for (i, camera) in path.iter().enumerate() {
        let picture = draw(camera, [0.0; 3])?;
        let path = orbit.join(format!("orbit_{i:04}.png"));
        io::png::write_rgb(&path, picture.width, picture.height, &picture.rgb)?;
    }
    Ok(())
}
