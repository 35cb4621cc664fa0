//! The example `view` on a virtual X server: keys, mouse, files, pictures, sizes, lost surfaces, the end.

mod desk;

use crate::common::device::gpu;
use crate::common::scenes::{Scene, gentle};
use crate::tools::run;
use ashfall::io::dataset::OpenOptions;
use ashfall::io::photo::decode;
use ashfall::layout::NO_SPLAT;
use ashfall::render::{ClipBox, Instance, Model, RenderOptions, RenderedImage, Renderer, SplatOrder, ViewOptions};
use ashfall::scene::{Camera, Photo};
use ashfall::{Splats, io, open_dataset, write_splats};
use desk::{Desk, Killed, eventually, server};
use glam::{DMat4, DQuat, DVec2, DVec3};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const SIZE: [u32; 2] = [160, 120];
/// Codes of keys, those of Linux and 8.
const B: u8 = 56;
const C: u8 = 54;
const G: u8 = 42;
const O: u8 = 32;
const RIGHT: u8 = 114;
const UP: u8 = 111;

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

/// The headless picture of a camera, in the places of a clip box if there is one.
fn headless(camera: &Camera, scene: &Scene, folder: &Path, clip: Option<ClipBox>) -> RenderedImage {
    headless_by(SplatOrder::Depth, camera, scene, folder, clip)
}

fn headless_by(
    order: SplatOrder,
    camera: &Camera,
    scene: &Scene,
    folder: &Path,
    clip: Option<ClipBox>,
) -> RenderedImage {
    let dataset = open_dataset(folder, &data_options()).unwrap();
    let view = ViewOptions {
        background: [0.5; 3],
        near: (0.01 * dataset.extent()) as f32,
        filter: scene.splats.filter,
    };
    let gpu = gpu();
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let options = RenderOptions {
        with_ids: order == SplatOrder::Depth,
        order,
        ..RenderOptions::default()
    };
    let mut renderer = Renderer::new(&gpu, options).unwrap();
    let instance = Instance {
        clip,
        ..Instance::new(&model)
    };
    renderer.render_instances(&[instance], camera, &view).unwrap()
}

