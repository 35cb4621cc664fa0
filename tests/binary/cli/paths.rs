//! Pictures along paths: resumed, with more bits, as a stream; and paths that are none.

use super::{ashfall, error, folder, json, run, stdout, word};
use ashfall::io::ply;
use ashfall::scene::Splats;
use image::DynamicImage;
use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const WIDTH: usize = 46;
const HEIGHT: usize = 34;

/// A scene of a hundred blobs, and a path through it of two cameras of the 3DGS code.
fn scene_and_path(folder: &Path) -> [String; 2] {
    let blob = |i: usize| [1.3, 2.1, 0.7].map(|rate: f32| (rate * i as f32).sin());
    let splats = Splats {
        mean: (0..100).map(blob).collect(),
        quaternion: vec![[1.0, 0.0, 0.0, 0.0]; 100],
        log_scale: vec![[-1.5; 3]; 100],
        opacity_logit: vec![1.0; 100],
        sh: (0..100).flat_map(|i| blob(i + 50)).collect(),
        up: Some(glam::DVec3::Z),
        ..Splats::default()
    };
    let camera = |x: f64| {
        json!({
            "width": WIDTH, "height": HEIGHT, "fx": 40, "fy": 40, "position": [x, 0, -4],
            "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        })
    };
    let (scene, path) = (folder.join("scene.ply"), folder.join("cameras.json"));
    ply::write(&scene, &splats).unwrap();
    fs::write(&path, json!([camera(-0.5), camera(0.5)]).to_string()).unwrap();
    [scene, path].map(|path| word(&path).to_owned())
}

/// Names of the pictures drawn, and the number of those kept.
fn drawn(arguments: &[&str]) -> (Vec<String>, u64) {
    let lines = stdout(&[arguments, &["--json"]].concat());
    let events: Vec<Value> = lines.lines().map(json).collect();
    let name = |event: &Value| Some(event["path"].as_str()?.rsplit('/').next()?.to_owned());
    let kept = events.last().and_then(|done| done["kept"].as_u64());
    (events.iter().filter_map(name).collect(), kept.unwrap())
}

#[test]
fn a_path_is_drawn_once_and_resumed() {
    let folder = folder();
    let [scene, path] = scene_and_path(folder.path());
    let out = folder.path().join("frames");
    let draw = [
        "render",
        &scene,
        "--path",
        &path,
        "--between",
        "2",
        "--out",
        word(&out),
        "--validate",
    ];
    let all: Vec<String> = (0..4).map(|i| format!("path_{i:04}.png")).collect();
    assert_eq!(drawn(&draw), (all.clone(), 0));
    let bytes = |name: &str| fs::read(out.join(name)).unwrap();
    let first: Vec<Vec<u8>> = all.iter().map(|name| bytes(name)).collect();
    assert!(first.windows(2).all(|pair| pair[0] != pair[1]), "the camera moves");
    // The same command draws nothing, or only the missing picture; another one draws all.
    assert_eq!(drawn(&draw), (vec![], 4));
    fs::remove_file(out.join(&all[2])).unwrap();
    assert_eq!(drawn(&draw), (vec![all[2].clone()], 3));
    assert!(all.iter().zip(&first).all(|(name, before)| bytes(name) == *before));
    assert_eq!(drawn(&[&draw[..], &["--overwrite"]].concat()).0.len(), 4);
    let white = [&draw[..], &["--background", "white"]].concat();
    assert_eq!(drawn(&[&white[..], &["--skip-existing"]].concat()), (vec![], 4));
    assert_eq!(drawn(&white), (all.clone(), 0));
    assert!(bytes(&all[0]) != first[0]);
    let mut there: Vec<String> = fs::read_dir(&out)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    there.sort();
    assert_eq!(
        there,
        [&["frames.log".to_owned()], &all[..]].concat(),
        "nothing is left over"
    );
    check_bits(folder.path(), &draw, &first[0]);
}

/// A picture of 16 bits is rounded to that of 8.
fn check_bits(folder: &Path, draw: &[&str], eight: &[u8]) {
    let deep = folder.join("deep");
    let place = draw.iter().position(|argument| *argument == "--out").unwrap() + 1;
    let mut draw = draw.to_vec();
    draw[place] = word(&deep);
    stdout(&[&draw[..], &["--bits", "16"]].concat());
    let sixteen = image::open(deep.join("path_0000.png")).unwrap();
    let DynamicImage::ImageRgb16(sixteen) = sixteen else {
        panic!("of other bits: {:?}", sixteen.color());
    };
    let eight = image::load_from_memory(eight).unwrap().to_rgb8();
    let pairs = sixteen.as_raw().iter().zip(eight.as_raw());
    // A value between two 255ths may be rounded up twice.
    let off = pairs.map(|(a, b)| (f64::from(*a) / 257.0 - f64::from(*b)).abs());
    assert!(off.fold(0.0, f64::max) <= 0.5 + 1.0 / 514.0);
    assert!(sixteen.as_raw().iter().any(|v| v % 257 != 0), "16 bits are used");
}

#[test]
fn streams_have_the_pixels_of_the_pictures() {
    let folder = folder();
    let [scene, path] = scene_and_path(folder.path());
    let out = folder.path().join("frames");
    let draw = ["render", &scene, "--path", &path, "--between", "1", "--out"];
    stdout(&[&draw[..], &[word(&out)]].concat());
    let pictures: Vec<Vec<u8>> = (0..3)
        .map(|i| {
            image::open(out.join(format!("path_{i:04}.png")))
                .unwrap()
                .to_rgb8()
                .into_raw()
        })
        .collect();
    let stream = |more: &[&str]| {
        let output = run(&[&draw[..], &["-"], more].concat());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(0), "{said}");
        output.stdout
    };
    assert!(
        stream(&["--format", "rgb24"]) == pictures.concat(),
        "other bytes than in the files"
    );
    let video = stream(&["--format", "y4m", "--fps", "29.97"]);
    let header = format!("YUV4MPEG2 W{WIDTH} H{HEIGHT} F30000:1001 Ip A1:1 C444 XCOLORRANGE=LIMITED\n");
    let frames = video.strip_prefix(header.as_bytes()).unwrap();
    let pixels = WIDTH * HEIGHT;
    let frames: Vec<&[u8]> = frames.chunks(6 + 3 * pixels).collect();
    assert_eq!(frames.len(), 3);
    for (frame, picture) in frames.iter().zip(&pictures) {
        let planes = frame.strip_prefix(b"FRAME\n").unwrap();
        let luma = |i: usize| {
            let [r, g, b] = [0, 1, 2].map(|c| f64::from(picture[3 * i + c]) / 255.0);
            16.0 + 219.0 * (0.2126 * r + 0.7152 * g + 0.0722 * b)
        };
        // Half a level of the file's rounding, and half a level of the stream's.
        let off = (0..pixels).map(|i| (luma(i) - f64::from(planes[i])).abs());
        assert!(off.fold(0.0, f64::max) <= 0.5 * 219.0 / 255.0 + 0.5);
    }
    for (more, fault) in [
        (&["--format", "png"][..], "--format y4m or rgb24"),
        (&["--format", "y4m", "--json"], "--json"),
        (&["--format", "rgb24", "--bits", "16"], "--bits 16"),
    ] {
        let text = error(&[&draw[..], &["-"], more].concat());
        assert!(text.contains(fault), "{text}");
    }
    let closed = error(&[&draw[..], &[word(&out), "--format", "y4m"]].concat());
    assert!(closed.contains("--out -"), "{closed}");
}

#[test]
fn a_stopped_sequence_goes_on() {
    let folder = folder();
    let [scene, path] = scene_and_path(folder.path());
    let out = folder.path().join("frames");
    let draw = [
        "render",
        &scene,
        "--path",
        &path,
        "--between",
        "300",
        "--size",
        "160x120",
        "--out",
        word(&out),
    ];
    let mut child = ashfall(&draw)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let start = Instant::now();
    while !out.join("path_0001.png").is_file() {
        assert!(
            child.try_wait().unwrap().is_none(),
            "the command ended before it could be stopped"
        );
        assert!(start.elapsed() < Duration::from_secs(60));
        std::thread::sleep(Duration::from_millis(2));
    }
    let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(sent.is_ok_and(|status| status.success()));
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let count = || fs::read_dir(&out).unwrap().count() - 1;
    let before = count();
    assert!((2..302).contains(&before), "{before} pictures");
    let names = fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name());
    assert!(!names.into_iter().any(|name| name.to_string_lossy().ends_with(".tmp")));
    let (rest, kept) = drawn(&draw);
    assert_eq!((rest.len() + before, kept as usize, count()), (302, before, 302));
}

