//! The example `view` on a virtual X server: keys, pictures, sizes, the end.

use crate::common::device::gpu;
use crate::common::scenes::{Scene, gentle};
use ashfall::io::camera_path::{PathOptions, open};
use ashfall::io::dataset::OpenOptions;
use ashfall::io::photo::decode;
use ashfall::render::{Model, RenderOptions, Renderer, ViewOptions};
use ashfall::scene::{Camera, Photo};
use ashfall::{io, open_dataset, write_splats};
use glam::DVec2;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use x11rb::connection::Connection;
use x11rb::protocol::xproto::{
    AtomEnum, ClientMessageEvent, ConfigureWindowAux, ConnectionExt as _, EventMask, ImageFormat, InputFocus,
    KEY_PRESS_EVENT, KEY_RELEASE_EVENT, Window,
};
use x11rb::protocol::xtest::ConnectionExt as _;
use x11rb::rust_connection::RustConnection;

const SIZE: [u32; 2] = [160, 120];
/// Codes of keys, those of Linux and 8.
const B: u8 = 56;
const C: u8 = 54;
const K: u8 = 45;
const X: u8 = 53;
const RIGHT: u8 = 114;
const UP: u8 = 111;

/// A process that is killed if the test fails.
struct Killed(Child);

impl Drop for Killed {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// An X server of its own, and its display.
fn server() -> (Killed, String) {
    let mut command = Command::new("Xvfb");
    command.args(["-displayfd", "1", "-screen", "0", "640x480x24", "-nolisten", "tcp"]);
    let child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
    let mut child = Killed(child.expect("scripts/setup installs Xvfb"));
    let mut line = String::new();
    BufReader::new(child.0.stdout.take().unwrap())
        .read_line(&mut line)
        .unwrap();
    (child, format!(":{}", line.trim()))
}

/// Waits for something, a minute at most.
fn eventually<T>(what: &str, mut find: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(found) = find() {
            return found;
        }
        assert!(start.elapsed() < Duration::from_secs(60), "no {what} in a minute");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// The viewer's window, as its user has it.
struct Desk<'a> {
    x: RustConnection,
    root: Window,
    window: Window,
    folder: &'a Path,
    screenshots: usize,
}

impl Desk<'_> {
    fn new<'a>(display: &str, folder: &'a Path) -> Desk<'a> {
        let (x, screen) = x11rb::connect(Some(display)).unwrap();
        let root = x.setup().roots[screen].root;
        let window = eventually("window", || {
            let windows = x.query_tree(root).unwrap().reply().unwrap().children;
            windows.into_iter().find(|&window| {
                let title = x.get_property(false, window, AtomEnum::WM_NAME, AtomEnum::STRING, 0, 64);
                let title = title.unwrap().reply().unwrap().value;
                String::from_utf8_lossy(&title).contains("80 splats")
            })
        });
        x.set_input_focus(InputFocus::POINTER_ROOT, window, 0u32).unwrap();
        Desk {
            x,
            root,
            window,
            folder,
            screenshots: 0,
        }
    }

    fn press(&self, key: u8) {
        for kind in [KEY_PRESS_EVENT, KEY_RELEASE_EVENT] {
            let sent = self.x.xtest_fake_input(kind, key, 0, self.root, 0, 0, 0);
            sent.unwrap().check().unwrap();
        }
    }

    /// What the swapchain has shown, by the key for it.
    fn screenshot(&mut self) -> Photo {
        self.press(X);
        self.screenshots += 1;
        let path = self.folder.join(format!("view-{:04}.png", self.screenshots));
        eventually("screenshot", || path.is_file().then(|| decode(path.as_path()).unwrap()))
    }

    /// The window's pixels as the server has them.
    fn shown(&self, [width, height]: [u32; 2]) -> Vec<[u8; 3]> {
        let (width, height) = (width as u16, height as u16);
        let image = self
            .x
            .get_image(ImageFormat::Z_PIXMAP, self.window, 0, 0, width, height, u32::MAX);
        let bytes = image.unwrap().reply().unwrap().data;
        bytes.chunks_exact(4).map(|bgrx| [bgrx[2], bgrx[1], bgrx[0]]).collect()
    }

    /// The camera that the key adds to the path.
    fn camera(&self, count: usize) -> Camera {
        self.press(K);
        let path = self.folder.join("camera_path.json");
        let cameras = eventually("camera", || {
            let path = open(&path, &PathOptions::default()).ok()?;
            (path.cameras.len() == count).then_some(path.cameras)
        });
        cameras[count - 1]
    }

    fn resize(&self, [width, height]: [u32; 2]) {
        let size = ConfigureWindowAux::new().width(width).height(height);
        self.x.configure_window(self.window, &size).unwrap().check().unwrap();
    }

    /// Closes the window as a window manager does.
    fn close(self) {
        let atom = |name: &[u8]| self.x.intern_atom(false, name).unwrap().reply().unwrap().atom;
        let data = [atom(b"WM_DELETE_WINDOW"), 0, 0, 0, 0];
        let event = ClientMessageEvent::new(32, self.window, atom(b"WM_PROTOCOLS"), data);
        let sent = self.x.send_event(false, self.window, EventMask::NO_EVENT, event);
        sent.unwrap().check().unwrap();
    }
}

