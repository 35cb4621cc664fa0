//! A window on a scene: winit and a swapchain of the host's own, the engine as its guest.
//!
//!     cargo run --release --features window --example view -- scene.ply [--cameras DATA]

mod device;
mod drawing;
mod hand;
mod rig;
mod scene;
mod screen;
mod viewer;

use std::error::Error;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use viewer::Viewer;
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::{StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop};
use winit::window::{Window, WindowId};

const HELP: &str = "\
usage: view SCENE [--cameras DATA] [--size WIDTHxHEIGHT] [--validate]

SCENE is read again when it changes; another file can be dropped on the window.
--validate turns the Vulkan validation layer on, and fails if it reports anything.

left mouse     orbit                      N, P       next, previous camera of DATA
double click   orbit about that splat     C          its photograph, and back
right mouse    move                       B          background: black, grey, white
wheel          nearer, farther            G          clip to a box about the target, and back
arrows         orbit by 5 degrees         H          harmonics: degree 3, 0, 1, 2
comma, period  roll by 5 degrees          O          order by depth, by distance
W A S D Q E    fly                        X          screenshot, to view-NNNN.png
[ ]            wider, narrower            K          add the camera to camera_path.json
R              back to the start          Escape     close
";

/// Interval at which the scene's file is looked at.
const WATCH: Duration = Duration::from_secs(1);

pub(crate) struct Args {
    pub(crate) scene: PathBuf,
    pub(crate) cameras: Option<PathBuf>,
    size: [u32; 2],
    validate: bool,
}

impl Args {
    fn parse(mut words: impl Iterator<Item = String>) -> Option<Args> {
        let (mut scene, mut cameras, mut size, mut validate) = (None, None, [960, 720], false);
        while let Some(word) = words.next() {
            match word.as_str() {
                "--cameras" => cameras = Some(words.next()?.into()),
                "--size" => size = parse_size(&words.next()?)?,
                "--validate" => validate = true,
                _ if word.starts_with('-') || scene.is_some() => return None,
                _ => scene = Some(word.into()),
            }
        }
        Some(Args {
            scene: scene?,
            cameras,
            size,
            validate,
        })
    }
}

fn parse_size(text: &str) -> Option<[u32; 2]> {
    let (width, height) = text.split_once('x')?;
    let size = [width.parse().ok()?, height.parse().ok()?];
    size.iter().all(|side| (1..=8192).contains(side)).then_some(size)
}

struct App {
    args: Args,
    viewer: Option<Viewer>,
    failed: Option<Box<dyn Error>>,
}

impl App {
    /// Keeps an error, which ends the program.
    fn check(&mut self, event_loop: &ActiveEventLoop, result: Result<(), Box<dyn Error>>) {
        if let Err(error) = result {
            self.failed.get_or_insert(error);
            event_loop.exit();
        }
    }

    fn open(&mut self, event_loop: &ActiveEventLoop) -> Result<(), Box<dyn Error>> {
        let [width, height] = self.args.size;
        let attributes = Window::default_attributes()
            .with_title("ashfall")
            .with_inner_size(PhysicalSize::new(width, height));
        let window = event_loop.create_window(attributes)?;
        self.viewer = Some(Viewer::new(window, &self.args, self.args.validate)?);
        Ok(())
    }
}

impl ApplicationHandler for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.viewer.is_none() {
            let opened = self.open(event_loop);
            self.check(event_loop, opened);
        }
    }

    fn new_events(&mut self, _event_loop: &ActiveEventLoop, cause: StartCause) {
        if let (StartCause::ResumeTimeReached { .. }, Some(viewer)) = (cause, &mut self.viewer) {
            viewer.watch();
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _id: WindowId, event: WindowEvent) {
        let Some(viewer) = &mut self.viewer else { return };
        let handled = match event {
            WindowEvent::CloseRequested | WindowEvent::Destroyed => {
                event_loop.exit();
                Ok(())
            }
            WindowEvent::RedrawRequested => viewer.draw(),
            event => viewer.handle(event, event_loop),
        };
        self.check(event_loop, handled);
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        let is_moving = self.viewer.as_ref().is_some_and(Viewer::request);
        event_loop.set_control_flow(match is_moving {
            true => ControlFlow::Poll,
            false => ControlFlow::WaitUntil(Instant::now() + WATCH),
        });
    }

    fn exiting(&mut self, _event_loop: &ActiveEventLoop) {
        self.viewer = None;
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let Some(args) = Args::parse(std::env::args().skip(1)) else {
        eprint!("{HELP}");
        std::process::exit(2);
    };
    let mut app = App {
        args,
        viewer: None,
        failed: None,
    };
    EventLoop::new()?.run_app(&mut app)?;
    match (app.failed, device::MESSAGES.load(Ordering::Relaxed)) {
        (Some(error), _) => Err(error),
        (None, 0) => Ok(()),
        (None, count) => Err(format!("{count} messages of the validation layer").into()),
    }
}
