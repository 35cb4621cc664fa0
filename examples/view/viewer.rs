//! The window's contents: scene, renderer, camera, and what keys do.

use crate::Args;
use crate::device::{Device, Pinned};
use crate::drawing::{BACKGROUNDS, clipped, make_room, options, pixel};
use crate::hand::Hand;
use crate::rig::{Rig, path_document};
use crate::scene::{Scene, Visits};
use crate::screen::{Presentation, Screen};
use ashfall::render::{ClipBox, SplatOrder, Stats};
use ashfall::{
    Camera, Gpu, HostCommands, HostImage, HostTarget, Model, Primitive, RenderOptions, Renderer, ViewOptions, io,
};
use glam::{DMat4, DQuat, DVec2, DVec3};
use std::error::Error;
use std::io::Write;
use std::path::Path;
use std::time::Instant;
use winit::event::WindowEvent;
use winit::event_loop::ActiveEventLoop;
use winit::keyboard::KeyCode;
use winit::window::Window;

type Checked = Result<(), Box<dyn Error>>;

/// Frames after the last change: statistics come two frames later.
const SETTLING: u32 = 3;

pub(crate) struct Viewer {
    renderer: Renderer,
    model: Model,
    gpu: Gpu,
    screen: Screen,
    device: Device,
    window: Window,
    scene: Scene,
    visits: Option<Visits>,
    visit: Option<usize>,
    shows_photo: bool,
    rig: Rig,
    hand: Hand,
    /// Place in the window for the next frame to pick.
    pick: Option<DVec2>,
    /// Camera of the frame whose pick has not been reported.
    picked: Option<Camera>,
    clip: Option<ClipBox>,
    options: RenderOptions,
    background: usize,
    keys: Vec<Camera>,
    takes_screenshot: bool,
    stats: Option<Stats>,
    frames_due: u32,
    last_frame: Option<Instant>,
    /// The last error, until something succeeds.
    problem: Option<String>,
}

impl Viewer {
    pub(crate) fn new(window: Window, args: &Args, validate: bool) -> Result<Viewer, Box<dyn Error>> {
        let scene = Scene::read(&args.scene)?;
        let origin = scene.splats.origin;
        let visits = args.cameras.as_deref().map(|path| Visits::open(path, origin));
        let visits = visits.transpose()?.filter(|visits| visits.len() > 0);
        let device = Device::new(&window, validate)?;
        let gpu = device.adopt()?;
        let model = Model::upload(&gpu, &scene.splats)?;
        let options = options(&scene, RenderOptions::default());
        let size = window.inner_size();
        let mut viewer = Viewer {
            renderer: Renderer::new(&gpu, options)?,
            model,
            screen: Screen::new(&device, [size.width, size.height])?,
            rig: Rig::before(scene.center, scene.radius, scene.up()),
            gpu,
            device,
            window,
            scene,
            visits,
            visit: None,
            shows_photo: false,
            hand: Hand::default(),
            pick: None,
            picked: None,
            clip: None,
            options,
            background: 0,
            keys: Vec::new(),
            takes_screenshot: false,
            stats: None,
            frames_due: SETTLING,
            last_frame: None,
            problem: None,
        };
        viewer.visit(1)?;
        viewer.reserve(None)?;
        Ok(viewer)
    }

    /// Asks for a frame if one is due; true while something moves.
    pub(crate) fn request(&self) -> bool {
        let is_due = self.frames_due > 0 || self.hand.flies();
        if is_due {
            self.window.request_redraw();
        }
        is_due
    }

    /// Reads the scene again if its file has changed.
    pub(crate) fn watch(&mut self) {
        if self.scene.is_old() {
            let path = self.scene.path.clone();
            self.reload(&path);
        }
    }

    /// Takes the scene of a file. An error leaves the scene as it is; of a half-written file, the next look finds the
    /// rest.
    fn reload(&mut self, path: &Path) {
        let replaced = self.replace(path);
        self.tell_error(replaced);
    }