/// A data set of one camera; returns its photograph.
fn write_data(folder: &Path, camera: &Camera) -> Vec<[u8; 3]> {
    let rows = [0, 1, 2].map(|row| camera.rotation.row(row));
    let row = |i: usize| [rows[0][i], -rows[1][i], -rows[2][i], camera.position[i]];
    let document = serde_json::json!({
        "w": camera.width, "h": camera.height, "cx": camera.center.x, "cy": camera.center.y,
        "fl_x": camera.focal.x, "fl_y": camera.focal.y,
        "frames": [{ "file_path": "photo.png", "transform_matrix": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]] }],
    });
    let pixel = |i: u32| [(i % SIZE[0]) as u8, (i / SIZE[0]) as u8, 40];
    let photo: Vec<[u8; 3]> = (0..SIZE[0] * SIZE[1]).map(pixel).collect();
    let png = io::png::encode_rgb(SIZE[0], SIZE[1], photo.as_flattened()).unwrap();
    std::fs::write(folder.join("photo.png"), png).unwrap();
    std::fs::write(folder.join("transforms.json"), document.to_string()).unwrap();
    photo
}

/// Asserts the headless picture of a camera, rounded to 8 bits.
fn assert_drawn(photo: &Photo, camera: &Camera, scene: &Scene, folder: &Path) {
    let dataset = open_dataset(folder, &data_options()).unwrap();
    let view = ViewOptions {
        background: [0.5; 3],
        near: (0.01 * dataset.extent()) as f32,
        filter: scene.splats.filter,
    };
    let gpu = gpu();
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let mut renderer = Renderer::new(&gpu, RenderOptions::default()).unwrap();
    let expected = renderer.render(&model, camera, &view).unwrap();
    assert_eq!([photo.width, photo.height], [camera.width, camera.height]);
    let drawn = expected.transmittance.iter().filter(|&&t| t < 0.5).count();
    assert!(drawn > expected.rgb.len() / 20, "{drawn} pixels with splats");
    for (i, (found, exact)) in photo.rgba.iter().zip(&expected.rgb).enumerate() {
        for (level, value) in found.iter().zip(exact) {
            let off = (f32::from(*level) - 255.0 * value.clamp(0.0, 1.0)).abs();
            assert!(off <= 0.51, "pixel {i}: {found:?} for {exact:?}");
        }
    }
}

fn data_options() -> OpenOptions {
    OpenOptions {
        photos_required: false,
        ..OpenOptions::default()
    }
}

fn example() -> PathBuf {
    let path = Path::new(env!("CARGO_BIN_EXE_ashfall")).with_file_name("examples/view");
    assert!(
        path.is_file(),
        "cargo build --features capi,window --example view makes {path:?}"
    );
    path
}

/// The window shows the headless picture to the last level, at every size and after turns; a key shows the photograph.
/// Validation is silent until the end, when it would name what is left.
#[test]
fn a_window_shows_what_keys_ask_for() {
    let mut scene = gentle(5, 80, SIZE[0], SIZE[1], 2);
    scene.camera.center = 0.5 * DVec2::new(SIZE[0].into(), SIZE[1].into());
    // A path of nerfstudio has one focal length.
    scene.camera.focal.x = scene.camera.focal.y;
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_splats(&folder.join("scene.ply"), &scene.splats).unwrap();
    let taken = write_data(folder, &scene.camera);
    let (_server, display) = server();
    let mut command = Command::new(example());
    command.args(["scene.ply", "--cameras", ".", "--size", "160x120", "--validate"]);
    command
        .current_dir(folder)
        .env("DISPLAY", &display)
        .env_remove("WAYLAND_DISPLAY");
    let viewer = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn();
    let mut viewer = Killed(viewer.unwrap());
    let mut desk = Desk::new(&display, folder);

    desk.press(C);
    let photo = desk.screenshot().rgba;
    let shown: Vec<[u8; 3]> = photo.iter().map(|&[r, g, b, _]| [r, g, b]).collect();
    assert_eq!(shown, taken, "the photograph");
    for key in [C, B, RIGHT, RIGHT, UP] {
        desk.press(key);
    }
    let (turned, picture) = (desk.camera(1), desk.screenshot());
    let ahead = |camera: &Camera| camera.rotation.row(2);
    assert!(ahead(&turned).dot(ahead(&scene.camera)) < 0.99, "10 and 5 degrees");
    assert_drawn(&picture, &turned, &scene, folder);
    let rgb: Vec<[u8; 3]> = picture.rgba.iter().map(|&[r, g, b, _]| [r, g, b]).collect();
    eventually("picture on the server", || (desk.shown(SIZE) == rgb).then_some(()));

    for size in [[200, 120], [97, 143], [320, 240], [33, 17], [180, 90]] {
        desk.resize(size);
        eventually("picture of the new size", || {
            let photo = desk.screenshot();
            ([photo.width, photo.height] == size).then_some(())
        });
    }
    assert_drawn(&desk.screenshot(), &desk.camera(2), &scene, folder);

    desk.close();
    let status = eventually("end", || viewer.0.try_wait().unwrap());
    let mut said = String::new();
    viewer.0.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert!(status.success() && !said.contains("validation"), "{said}");
}
