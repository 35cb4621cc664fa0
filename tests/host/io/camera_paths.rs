//! Camera paths: the same cameras in every form, by hand-made truths, and files that are none.

use crate::common::files::{self, FOCAL, HEIGHT, WIDTH};
use crate::io::error_at;
use ashfall::io::Source;
use ashfall::io::camera_path::{self, CameraPath, DATAPARSER, PathOptions};
use ashfall::scene::{Axes, Camera, Similarity};
use glam::{DMat3, DQuat, DVec2, DVec3};
use serde_json::{Value, json};
use std::path::Path;

/// From camera axes y up, z backward to y down, z forward.
const FLIP: DMat3 = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));

/// A rotation and a translation with a scale: the map to a normalised world.
fn normalising() -> Similarity {
    Similarity {
        rotation: DMat3::from_quat(DQuat::from_xyzw(0.5, -0.1, 0.3, 0.8).normalize()),
        scale: 0.125,
        translation: DVec3::new(0.3, -0.2, 0.1),
    }
}

fn parse(name: &str, value: &Value, options: &PathOptions) -> ashfall::Result<CameraPath> {
    camera_path::read(Source::bytes(Path::new(name), value.to_string().as_bytes()), options)
}

#[track_caller]
fn assert_poses(found: &[Camera], order: &[usize], tolerance: f64) {
    assert_eq!(found.len(), order.len());
    let poses = files::poses();
    for (camera, pose) in found.iter().zip(order.iter().map(|&i| &poses[i])) {
        assert!(camera.rotation.abs_diff_eq(pose.rotation(), tolerance), "{camera:?}");
        assert!(camera.position.abs_diff_eq(pose.position(), tolerance), "{camera:?}");
    }
}

fn rows(matrix: DMat3) -> [[f64; 3]; 3] {
    matrix.transpose().to_cols_array_2d()
}

/// A `camera_path.json` of the poses in a world.
fn nerfstudio(world: &Similarity) -> Value {
    let camera = |pose: &files::Pose| {
        let [x, y, z] = rows(world.rotation * pose.rotation().transpose() * FLIP);
        let position = world.point(pose.position());
        let row = |[a, b, c]: [f64; 3], p: f64| [a, b, c, p];
        let matrix = [
            row(x, position.x),
            row(y, position.y),
            row(z, position.z),
            [0.0, 0.0, 0.0, 1.0],
        ];
        json!({"camera_to_world": matrix.concat(), "fov": 50.0, "aspect": 1.5})
    };
    let cameras: Vec<Value> = files::poses().iter().map(camera).collect();
    json!({
        "camera_type": "perspective", "render_width": 1920, "render_height": 1080.0, "fps": 24, "seconds": 4,
        "is_cycle": true, "smoothness_value": 0.5, "keyframes": [], "camera_path": cameras,
    })
}

#[test]
fn nerfstudio_paths_lead_back_to_the_world_of_the_data_set() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("camera_path.json");
    // The transform has no scale; the scale comes after it.
    let world = normalising();
    let translation = world.translation / world.scale;
    let [x, y, z] = rows(world.rotation);
    let transform = [(x, translation.x), (y, translation.y), (z, translation.z)].map(|([a, b, c], t)| [a, b, c, t]);
    let parser = folder.path().join(DATAPARSER);
    std::fs::write(&path, nerfstudio(&world).to_string()).unwrap();
    assert_eq!(camera_path::dataparser(&path), None);
    std::fs::write(
        &parser,
        json!({"transform": transform, "scale": world.scale}).to_string(),
    )
    .unwrap();
    assert_eq!(camera_path::dataparser(&path).as_ref(), Some(&parser));
    let mut options = PathOptions {
        world: Some(camera_path::normalised_world(&parser).unwrap()),
        ..PathOptions::default()
    };
    let read = camera_path::open(&path, &options).unwrap();
    assert_poses(&read.cameras, &[0, 1, 2], 1e-12);
    assert_eq!((read.rate, read.is_closed, read.warnings.len()), (Some(24.0), true, 0));
    let camera = read.cameras[0];
    assert_eq!((camera.width, camera.height), (1920, 1080));
    // 540 pixels at half of 50 degrees.
    assert!((camera.focal - DVec2::splat(540.0 / 25_f64.to_radians().tan())).length() < 1e-9);
    assert_eq!(camera.center, DVec2::new(960.0, 540.0));
    // Another size shows the same height.
    options.size = Some([400, 540]);
    let small = camera_path::open(&path, &options).unwrap().cameras[0];
    assert_eq!((small.width, small.center), (400, DVec2::new(200.0, 270.0)));
    assert!((small.focal * 2.0 - camera.focal).length() < 1e-9);
    // A data set with an applied transform has its cameras behind that.
    let applied = json!({"applied_transform": [[1, 0, 0, 0.5], [0, 0, 1, 0], [0, -1, 0, 0]], "frames": []});
    let file = folder.path().join("transforms.json");
    std::fs::write(&file, applied.to_string()).unwrap();
    let applied = camera_path::applied_transform(&file).unwrap();
    options.world = Some(applied.after(&options.world.unwrap()));
    let moved = camera_path::open(&path, &options).unwrap();
    let position = files::poses()[0].position();
    let wanted = DVec3::new(position.x + 0.5, position.z, -position.y);
    assert!(moved.cameras[0].position.distance(wanted) < 1e-12);
    // Without the file, the scene is taken to be in the normalised world, and said to be.
    let bare = camera_path::open(&path, &PathOptions::default()).unwrap();
    assert!(bare.cameras[0].position.distance(world.point(position)) < 1e-12);
    assert!(
        bare.warnings.len() == 1 && bare.warnings[0].contains(DATAPARSER),
        "{:?}",
        bare.warnings
    );
}