    fn replace(&mut self, path: &Path) -> Checked {
        let scene = Scene::read(path)?;
        self.device.wait();
        let model = Model::upload(&self.gpu, &scene.splats)?;
        let options = options(&scene, self.options);
        let clip = self.clip.filter(|_| options.primitive == Primitive::Gaussian3d);
        let mut renderer = Renderer::new(&self.gpu, options)?;
        make_room(&mut renderer, (&model, clip), &self.rig, self.screen.extent, None)?;
        self.clip = clip;
        self.rebase(scene.splats.origin);
        (self.scene, self.model) = (scene, model);
        self.install(renderer, options);
        Ok(())
    }

    /// Keeps everything in its place in a world of another origin.
    fn rebase(&mut self, origin: DVec3) {
        let by = self.scene.splats.origin - origin;
        self.rig.camera.position += by;
        self.rig.target += by;
        for key in &mut self.keys {
            key.position += by;
        }
        if let Some(clip) = &mut self.clip {
            clip.world_from_cube = DMat4::from_translation(by) * clip.world_from_cube;
        }
        if let Some(visits) = &mut self.visits {
            visits.set_origin(origin);
        }
    }

    /// A renderer of other options, for the scene.
    fn renew(&mut self, wanted: RenderOptions) -> Checked {
        self.device.wait();
        let options = options(&self.scene, wanted);
        let mut renderer = Renderer::new(&self.gpu, options)?;
        let content = (&self.model, self.clip);
        make_room(&mut renderer, content, &self.rig, self.screen.extent, None)?;
        self.install(renderer, options);
        Ok(())
    }

    fn install(&mut self, renderer: Renderer, options: RenderOptions) {
        (self.renderer, self.options) = (renderer, options);
        // With the renderer go its reports.
        (self.pick, self.picked, self.stats) = (None, None, None);
        self.frames_due = SETTLING;
    }

    /// Room for pictures of the window's size and so many pairs, or the expected number.
    fn reserve(&mut self, isects: Option<usize>) -> Checked {
        let content = (&self.model, self.clip);
        make_room(&mut self.renderer, content, &self.rig, self.screen.extent, isects)?;
        self.frames_due = SETTLING;
        Ok(())
    }

    /// The camera `step` further in the data set.
    fn visit(&mut self, step: usize) -> Checked {
        let Some(visits) = &self.visits else { return Ok(()) };
        let index = self.visit.map_or(0, |index| (index + step) % visits.len());
        self.rig.jump(&visits.camera(index), visits.focus, visits.extent());
        self.visit = Some(index);
        self.shows_photo = false;
        Ok(())
    }

    /// Shows the photograph of the camera visited, at its place, or hides it.
    fn compare(&mut self) -> Checked {
        let (Some(visits), Some(index)) = (&self.visits, self.visit) else {
            return Ok(());
        };
        self.shows_photo = !self.shows_photo && {
            self.rig.jump(&visits.camera(index), visits.focus, visits.extent());
            let photo = visits.photo(index)?;
            if let Some(photo) = &photo {
                let (rgba, extent) = (photo.rgba.as_flattened(), [photo.width, photo.height]);
                self.screen.set_photo(&self.device, rgba, extent)?;
            }
            photo.is_some()
        };
        Ok(())
    }

    pub(crate) fn handle(&mut self, event: WindowEvent, event_loop: &ActiveEventLoop) -> Checked {
        match &event {
            WindowEvent::Resized(size) => {
                self.screen.resize(&self.device, [size.width, size.height])?;
                self.reserve(None)?;
            }
            WindowEvent::DroppedFile(path) => self.reload(&path.clone()),
            WindowEvent::Focused(false) => self.hand.release(),
            WindowEvent::Occluded(_) | WindowEvent::Focused(true) => self.frames_due = SETTLING,
            // Keys that are down when the focus comes have a press of their own besides, which is synthetic.
            WindowEvent::KeyboardInput {
                event,
                is_synthetic: false,
                ..
            } => {
                if let Some(key) = self.hand.press(event.physical_key, event.state, &mut self.rig) {
                    self.key(key, event_loop)?;
                    self.frames_due = SETTLING;
                }
            }
            _ if self.hand.moves(&event, &mut self.rig, self.screen.extent[1]) => {
                self.shows_photo = false;
                self.frames_due = SETTLING;
            }
            _ => {}
        }
        if let Some(place) = self.hand.double_click() {
            match self.options.with_ids {
                true => self.pick = Some(place),
                false => self.tell_error(Err("splats are picked in the order by depth: press O".into())),
            }
            self.frames_due = SETTLING;
        }
        Ok(())
    }

