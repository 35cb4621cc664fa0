//! Shared fixtures: one device for all tests of this folder, a warm renderer, single training steps, and the report of
//! a measured error beside its bound.

use crate::common::device::{self, Turn};
use crate::common::pack::Splat2d;
use crate::common::scenes::Scene;
use ashfall::gpu::Gpu;
use ashfall::kernels::project::{self, Bindings, Params, Project};
use ashfall::reference;
use ashfall::reference::frame::{self, discontinuity_margins};
use ashfall::reference::gradient::SplatGradients;
use ashfall::reference::rasterize_backward::PixelGradient;
use ashfall::render::{Model, RenderOptions, RenderedImage, Renderer, ViewOptions, planes_from_splats, view_of};
use ashfall::scene::{AlphaMode, Dataset, Photo, PhotoSource, Point, View};
use ashfall::train::state::Planes;
use ashfall::train::{Background, HostState, StepReport, TrainConfig, Trainer};
use std::rc::Rc;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

/// Half a unit in the last place of 1 in single precision.
pub(crate) const U: f64 = 1.0 / 16_777_216.0;

/// First iteration of steps: all SH bands are trained by then, and density control is over.
pub(crate) const BEGUN: u32 = 20_000;

struct Shared {
    gpu: Gpu,
    /// Indexed by SH degree.
    projects: Vec<Project>,
    renderer: Mutex<Renderer>,
}

/// The device of all tests; dropping it fails the test if there are validation messages.
pub(crate) struct Lab(
    &'static Shared,
    #[expect(dead_code, reason = "held, not read")] Rc<Turn>,
);

/// The shared device, made on the first call.
pub(crate) fn lab() -> Lab {
    static SHARED: OnceLock<Shared> = OnceLock::new();
    let turn = device::turn();
    let shared = SHARED.get_or_init(|| {
        let gpu = Gpu::create(&device::options()).expect("no device to test on");
        let options = RenderOptions {
            with_depth: true,
            ..RenderOptions::default()
        };
        let renderer = Mutex::new(Renderer::new(&gpu, options).expect("no renderer"));
        let project = |degree| Project::new(&gpu, project::Choice::of_degree(degree)).unwrap();
        Shared {
            projects: (0..=3).map(project).collect(),
            gpu,
            renderer,
        }
    });
    Lab(shared, turn)
}

impl Drop for Lab {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            assert_eq!(
                self.0.gpu.validation_messages(),
                Vec::<String>::new(),
                "validation messages"
            );
        }
    }
}

/// A training photograph, `[pixel]` rgba, and its alpha mode.
#[derive(Clone, Debug)]
pub(crate) struct Lesson {
    pub(crate) rgba: Vec<[u8; 4]>,
    pub(crate) alpha: AlphaMode,
    /// Share of D-SSIM in the loss.
    pub(crate) lambda: f32,
}

impl Lesson {
    /// A uniform grey photograph under L1 only: for render values strictly between 0 and 1, black makes the gradient of
    /// every channel of every pixel 1 / (3 · pixels), and white makes it the negative of that.
    pub(crate) fn flat(scene: &Scene, level: u8) -> Lesson {
        let pixels = (scene.camera.width * scene.camera.height) as usize;
        Lesson {
            rgba: vec![[level, level, level, 255]; pixels],
            alpha: AlphaMode::Composite,
            lambda: 0.0,
        }
    }

    /// An opaque generated photograph.
    pub(crate) fn photo(scene: &Scene, lambda: f32) -> Lesson {
        let (width, height) = (scene.camera.width, scene.camera.height);
        Lesson {
            rgba: crate::common::scenes::photo(7, width, height)
                .iter()
                .map(|&[r, g, b]| [r, g, b, 255])
                .collect(),
            alpha: AlphaMode::Composite,
            lambda,
        }
    }
}

/// Image, gradients, statistics and report of one step.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Stepped {
    pub(crate) image: Vec<f32>,
    pub(crate) gradients: Planes,
    pub(crate) statistics: Vec<[f32; 4]>,
    pub(crate) after: HostState,
    pub(crate) report: StepReport,
    pub(crate) near: f32,
}

impl Stepped {
    /// A splat's gradient, ordered like `reference::Splat::parameters`.
    pub(crate) fn row(&self, splat: usize) -> Vec<f64> {
        let plane = |index: usize| self.gradients[index][splat].map(f64::from);
        let [x, y, z, logit] = plane(0);
        let mut row = vec![x, y, z];
        row.extend(plane(1));
        row.extend(&plane(2)[..3]);
        row.push(logit);
        let count = reference::project::GEOMETRY_PARAMETERS
            + 3 * ((self.after.sh_degree + 1) * (self.after.sh_degree + 1)) as usize;
        row.extend((3..self.gradients.len()).flat_map(plane));
        row.truncate(count);
        row
    }
}