#[test]
fn cameras_of_the_3dgs_code_are_read() {
    let camera = |(id, pose): (usize, &files::Pose)| {
        json!({
            "id": id, "img_name": "00001", "width": WIDTH, "height": HEIGHT, "fx": FOCAL[0], "fy": FOCAL[1],
            "position": pose.position().to_array(), "rotation": rows(pose.rotation().transpose()),
        })
    };
    let list: Vec<Value> = files::poses().iter().enumerate().map(camera).collect();
    let read = parse("cameras.json", &json!(list), &PathOptions::default()).unwrap();
    assert_poses(&read.cameras, &[0, 1, 2], 1e-12);
    assert_eq!(read.cameras[2].focal.to_array(), FOCAL);
    assert_eq!((read.rate, read.warnings.len()), (None, 0));
}

#[test]
fn reconstructions_need_neither_photographs_nor_points() {
    let folder = tempfile::tempdir().unwrap();
    let options = PathOptions::default();
    let mut frames = files::transforms();
    for frame in frames["frames"].as_array_mut().unwrap() {
        frame["w"] = json!(WIDTH);
        frame["h"] = json!(HEIGHT);
    }
    let read = parse("transforms.json", &frames, &options).unwrap();
    assert_poses(&read.cameras, &[0, 1, 2], 1e-12);
    for (name, write) in [
        ("text", files::write_text as fn(&Path)),
        ("binary", files::write_binary),
    ] {
        let model = folder.path().join(name).join("sparse/0");
        write(&model);
        let points = model.join("points3D.txt");
        if points.is_file() {
            std::fs::remove_file(points).unwrap();
        }
        let images = model.join(if name == "text" { "images.txt" } else { "images.bin" });
        for path in [model.clone(), folder.path().join(name), images] {
            let read = camera_path::open(&path, &options).unwrap();
            // By name: "a b c.png", "c.png", "sub/b.png".
            assert_poses(&read.cameras, &[1, 0, 2], 1e-12);
            assert_eq!(read.warnings, Vec::<String>::new());
        }
    }
    let empty = folder.path().join("empty");
    std::fs::create_dir(&empty).unwrap();
    assert!(error_at(camera_path::open(&empty, &options), &empty).contains("no camera path"));
}

/// A glTF document of cameras below a turned parent.
fn gltf() -> Value {
    let outer = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 0.7);
    let luf = Axes::RDF.to(Axes::LUF);
    let node = |pose: &files::Pose| {
        let linear = DMat3::from_quat(outer).transpose() * luf * pose.rotation().transpose() * FLIP;
        let position = outer.conjugate() * (luf * pose.position() - DVec3::X) / 2.0;
        json!({
            "camera": 0, "translation": position.to_array(), "rotation": DQuat::from_mat3(&linear).to_array(),
            "scale": [3, 3, 3],
        })
    };
    let mut nodes = vec![json!({
        "children": [1, 2, 3], "rotation": outer.to_array(), "translation": [1, 0, 0], "scale": [2, 2, 2],
    })];
    nodes.extend(files::poses().iter().map(node));
    nodes.push(json!({"camera": 1}));
    json!({
        "asset": {"version": "2.0"}, "extensionsRequired": ["KHR_draco_mesh_compression"], "nodes": nodes,
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.8, "aspectRatio": 1.5, "znear": 0.1}},
            {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "znear": 0, "zfar": 1}}],
    })
}