/// Asserts a headless picture, rounded to 8 bits.
fn assert_drawn(photo: &Photo, camera: &Camera, expected: &RenderedImage) {
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

/// Splats before a camera of the data set's size, or about the place that another scene's camera looks at.
fn scene(seed: u64, count: usize, like: Option<&Scene>) -> Scene {
    let mut scene = gentle(seed, count, SIZE[0], SIZE[1], 2);
    scene.camera.center = 0.5 * DVec2::new(SIZE[0].into(), SIZE[1].into());
    // A path of nerfstudio has one focal length.
    scene.camera.focal.x = scene.camera.focal.y;
    if let Some(other) = like {
        scene.camera = other.camera;
    }
    scene
}

/// Starts the viewer below a layer that makes calls of its swapchain fail (`surface_faults.c`).
fn start(folder: &Path, display: &str) -> Killed {
    let library = folder.join("libsurface_faults.so");
    let mut compile = Command::new("cc");
    compile.args([
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-pedantic",
        "-Werror",
        "-shared",
        "-fPIC",
        "-o",
    ]);
    let source = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/binary/window/surface_faults.c");
    run(compile.arg(&library).arg(source));
    let layer = serde_json::json!({
        "file_format_version": "1.1.2",
        "layer": {
            "name": "VK_LAYER_ASHFALL_surface_faults", "type": "GLOBAL", "library_path": library,
            "api_version": "1.3.0", "implementation_version": "1", "description": "faults of swapchains",
        },
    });
    std::fs::write(folder.join("surface_faults.json"), layer.to_string()).unwrap();
    let mut command = Command::new(example());
    command.args(["scene.ply", "--cameras", ".", "--size", "160x120", "--validate"]);
    command
        .current_dir(folder)
        .env("DISPLAY", display)
        .env("VK_ADD_LAYER_PATH", folder)
        .env("VK_INSTANCE_LAYERS", "VK_LAYER_ASHFALL_surface_faults")
        .env("SURFACE_FAULT", folder.join("fault"))
        .env_remove("WAYLAND_DISPLAY");
    let viewer = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn();
    Killed(viewer.unwrap())
}

/// Outdated swapchains and lost surfaces are made anew: the picture, which is asked for in the frame that fails, is
/// complete.
fn assert_faults_survived(desk: &mut Desk, folder: &Path, picture: &Photo) {
    let fault = folder.join("fault");
    for name in ["acquire outdated", "acquire lost", "present outdated", "present lost"] {
        // Whole at once: a frame may look for it at any time.
        std::fs::write(folder.join("next"), name).unwrap();
        std::fs::rename(folder.join("next"), &fault).unwrap();
        let shown = desk.screenshot();
        assert!(!fault.exists(), "no {name}");
        assert!(shown.rgba == picture.rgba, "another picture after {name}");
    }
}

/// A double click moves the orbit's centre to the depth of the splat, which then stays where it is in the window.
/// Returns that point.
fn assert_orbit_about_a_splat(desk: &mut Desk, scene: &Scene, folder: &Path) -> DVec3 {
    let (camera, before) = (desk.camera(), desk.distance());
    let picture = headless(&camera, scene, folder, None);
    let [width, height] = SIZE.map(|side| side as usize);
    let point = |[x, y]: [usize; 2]| {
        let (pixel, i) = (DVec2::new(x as f64, y as f64) + 0.5, y * width + x);
        camera.position + f64::from(picture.id_depth[i]) * camera.ray_from_pixel(pixel)
    };
    let away = |pixel: &[usize; 2]| (point(*pixel).distance(camera.position) - before).abs();
    // Neighbours of the same splat: rounding of the camera in its file does not count.
    let is_inside = |[x, y]: &[usize; 2]| {
        let near = [y - 1, *y, y + 1].map(|y| [x - 1, *x, x + 1].map(|x| picture.ids[y * width + x]));
        near.as_flattened()
            .iter()
            .all(|id| *id != NO_SPLAT && *id == near[1][1])
    };
    let pixels = (1..height - 1).flat_map(|y| (1..width - 1).map(move |x| [x, y]));
    let pixel = pixels
        .filter(is_inside)
        .max_by(|a, b| away(a).total_cmp(&away(b)))
        .unwrap();
    let (point, wanted) = (point(pixel), point(pixel).distance(camera.position));
    assert!((wanted - before).abs() > 0.1, "{wanted} and {before} are alike");
    desk.double_click(pixel);
    eventually("new centre", || ((desk.distance() - wanted).abs() < 2e-3).then_some(()));
    for key in [RIGHT, RIGHT, UP] {
        desk.press(key);
    }
    let turned = desk.camera();
    assert!(turned.position.distance(camera.position) > 0.1);
    let place = turned.pixel_from_world(point).unwrap();
    let off = place - camera.pixel_from_world(point).unwrap();
    assert!(off.length() < 1e-3, "the centre moves by {off} pixels");
    point
}

/// A key clips to a cube about the orbit's centre, of the distance as its side, and shows all again.
fn assert_clipped(desk: &mut Desk, scene: &Scene, folder: &Path, target: DVec3) {
    let (camera, whole) = (desk.camera(), desk.screenshot());
    let half = DVec3::splat(0.5 * camera.position.distance(target));
    let cube = ClipBox {
        world_from_cube: DMat4::from_scale_rotation_translation(half, DQuat::IDENTITY, target),
        cuts_inside: false,
    };
    desk.press(G);
    let clipped = desk.screenshot();
    assert_drawn(&clipped, &camera, &headless(&camera, scene, folder, Some(cube)));
    assert!(clipped.rgba != whole.rgba, "the cube has all splats");
    desk.press(G);
    assert!(desk.screenshot().rgba == whole.rgba);
}

/// A key orders by distance, in which nothing is picked, and by depth again.
fn assert_ordered(desk: &mut Desk, scene: &Scene, folder: &Path) {
    let (camera, by_depth) = (desk.camera(), desk.screenshot());
    desk.press(O);
    let expected = headless_by(SplatOrder::Distance, &camera, scene, folder, None);
    let by_distance = desk.screenshot();
    assert_drawn(&by_distance, &camera, &expected);
    assert!(by_distance.rgba != by_depth.rgba, "one order for both");
    desk.double_click([10, 10]);
    desk.titled("refusal to pick", |title| title.contains("error: splats are picked"));
    desk.press(O);
    desk.titled("order by depth", |title| !title.contains("error"));
    assert!(desk.screenshot().rgba == by_depth.rgba);
}

/// Changed and dropped files are read; those that cannot be are named in the title, and the scene stays.
fn assert_files_followed(desk: &mut Desk, scene: &Scene, folder: &Path) {
    let (path, other) = (folder.join("scene.ply"), folder.join("other.ply"));
    let (camera, first) = (desk.camera(), desk.screenshot());
    let says = |text: &'static str| move |title: &str| title.contains("error: ") && title.contains(text);
    let replace = |path: &Path, splats: &Splats| {
        write_splats(&folder.join("next.ply"), splats).unwrap();
        std::fs::rename(folder.join("next.ply"), path).unwrap();
    };
    std::fs::write(&path, "ply\n").unwrap();
    desk.titled("error of the changed file", says("scene.ply"));
    std::fs::remove_file(&path).unwrap();
    desk.titled("error of the missing file", says("No such file"));
    assert!(desk.screenshot().rgba == first.rgba, "the scene has gone with its file");

    // Of another origin: the camera stays in its place.
    let mut next = self::scene(6, 70, Some(scene));
    next.splats.origin = DVec3::new(16.0, 0.0, 0.0);
    next.splats.mean.iter_mut().for_each(|mean| mean[0] -= 16.0);
    let inside = Camera {
        position: camera.position - next.splats.origin,
        ..camera
    };
    replace(&path, &next.splats);
    desk.titled("changed scene", |title| {
        title.contains("70 splats") && !title.contains("error")
    });
    assert_drawn(&desk.screenshot(), &camera, &headless(&inside, &next, folder, None));

    std::fs::write(&other, "ply\n").unwrap();
    desk.drop_file(&other);
    desk.titled("error of the dropped file", says("other.ply"));
    replace(&other, &scene.splats);
    desk.drop_file(&other);
    desk.titled("dropped scene", |title| title.contains("other.ply | 80 splats"));
    assert_drawn(&desk.screenshot(), &camera, &headless(&camera, scene, folder, None));
}

/// The window shows the headless picture to the last level, at every size and after turns; a key shows the photograph.
/// Validation is silent until the end, when it would name what is left.
#[test]
fn a_window_shows_what_keys_ask_for() {
    let scene = scene(5, 80, None);
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_splats(&folder.join("scene.ply"), &scene.splats).unwrap();
    let taken = write_data(folder, &scene.camera);
    let (_server, display) = server();
    let mut viewer = start(folder, &display);
    let mut desk = Desk::new(&display, folder);

    desk.press(C);
    let photo = desk.screenshot().rgba;
    let shown: Vec<[u8; 3]> = photo.iter().map(|&[r, g, b, _]| [r, g, b]).collect();
    assert!(shown == taken, "another picture than the photograph");
    for key in [C, B, RIGHT, RIGHT, UP] {
        desk.press(key);
    }
    let (turned, picture) = (desk.camera(), desk.screenshot());
    let ahead = |camera: &Camera| camera.rotation.row(2);
    assert!(ahead(&turned).dot(ahead(&scene.camera)) < 0.99, "10 and 5 degrees");
    assert_drawn(&picture, &turned, &headless(&turned, &scene, folder, None));
    let rgb: Vec<[u8; 3]> = picture.rgba.iter().map(|&[r, g, b, _]| [r, g, b]).collect();
    eventually("picture on the server", || (desk.shown(SIZE) == rgb).then_some(()));

    assert_faults_survived(&mut desk, folder, &picture);
    let target = assert_orbit_about_a_splat(&mut desk, &scene, folder);
    assert_clipped(&mut desk, &scene, folder, target);
    assert_ordered(&mut desk, &scene, folder);
    for size in [[200, 120], [97, 143], [33, 17], [180, 90]] {
        desk.resize(size);
        eventually("picture of the new size", || {
            let photo = desk.screenshot();
            ([photo.width, photo.height] == size).then_some(())
        });
    }
    let (camera, picture) = (desk.camera(), desk.screenshot());
    assert_drawn(&picture, &camera, &headless(&camera, &scene, folder, None));
    assert_files_followed(&mut desk, &scene, folder);

    desk.close();
    let status = eventually("end", || viewer.0.try_wait().unwrap());
    let mut said = String::new();
    viewer.0.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert!(status.success() && !said.contains("validation"), "{said}");
}