pub(crate) fn config(scene: &Scene, lambda: f32) -> TrainConfig {
    TrainConfig {
        sh_degree: scene.splats.sh_degree,
        filter: scene.splats.filter,
        lambda_dssim: lambda,
        ssim_stride: 1,
        background: Background::Fixed(scene.options.background.map(|c| c as f32)),
        ..TrainConfig::for_iterations(30_000)
    }
}

/// A data set of one view, with the extent that gives the scene's near plane.
pub(crate) fn dataset(scene: &Scene, lesson: &Lesson) -> Dataset {
    let camera = &scene.camera;
    let distance = scene.options.near / (1.1 * f64::from(config(scene, 0.0).near_factor));
    let ray = camera.rotation.row(2) * distance;
    Dataset {
        views: vec![View {
            name: "view".into(),
            camera: *camera,
            photo: PhotoSource::Memory(Photo {
                width: camera.width,
                height: camera.height,
                rgba: lesson.rgba.clone(),
            }),
        }],
        points: vec![Point {
            position: (camera.position + ray).to_array(),
            color: [0.5; 3],
        }],
        alpha: lesson.alpha,
        ..Dataset::default()
    }
}

pub(crate) fn view_options(scene: &Scene) -> ViewOptions {
    ViewOptions {
        background: scene.options.background.map(|c| c as f32),
        near: scene.options.near as f32,
        filter: scene.splats.filter,
    }
}

impl Lab {
    pub(crate) fn gpu(&self) -> &Gpu {
        &self.0.gpu
    }

    /// Draws a scene.
    pub(crate) fn draw(&self, scene: &Scene) -> RenderedImage {
        self.draw_with(scene, &view_options(scene))
    }

    /// Draws a scene with other options than its own.
    pub(crate) fn draw_with(&self, scene: &Scene, view: &ViewOptions) -> RenderedImage {
        let model = Model::upload(self.gpu(), &scene.splats).unwrap();
        let mut renderer = self.renderer();
        renderer.render(&model, &scene.camera, view).unwrap()
    }

    /// Device time of a picture, nanoseconds.
    pub(crate) fn device_time(&self, scene: &Scene) -> f64 {
        let model = Model::upload(self.gpu(), &scene.splats).unwrap();
        let mut renderer = self.renderer();
        renderer.render(&model, &scene.camera, &view_options(scene)).unwrap();
        renderer.timings().unwrap().iter().map(|(_, ns)| ns).sum()
    }

    fn renderer(&self) -> MutexGuard<'_, Renderer> {
        // The renderer is still usable after a test that failed while it drew.
        self.0.renderer.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// One training step.
    pub(crate) fn step(&self, scene: &Scene, lesson: &Lesson) -> Stepped {
        let dataset = dataset(scene, lesson);
        let state = HostState::from_splats(&scene.splats, scene.splats.sh_degree);
        let config = config(scene, lesson.lambda);
        let mut trainer = Trainer::from_state(self.gpu(), &dataset, config, &state, BEGUN).unwrap();
        trainer.step().unwrap();
        Stepped {
            gradients: trainer.gradients().unwrap(),
            statistics: trainer.statistics().unwrap(),
            image: trainer.image().unwrap(),
            after: trainer.download().unwrap(),
            near: trainer.near(),
            report: trainer.finish().unwrap().pop().unwrap(),
        }
    }

    /// Output of the projection: a record and a tile count for every splat. Buffers are filled with NaNs first.
    pub(crate) fn records(&self, scene: &Scene) -> (Vec<Splat2d>, Vec<u32>) {
        let (gpu, count) = (self.gpu(), scene.splats.len());
        let kernel = &self.0.projects[scene.splats.sh_degree as usize];
        let view = view_of(&scene.camera, &view_options(scene));
        let planes = planes_from_splats(&scene.splats);
        let shapes = gpu.buffer("shapes", count).unwrap();
        let tones = gpu.buffer("tones", count).unwrap();
        let rests = gpu.buffer("rests", count).unwrap();
        let tiles = gpu.buffer::<u32>("tiles", count).unwrap();
        let io = Bindings {
            view: &gpu.buffer_from("view", &[view]).unwrap(),
            params: &gpu.buffer_from("params", &planes).unwrap(),
            ellipse_from_splat: &shapes,
            whiten_rg_from_splat: &tones,
            blue_depth_from_splat: &rests,
            tile_count_from_splat: &tiles,
            splat_from_slot: &gpu.buffer("splat_from_slot", 1).unwrap(),
            plane_from_splat: &gpu.buffer("plane_from_splat", 1).unwrap(),
            limit_from_tile: &gpu.buffer("limit_from_tile", 1).unwrap(),
        };
        let params = Params {
            splat_count: count as u32,
            stride: count as u32,
            ..Params::default()
        };
        gpu.run(|rec| kernel.record(rec, io, params, kernel.groups(count)))
            .unwrap();
        let shapes = gpu.download(&shapes, 0..count).unwrap();
        let tones = gpu.download(&tones, 0..count).unwrap();
        let rests = gpu.download(&rests, 0..count).unwrap();
        let record = |i: usize| Splat2d {
            shape: shapes[i],
            tone: tones[i],
            rest: rests[i],
        };
        let records = (0..count).map(record).collect();
        (records, gpu.download(&tiles, 0..count).unwrap())
    }
}