#[test]
fn cameras_of_gltf_nodes_are_read() {
    let mut options = PathOptions::default();
    let read = parse("path.gltf", &gltf(), &options).unwrap();
    assert_poses(&read.cameras, &[0, 1, 2], 1e-12);
    let camera = read.cameras[0];
    assert_eq!((camera.width, camera.height), (1080, 720));
    assert!((camera.focal - DVec2::splat(360.0 / 0.4_f64.tan())).length() < 1e-9);
    assert!(read.warnings.len() == 1 && read.warnings[0].contains("1 of the cameras is not perspective"));
    // In other axes, y up and z back, the same numbers are another place.
    options.axes = Some(Axes::RUB);
    let turned = parse("path.gltf", &gltf(), &options).unwrap();
    let wanted = Axes::RUB.to(Axes::RDF) * Axes::RDF.to(Axes::LUF) * files::poses()[0].position();
    assert!(turned.cameras[0].position.distance(wanted) < 1e-12);
    options.axes = Axes::parse("LDF");
    let mirrored = error_at(parse("path.gltf", &gltf(), &options), Path::new("path.gltf"));
    assert!(mirrored.contains("LDF mirror"), "{mirrored}");
}

/// A camera with tracks of translation and rotation; times and values lie in `animation.bin`.
fn animated(folder: &Path, interpolation: &str, translations: &[[f32; 3]]) -> CameraPath {
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let times = [0.5_f32, 1.5];
    let rotations = [[0.0, 0.0, 0.0, 1.0], [0.0, half, 0.0, half]];
    let floats = [&times[..], translations.as_flattened(), rotations.as_flattened()].concat();
    let bytes: Vec<u8> = floats.iter().flat_map(|v| v.to_le_bytes()).collect();
    std::fs::write(folder.join("animation.bin"), &bytes).unwrap();
    let moved = 12 * translations.len();
    let view = |offset: usize, length: usize| json!({"buffer": 0, "byteOffset": offset, "byteLength": length});
    let float = 5126;
    let accessor = |view: usize, count: usize, shape: &str| json!({"bufferView": view, "componentType": float, "count": count, "type": shape});
    let document = json!({
        "asset": {"version": "2.0"}, "nodes": [{"children": [1]}, {"camera": 0}, {"camera": 0}],
        "cameras": [{"perspective": {"yfov": 0.8}}],
        "animations": [{
            "channels": [{"sampler": 0, "target": {"node": 0, "path": "translation"}},
                {"sampler": 1, "target": {"node": 1, "path": "rotation"}},
                {"sampler": 1, "target": {"node": 1, "path": "weights"}}],
            "samplers": [{"input": 0, "output": 1, "interpolation": interpolation}, {"input": 0, "output": 2}],
        }],
        "accessors": [accessor(0, 2, "SCALAR"), accessor(1, translations.len(), "VEC3"), accessor(2, 2, "VEC4")],
        "bufferViews": [view(0, 8), view(8, moved), view(8 + moved, 32)],
        "buffers": [{"uri": "animation.bin", "byteLength": bytes.len()}],
    });
    let path = folder.join("path.gltf");
    std::fs::write(&path, document.to_string()).unwrap();
    let options = PathOptions {
        rate: Some(4.0),
        ..PathOptions::default()
    };
    camera_path::open(&path, &options).unwrap()
}