    fn key(&mut self, key: KeyCode, event_loop: &ActiveEventLoop) -> Checked {
        let back = self.visits.as_ref().map_or(0, |visits| visits.len() - 1);
        match key {
            KeyCode::KeyN => self.visit(1)?,
            KeyCode::KeyP => self.visit(back)?,
            KeyCode::KeyB => self.background = (self.background + 1) % BACKGROUNDS.len(),
            KeyCode::KeyX => self.takes_screenshot = true,
            KeyCode::KeyR => self.rig = Rig::before(self.scene.center, self.scene.radius, self.scene.up()),
            KeyCode::Escape => event_loop.exit(),
            _ => self.attempt(key),
        }
        Ok(())
    }

    /// Does what a key asks for if it can be done.
    fn attempt(&mut self, key: KeyCode) {
        let result = match key {
            KeyCode::KeyC => self.compare(),
            KeyCode::KeyG => self.clip(),
            KeyCode::KeyK => self.keep(),
            KeyCode::KeyH => self.renew(RenderOptions {
                sh_degree: (self.options.sh_degree + 1) % 4,
                ..self.options
            }),
            KeyCode::KeyO => {
                let order = match self.options.order {
                    SplatOrder::Depth => SplatOrder::Distance,
                    SplatOrder::Distance => SplatOrder::Depth,
                };
                self.renew(RenderOptions { order, ..self.options })
            }
            _ => return,
        };
        self.tell_error(result);
    }

    /// Clips to a cube about the target, upright, of the distance as its side; or shows all again.
    fn clip(&mut self) -> Checked {
        if self.model.primitive != Primitive::Gaussian3d {
            return Err("only 3D Gaussians are clipped".into());
        }
        let size = DVec3::splat(0.5 * self.rig.distance());
        let upright = DQuat::from_rotation_arc(DVec3::Y, self.scene.up());
        let cube = ClipBox {
            world_from_cube: DMat4::from_scale_rotation_translation(size, upright, self.rig.target),
            cuts_inside: false,
        };
        let next = match self.clip {
            None => Some(cube),
            Some(_) => None,
        };
        self.device.wait();
        let content = (&self.model, next);
        make_room(&mut self.renderer, content, &self.rig, self.screen.extent, None)?;
        self.clip = next;
        Ok(())
    }

    /// Adds the camera to the recorded path.
    fn keep(&mut self) -> Checked {
        self.keys.push(self.rig.fitted(self.screen.extent));
        let text = serde_json::to_string_pretty(&path_document(&self.keys, self.scene.splats.origin))?;
        std::fs::write("camera_path.json", text)?;
        println!("camera_path.json: {} cameras", self.keys.len());
        Ok(())
    }

    pub(crate) fn draw(&mut self) -> Checked {
        let seconds = self
            .last_frame
            .replace(Instant::now())
            .map(|last| last.elapsed().as_secs_f64());
        if let (true, Some(seconds)) = (self.hand.flies(), seconds) {
            self.hand.fly(seconds.min(0.2), &mut self.rig);
        }
        let size = self.screen.extent;
        if size.contains(&0) {
            return self.settle(Presentation::Missed);
        }
        let copy = match self.takes_screenshot {
            true => Some(self.device.pinned(size[0] as usize * size[1] as usize * 4)?),
            false => None,
        };
        let shown = self.paint(size, copy.as_ref())?;
        if let Some(mut copy) = copy {
            self.device.wait();
            if matches!(shown, Presentation::Shown | Presentation::Stale) {
                self.save(&self.screen.rgb(copy.bytes()), size)?;
                self.takes_screenshot = false;
            }
            self.device.unpin(copy);
        }
        self.aim();
        self.settle(shown)?;
        self.tell(seconds);
        Ok(())
    }