#[test]
fn paths_that_are_none_are_refused_and_leave_nothing() {
    let folder = folder();
    let [scene, path] = scene_and_path(folder.path());
    let out = folder.path().join("frames");
    let bad = folder.path().join("bad.json");
    fs::write(&bad, "{\"camera_path\": [], \"render_width\": 8, \"render_height\": 8}").unwrap();
    let draw = |path: &str, more: &[&str]| {
        error(&[&["render", &scene, "--path", path, "--out", word(&out)][..], more].concat())
    };
    let text = draw(word(&bad), &[]);
    assert!(text.contains("bad.json") && text.contains("is empty"), "{text}");
    let text = draw(word(&folder.path().join("none.json")), &[]);
    assert!(text.contains("none.json"), "{text}");
    let text = draw(&path, &["--path-axes", "LDF"]);
    assert!(text.contains("cameras.json") && text.contains("mirror"), "{text}");
    assert!(!out.exists());
    for wrong in [
        &["--between", "x"][..],
        &["--closed"],
        &["--path-axes", "XYZ"],
        &["--fps", "0"],
        &["--bits", "12"],
        &["--orbit", "3"],
    ] {
        let draw = ["render", &scene, "--path", &path, "--out", word(&out)];
        assert_eq!(run(&[&draw[..], wrong].concat()).status.code(), Some(2), "{wrong:?}");
    }
}