#[test]
fn animated_cameras_are_sampled_at_the_rate() {
    let folder = tempfile::tempdir().unwrap();
    let heights = |path: &CameraPath| -> Vec<f64> { path.cameras.iter().map(|c| c.position.z).collect() };
    let line = animated(folder.path(), "LINEAR", &[[0.0; 3], [0.0, 0.0, 2.0]]);
    assert_eq!(heights(&line), [0.0, 0.5, 1.0, 1.5, 2.0]);
    assert_eq!((line.rate, line.warnings.len()), (Some(4.0), 1));
    assert!(
        line.warnings[0].contains("of 2 cameras, the animated one of node 1"),
        "{:?}",
        line.warnings
    );
    // A quarter turn about the vertical, evenly.
    for (i, camera) in line.cameras.iter().enumerate() {
        let turn = DMat3::from_rotation_y(std::f64::consts::FRAC_PI_2 * i as f64 / 4.0);
        let wanted = (Axes::LUF.to(Axes::RDF) * turn * FLIP).transpose();
        assert!(camera.rotation.abs_diff_eq(wanted, 1e-7), "{i}");
    }
    let steps = animated(folder.path(), "STEP", &[[0.0; 3], [0.0, 0.0, 2.0]]);
    assert_eq!(heights(&steps), [0.0, 0.0, 0.0, 0.0, 2.0]);
    // Tangents before, value, tangent after: leaves with 4 a second, arrives with 0; t² (3 − 2t) 2 + (1 − t)² t 4.
    let z = |z: f32| [0.0, 0.0, z];
    let cubic = animated(
        folder.path(),
        "CUBICSPLINE",
        &[z(9.0), z(0.0), z(4.0), z(0.0), z(2.0), z(9.0)],
    );
    let wanted = |t: f64| t * t * (3.0 - 2.0 * t) * 2.0 + (1.0 - t).powi(2) * t * 4.0;
    for (i, height) in heights(&cubic).iter().enumerate() {
        assert!((height - wanted(i as f64 / 4.0)).abs() < 1e-12, "{i}: {height}");
    }
}

