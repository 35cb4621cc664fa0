//! An X server, and the viewer's window on it as its user has it.

use super::decode;
use ashfall::io::camera_path::{PathOptions, open};
use ashfall::scene::{Camera, Photo};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use x11rb::connection::Connection;
use x11rb::protocol::Event;
use x11rb::protocol::xproto::{
    Atom, AtomEnum, BUTTON_PRESS_EVENT, BUTTON_RELEASE_EVENT, ClientMessageEvent, ConfigureWindowAux,
    ConnectionExt as _, EventMask, ImageFormat, InputFocus, KEY_PRESS_EVENT, KEY_RELEASE_EVENT, MOTION_NOTIFY_EVENT,
    PropMode, SELECTION_NOTIFY_EVENT, SelectionNotifyEvent, Window, WindowClass,
};
use x11rb::protocol::xtest::ConnectionExt as _;
use x11rb::rust_connection::RustConnection;
use x11rb::wrapper::ConnectionExt as _;

const K: u8 = 45;
const X: u8 = 53;

/// A process that is killed if the test fails.
pub(super) struct Killed(pub(super) Child);

impl Drop for Killed {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// An X server of its own, and its display.
pub(super) fn server() -> (Killed, String) {
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
pub(super) fn eventually<T>(what: &str, mut find: impl FnMut() -> Option<T>) -> T {
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
pub(super) struct Desk<'a> {
    x: RustConnection,
    root: Window,
    window: Window,
    folder: &'a Path,
    screenshots: usize,
    cameras: usize,
}

/// Title of a window.
fn title(x: &RustConnection, window: Window) -> String {
    let title = x.get_property(false, window, AtomEnum::WM_NAME, AtomEnum::STRING, 0, 256);
    let title = title.unwrap().reply().unwrap().value;
    String::from_utf8_lossy(&title).into_owned()
}

impl Desk<'_> {
    pub(super) fn new<'a>(display: &str, folder: &'a Path) -> Desk<'a> {
        let (x, screen) = x11rb::connect(Some(display)).unwrap();
        let root = x.setup().roots[screen].root;
        let window = eventually("window", || {
            let windows = x.query_tree(root).unwrap().reply().unwrap().children;
            let is_viewer = |window: &Window| title(&x, *window).contains("80 splats");
            windows.into_iter().find(is_viewer)
        });
        x.set_input_focus(InputFocus::POINTER_ROOT, window, 0u32).unwrap();
        Desk {
            x,
            root,
            window,
            folder,
            screenshots: 0,
            cameras: 0,
        }
    }

    pub(super) fn press(&self, key: u8) {
        for kind in [KEY_PRESS_EVENT, KEY_RELEASE_EVENT] {
            let sent = self.x.xtest_fake_input(kind, key, 0, self.root, 0, 0, 0);
            sent.unwrap().check().unwrap();
        }
    }

    /// What the swapchain has shown, by the key for it.
    pub(super) fn screenshot(&mut self) -> Photo {
        self.press(X);
        self.screenshots += 1;
        let path = self.folder.join(format!("view-{:04}.png", self.screenshots));
        eventually("screenshot", || path.is_file().then(|| decode(path.as_path()).unwrap()))
    }

    /// The window's pixels as the server has them.
    pub(super) fn shown(&self, [width, height]: [u32; 2]) -> Vec<[u8; 3]> {
        let (width, height) = (width as u16, height as u16);
        let image = self
            .x
            .get_image(ImageFormat::Z_PIXMAP, self.window, 0, 0, width, height, u32::MAX);
        let bytes = image.unwrap().reply().unwrap().data;
        bytes.chunks_exact(4).map(|bgrx| [bgrx[2], bgrx[1], bgrx[0]]).collect()
    }

    /// The camera that the key adds to the path.
    pub(super) fn camera(&mut self) -> Camera {
        self.press(K);
        self.cameras += 1;
        let count = self.cameras;
        let path = self.folder.join("camera_path.json");
        let cameras = eventually("camera", || {
            let path = open(&path, &PathOptions::default()).ok()?;
            (path.cameras.len() == count).then_some(path.cameras)
        });
        cameras[count - 1]
    }

    pub(super) fn resize(&self, [width, height]: [u32; 2]) {
        let size = ConfigureWindowAux::new().width(width).height(height);
        self.x.configure_window(self.window, &size).unwrap().check().unwrap();
    }

    /// Waits for a title.
    pub(super) fn titled(&self, what: &str, is_wanted: impl Fn(&str) -> bool) {
        eventually(what, || is_wanted(&title(&self.x, self.window)).then_some(()));
    }

    /// Distance of the orbit's centre, by the title.
    pub(super) fn distance(&self) -> f64 {
        eventually("distance in the title", || {
            let title = title(&self.x, self.window);
            let part = title
                .split(" | ")
                .find_map(|part| part.strip_suffix(" to the target"))?;
            part.parse().ok()
        })
    }

    pub(super) fn double_click(&self, pixel: [usize; 2]) {
        let origin = self.x.translate_coordinates(self.window, self.root, 0, 0);
        let origin = origin.unwrap().reply().unwrap();
        let [x, y] = [origin.dst_x + pixel[0] as i16, origin.dst_y + pixel[1] as i16];
        let (down, up) = (BUTTON_PRESS_EVENT, BUTTON_RELEASE_EVENT);
        for (kind, detail) in [(MOTION_NOTIFY_EVENT, 0), (down, 1), (up, 1), (down, 1), (up, 1)] {
            let sent = self.x.xtest_fake_input(kind, detail, 0, self.root, x, y, 0);
            sent.unwrap().check().unwrap();
        }
    }

    /// Drops a file on the window as a file manager does.
    pub(super) fn drop_file(&self, path: &Path) {
        let (x, source) = (&self.x, self.x.generate_id().unwrap());
        let (input, aux) = (WindowClass::INPUT_ONLY, Default::default());
        let made = x.create_window(0, source, self.root, 0, 0, 1, 1, 0, input, 0, &aux);
        made.unwrap().check().unwrap();
        let list = self.atom("text/uri-list");
        let owned = x.set_selection_owner(source, self.atom("XdndSelection"), 0u32);
        owned.unwrap().check().unwrap();
        self.send("XdndEnter", [source, 5 << 24, list, 0, 0]);
        self.send("XdndPosition", [source, 0, 0, 0, self.atom("XdndActionCopy")]);
        let asked = eventually("request for the file's name", || match x.poll_for_event().unwrap() {
            Some(Event::SelectionRequest(asked)) => Some(asked),
            _ => None,
        });
        let uri = format!("file://{}\r\n", path.display());
        let told = x.change_property8(PropMode::REPLACE, asked.requestor, asked.property, list, uri.as_bytes());
        told.unwrap().check().unwrap();
        let answer = SelectionNotifyEvent {
            response_type: SELECTION_NOTIFY_EVENT,
            sequence: 0,
            time: asked.time,
            requestor: asked.requestor,
            selection: asked.selection,
            target: asked.target,
            property: asked.property,
        };
        let sent = x.send_event(false, asked.requestor, EventMask::NO_EVENT, answer);
        sent.unwrap().check().unwrap();
        self.send("XdndDrop", [source, 0, 0, 0, 0]);
    }

    /// Closes the window as a window manager does.
    pub(super) fn close(self) {
        self.send("WM_PROTOCOLS", [self.atom("WM_DELETE_WINDOW"), 0, 0, 0, 0]);
    }

    fn atom(&self, name: &str) -> Atom {
        self.x
            .intern_atom(false, name.as_bytes())
            .unwrap()
            .reply()
            .unwrap()
            .atom
    }

    /// Sends a message to the window.
    fn send(&self, kind: &str, data: [u32; 5]) {
        let event = ClientMessageEvent::new(32, self.window, self.atom(kind), data);
        let sent = self.x.send_event(false, self.window, EventMask::NO_EVENT, event);
        sent.unwrap().check().unwrap();
    }
}