#[test]
fn an_orbit_stands_upright_by_the_file() {
    let folder = folder();
    let [scene, _] = scene_and_path(folder.path());
    let mut lying = ply::read(Path::new(&scene)).unwrap().splats;
    lying.up = None;
    let other = folder.path().join("lying.ply");
    ply::write(&other, &lying).unwrap();
    let picture = |scene: &str, name: &str| {
        let out = folder.path().join(name);
        stdout(&["render", scene, "--orbit", "1", "--size", "64x48", "--out", word(&out)]);
        fs::read(out.join("orbit_0000.png")).unwrap()
    };
    assert!(picture(&scene, "upright") != picture(word(&other), "down"));
}

/// Ten pixels a unit, and cameras a unit apart: the second picture is the first, ten pixels to the left.
#[test]
fn orthographic_pictures_move_with_the_camera() {
    let folder = folder();
    let [scene, path] = scene_and_path(folder.path());
    let out = folder.path().join("flat");
    let height = (HEIGHT as f64 / 10.0).to_string();
    let draw = [
        "render",
        &scene,
        "--path",
        &path,
        "--orthographic",
        &height,
        "--out",
        word(&out),
    ];
    stdout(&[&draw[..], &["--validate"]].concat());
    let picture = |name: &str| image::open(out.join(name)).unwrap().to_rgb8();
    let [first, second] = ["path_0000.png", "path_0001.png"].map(picture);
    let (mut off, mut seen) = (0, 0);
    for (x, y, pixel) in second.enumerate_pixels().filter(|(x, ..)| *x < WIDTH as u32 - 10) {
        for (a, b) in pixel.0.into_iter().zip(first.get_pixel(x + 10, y).0) {
            off = off.max(a.abs_diff(b));
            seen = seen.max(a);
        }
    }
    // Positions rounded otherwise, which may round a level otherwise.
    assert!(off <= 1 && seen > 100, "{off} levels of {seen}");
    for (wrong, fault) in [
        (["--show", "normal"], "--orthographic"),
        (["--compat", "original"], "--orthographic"),
    ] {
        let text = error(&[&draw[..], &wrong].concat());
        assert!(text.contains(fault), "{text}");
    }
}

#[test]
fn panoramas_join_without_seams() {
    let folder = folder();
    let [scene, path] = scene_and_path(folder.path());
    let out = folder.path().join("around");
    let draw = [
        "render",
        &scene,
        "--path",
        &path,
        "--panorama",
        "--out",
        word(&out),
        "--validate",
    ];
    stdout(&[&draw[..], &["--size", "256x128", "--bits", "16"]].concat());
    let picture = image::open(out.join("path_0000.png")).unwrap().to_rgb16();
    assert_eq!(picture.dimensions(), (256, 128));
    let level = |x: u32, y: u32| picture.get_pixel(x % 256, y).0.map(|v| f64::from(v) / 65_535.0);
    // The largest step to the right neighbour: at the sides of the cube, at 45 degrees from the axis, and elsewhere.
    let step = |x: u32| {
        let pairs = (0..128).map(|y| level(x, y).into_iter().zip(level(x + 1, y)));
        pairs.flatten().map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    let seams = [31, 95, 159, 223, 255].map(step).into_iter().fold(0.0, f64::max);
    let inside = (0..256).filter(|x| x % 32 != 31).map(step).fold(0.0, f64::max);
    assert!(inside > 0.01 && seams <= 2.0 * inside, "{seams}, {inside}");
    let refused = error(&[&draw[..], &["--format", "exr"]].concat());
    assert!(refused.contains("--panorama"), "{refused}");
}