/// Changes of a valid document, each with words of the fault.
type Faults<'a> = &'a [(&'a str, Value, &'a [&'a str])];

#[track_caller]
fn refuses(name: &str, valid: &Value, faults: Faults<'_>) {
    assert!(parse(name, valid, &PathOptions::default()).is_ok(), "{name}");
    for (pointer, value, words) in faults {
        let mut changed = valid.clone();
        match pointer.strip_suffix("/-") {
            Some(of) => {
                let (parent, key) = of.rsplit_once('/').unwrap();
                changed
                    .pointer_mut(parent)
                    .unwrap()
                    .as_object_mut()
                    .unwrap()
                    .remove(key);
            }
            None => *changed.pointer_mut(pointer).unwrap() = value.clone(),
        }
        let text = error_at(parse(name, &changed, &PathOptions::default()), Path::new(name));
        assert!(words.iter().all(|word| text.contains(word)), "{pointer}: {text}");
        assert_eq!(text.lines().count(), 1, "{text}");
    }
}

#[test]
fn damaged_paths_are_refused_by_camera_and_key() {
    let none = Value::Null;
    refuses(
        "camera_path.json",
        &nerfstudio(&Similarity::IDENTITY),
        &[
            ("/camera_path", json!([]), &["\"camera_path\" is empty"]),
            ("/camera_path", json!(3), &["is not a list"]),
            ("/camera_path/1", json!(3), &["camera 1", "a number, not an object"]),
            ("/camera_path/1/fov/-", none.clone(), &["camera 1", "no \"fov\""]),
            ("/camera_path/2/fov", json!(180), &["camera 2", "180 degrees"]),
            (
                "/camera_path/2/camera_to_world",
                json!([1, 2]),
                &["camera 2", "16 numbers"],
            ),
            ("/camera_path/2/camera_to_world/3", json!("x"), &["camera 2", "a text"]),
            (
                "/camera_path/0/camera_to_world",
                json!(vec![0; 16]),
                &["camera 0", "singular"],
            ),
            ("/camera_path/0/camera_to_world/3", json!(1e30), &["camera 0", "limit"]),
            ("/camera_type", json!("fisheye"), &["\"fisheye\"", "not supported"]),
            ("/render_width", json!(0), &["0 x 1080"]),
            ("/render_height/-", none.clone(), &["render_height"]),
        ],
    );
    let camera = json!({
        "id": 0, "img_name": "a", "width": 4, "height": 3, "fx": 5, "fy": 5, "position": [0, 0, 0],
        "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    });
    refuses(
        "cameras.json",
        &json!([camera.clone(), camera]),
        &[
            ("", json!([]), &["empty list"]),
            ("", json!("text"), &["top level", "a text"]),
            ("", json!({}), &["no camera path"]),
            ("/1/width", json!(4.5), &["camera 1", "4.5"]),
            ("/1/fx", json!(-5), &["camera 1", "not positive"]),
            ("/1/position/-", none.clone(), &["camera 1", "\"position\""]),
            (
                "/1/rotation",
                json!([[1, 0, 0], [0, 1, 0]]),
                &["camera 1", "3 rows of 3"],
            ),
            ("/1/rotation/2", json!([0, 0, -1]), &["camera 1", "reflection"]),
            ("/1/rotation/2", json!([0, 1, 1]), &["camera 1", "sheared"]),
        ],
    );
    refuses(
        "path.gltf",
        &gltf(),
        &[
            ("/nodes/2/camera", json!(7), &["camera 7"]),
            ("/cameras/0/perspective/yfov", json!(0), &["camera 0", "yfov"]),
            (
                "/cameras/0/perspective/aspectRatio",
                json!(-1),
                &["camera 0", "aspectRatio"],
            ),
            (
                "/cameras/0/perspective/aspectRatio",
                json!(1e9),
                &["node 1", "image size"],
            ),
            (
                "/nodes/4",
                json!({"camera": 1, "children": [1]}),
                &["node 1", "two parents"],
            ),
            ("/nodes/0/scale", json!([1, 1, -1]), &["node 1", "reflection"]),
            ("/nodes/0/rotation", json!([0, 0, 0, 0]), &["node 0", "length"]),
            ("/nodes", json!([{}]), &["no perspective camera"]),
            ("/asset/version", json!("1.0"), &["version"]),
        ],
    );
}

#[test]
fn damaged_transforms_of_nerfstudio_are_refused() {
    let name = Path::new(DATAPARSER);
    let read = |text: &str| {
        error_at(
            camera_path::normalised_world(Source::bytes(name, text.as_bytes())),
            name,
        )
    };
    let matrix = |rows: &str| format!("{{\"transform\": {rows}, \"scale\": 2}}");
    assert!(read("{").contains("JSON"));
    assert!(read("[]").contains("not an object"));
    assert!(read("{\"scale\": 1}").contains("no \"transform\""));
    assert!(read(&matrix("[[1,0,0,0],[0,1,0,0]]")).contains("3 rows of 4"));
    assert!(read(&matrix("[[2,0,0,0],[0,2,0,0],[0,0,2,0]]")).contains("a scale of 2"));
    assert!(read(&matrix("[[1,0,0,0],[0,1,0,0],[0,0,-1,0]]")).contains("reflection"));
    let scaled = |scale: &str| {
        let rows = "[[1,0,0,0],[0,1,0,0],[0,0,1,0]]";
        read(&format!("{{\"transform\": {rows}, \"scale\": {scale}}}"))
    };
    assert!(scaled("0").contains("\"scale\" of 0") && scaled("\"a\"").contains("a text"));
}

#[test]
fn tracks_of_damaged_animations_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    animated(folder.path(), "LINEAR", &[[0.0; 3], [0.0, 0.0, 2.0]]);
    let path = folder.path().join("path.gltf");
    let valid: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let faults: Faults<'_> = &[
        (
            "/accessors/1/count",
            json!(1),
            &["animation 0", "2 times need 1 values"],
        ),
        ("/accessors/0/bufferView", json!(2), &["channel 0", "do not increase"]),
        ("/accessors/0/type", json!("VEC2"), &["Scalar"]),
        (
            "/animations/0/samplers/0/interpolation",
            json!("SMOOTH"),
            &["\"SMOOTH\""],
        ),
        ("/animations/0/channels/0/sampler", json!(9), &["sampler 9"]),
        ("/animations/0/channels/0/target/node", json!(9), &["node 9"]),
        (
            "/accessors/0",
            json!({"componentType": 5126, "count": 3_000_000, "type": "SCALAR"}),
            &["3000000 times"],
        ),
    ];
    for (pointer, value, words) in faults {
        let mut changed = valid.clone();
        *changed.pointer_mut(pointer).unwrap() = value.clone();
        std::fs::write(&path, changed.to_string()).unwrap();
        let text = error_at(camera_path::open(&path, &PathOptions::default()), &path);
        assert!(words.iter().all(|word| text.contains(word)), "{pointer}: {text}");
    }
    let long = PathOptions {
        rate: Some(1e6),
        ..PathOptions::default()
    };
    std::fs::write(&path, valid.to_string()).unwrap();
    assert!(error_at(camera_path::open(&path, &long), &path).contains("1000001 frames"));
}