/// Exact gradient of a step on a flat lesson: every channel of every pixel has the derivative `sign / (3 · pixels)`.
pub(crate) fn flat_gradient(scene: &Scene, near: f32, sign: f64) -> SplatGradients {
    let pixels = (scene.camera.width * scene.camera.height) as usize;
    let each = PixelGradient {
        color: [sign / (3 * pixels) as f64; 3],
        ..PixelGradient::default()
    };
    let options = reference::Options {
        near: f64::from(near),
        ..scene.options
    };
    reference::gradient::backward(&scene.splats, &scene.camera, &options, &vec![each; pixels]).1
}

/// Rows of exact gradients, ordered like `reference::Splat::parameters`.
pub(crate) fn rows(gradient: &SplatGradients) -> Vec<Vec<f64>> {
    crate::common::pack::gradient_rows(gradient)
}

/// Largest error of a drawn scene's colours and transmittance over the pixels without a discontinuity within `margin`.
pub(crate) fn apart(scene: &Scene, image: &RenderedImage, margin: f64) -> f64 {
    let expected = frame::render(&scene.splats, &scene.camera, &scene.options);
    let margins = discontinuity_margins(&scene.splats, &scene.camera, &scene.options);
    let mut worst = 0.0f64;
    for (i, (pixel, at)) in expected.pixels.iter().zip(&margins).enumerate() {
        let mut error = (f64::from(image.transmittance[i]) - pixel.transmittance).abs();
        for c in 0..3 {
            error = error.max((f64::from(image.rgb[i][c]) - pixel.color[c]).abs());
        }
        assert!(error.is_finite(), "pixel {i} is not finite");
        if at.nearest() > margin {
            worst = worst.max(error);
        }
    }
    worst
}

/// Largest difference of two pictures in colours and transmittance.
pub(crate) fn difference(a: &RenderedImage, b: &RenderedImage) -> f64 {
    let colors = a.rgb.as_flattened().iter().zip(b.rgb.as_flattened());
    let all = colors.chain(a.transmittance.iter().zip(&b.transmittance));
    all.map(|(a, b)| (f64::from(*a) - f64::from(*b)).abs())
        .fold(0.0, f64::max)
}

/// Whether two pictures have the same bits.
pub(crate) fn same(a: &RenderedImage, b: &RenderedImage) -> bool {
    let bits = |r: &RenderedImage| -> Vec<u32> {
        let all = r.rgb.as_flattened().iter().chain(&r.transmittance);
        all.chain(&r.depth).map(|x| x.to_bits()).collect()
    };
    bits(a) == bits(b)
}

/// Error bound of a picture: positions carry two ULPs of the image's size, which change an alpha by at most 0.61 / σ of
/// its range (the steepest slope of a Gaussian), alphas carry the specification's exponential, 14.1 · 2⁻²³ at most, and
/// sums of `layers` terms their own rounding.
pub(crate) fn image_bound(size: u32, sigma_min: f64, layers: usize, range: f64) -> f64 {
    let position = 2.0 * f64::from(size) * 2.0 * U;
    (0.61 / sigma_min * position + 14.1 * 2.0 * U + (layers + 2) as f64 * U) * range
}

/// Quantile `share` of the values.
pub(crate) fn percentile(values: &mut [f64], share: f64) -> f64 {
    assert!(!values.is_empty(), "nothing measured");
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * share).ceil() as usize]
}

/// Prints an error beside its bound, as a row of a table, and asserts the bound.
#[track_caller]
pub(crate) fn within(stage: &str, entry: &str, what: &str, measured: f64, bound: f64) {
    println!("| {stage} | {entry} | {what} | {measured:.1e} | {bound:.1e} |");
    // NaN fails this comparison.
    assert!(measured <= bound, "{entry}: {what}: {measured:e}, more than {bound:e}");
}