    /// Draws a frame of the window's size, with a copy of what is shown.
    fn paint(&mut self, size: [u32; 2], copy: Option<&Pinned>) -> Result<Presentation, Box<dyn Error>> {
        let view = ViewOptions {
            background: [BACKGROUNDS[self.background]; 3],
            near: (0.01 * self.visits.as_ref().map_or(self.scene.radius, Visits::extent)) as f32,
            filter: self.scene.splats.filter,
        };
        let (camera, photo_area) = (self.rig.fitted(size), self.shows_photo.then(|| self.rig.area(size)));
        let (renderer, model, clip, stats) = (&mut self.renderer, &self.model, self.clip, &mut self.stats);
        let (waiting, picked) = (&mut self.pick, &mut self.picked);
        let record = |commands: &mut HostCommands, color: &HostImage| {
            // One at a time: the next report is of this camera.
            let pick = waiting.take_if(|_| picked.is_none()).map(|place| pixel(place, size));
            let target = HostTarget {
                pick,
                ..HostTarget::from(color)
            };
            let returned = match clip {
                None => renderer.record(commands, model, &camera, &view, target),
                Some(_) => renderer.record_instances(commands, &[clipped(model, clip)], &camera, &view, target),
            }?;
            *picked = picked.or(pick.map(|_| camera));
            *stats = returned.or(*stats);
            Ok(())
        };
        self.screen.draw(&self.device, record, photo_area, copy)
    }

    /// Moves the centre of the orbit to the splat of a double click, some frames later.
    fn aim(&mut self) {
        let Some(report) = self.renderer.picks().last() else {
            return;
        };
        let depth = f64::from(report.pixels[0].depth);
        if let Some(camera) = self.picked.take().filter(|_| depth.is_finite()) {
            let pixel = DVec2::new(report.area.x.into(), report.area.y.into()) + 0.5;
            self.rig.target = camera.position + depth * camera.ray_from_pixel(pixel);
        }
    }

    /// Does what a frame's fate and its statistics ask for.
    fn settle(&mut self, shown: Presentation) -> Checked {
        self.frames_due = self.frames_due.saturating_sub(1);
        if shown != Presentation::Shown {
            let size = self.window.inner_size();
            if shown == Presentation::Lost {
                self.device.wait();
                self.screen.discard(&self.device);
                self.device.renew_surface(&self.window)?;
            }
            self.screen.resize(&self.device, [size.width, size.height])?;
            self.reserve(None)?;
        }
        if let Some(stats) = self.stats.take_if(|stats| !stats.fits()) {
            self.reserve(Some(2 * stats.isects))?;
        }
        if self.picked.is_some() {
            self.frames_due = self.frames_due.max(1);
        }
        Ok(())
    }

    fn save(&self, rgb: &[u8], [width, height]: [u32; 2]) -> Checked {
        let png = io::png::encode_rgb(width, height, rgb)?;
        let name = |index: usize| format!("view-{index:04}.png");
        let free = (1..).map(name).find(|name| !Path::new(name).exists());
        if let Some(name) = free {
            io::atomic::write_atomically(Path::new(&name), |file| file.write_all(&png))?;
            println!("{name}");
        }
        Ok(())
    }

    /// Prints an error and states it in the title; the picture stays as it is.
    fn tell_error(&mut self, result: Checked) {
        self.problem = result.err().map(|error| error.to_string());
        if let Some(problem) = &self.problem {
            eprintln!("error: {problem}");
        }
        self.tell(None);
    }

    /// States splats, distance, frame time and camera in the title.
    fn tell(&mut self, seconds: Option<f64>) {
        // Time between frames counts while one follows the other.
        if self.frames_due == 0 && !self.hand.flies() {
            self.last_frame = None;
        }
        let mut title = self.scene.path.display().to_string();
        if let Some(problem) = &self.problem {
            title += &format!(" | error: {problem}");
        }
        title += &format!(" | {} splats", self.model.splat_count);
        title += &format!(" | {:.3} to the target", self.rig.distance());
        if let Some(stats) = &self.stats {
            title += &format!(" | {} pairs", stats.isects);
        }
        if let Some(seconds) = seconds {
            title += &format!(" | {:.1} ms", 1e3 * seconds);
        }
        if let (Some(visits), Some(index)) = (&self.visits, self.visit) {
            title += &format!(
                " | {}{}",
                visits.name(index),
                if self.shows_photo { " (photograph)" } else { "" }
            );
        }
        self.window.set_title(&title);
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        self.device.wait();
        self.screen.destroy(&self.device);
    }
}
