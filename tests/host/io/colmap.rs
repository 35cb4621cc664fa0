//! COLMAP models: text and binary load alike, truncation is an error, and the shared scenes match their description.

use crate::common::files::{self, CENTER, FOCAL, HEIGHT, WIDTH};
use crate::io::{error_at, for_every_prefix, shared};
use ashfall::io::dataset::{self, OpenOptions};
use ashfall::io::{photo, refined};
use ashfall::scene::{AlphaMode, Dataset, Lens, PhotoSource, Split};
use glam::{DQuat, DVec3};
use std::path::Path;

fn options() -> OpenOptions {
    OpenOptions::default()
}

/// Two folders with photographs and a model, one binary, one text.
fn both_forms() -> (tempfile::TempDir, tempfile::TempDir) {
    let folders = [(); 2].map(|()| tempfile::tempdir().unwrap());
    for (folder, binary) in folders.iter().zip([true, false]) {
        files::write_photos(&folder.path().join("images"));
        let model = folder.path().join("sparse/0");
        if binary {
            files::write_binary(&model);
        } else {
            files::write_text(&model);
        }
    }
    let [binary, text] = folders;
    (binary, text)
}

#[test]
fn text_and_binary_load_alike() {
    let (binary, text) = both_forms();
    let [a, b] = [&binary, &text].map(|f| dataset::open(f.path(), &options()).unwrap());
    assert_eq!(a.warnings, Vec::<String>::new());
    assert_eq!(b.warnings, Vec::<String>::new());
    assert_eq!(a.points, b.points);
    for (a, b) in a.views.iter().zip(&b.views) {
        assert_eq!((&a.name, a.camera), (&b.name, b.camera));
        assert_eq!(photo::load(a).unwrap(), photo::load(b).unwrap());
    }
    let names: Vec<&str> = a.views.iter().map(|v| v.name.as_str()).collect();
    assert_eq!(names, ["a b c.png", "c.png", "sub/b.png"], "sorted by name");
    assert_eq!(a.alpha, AlphaMode::Composite);
}

#[test]
fn values_are_those_of_the_files() {
    let (folder, _) = both_forms();
    let data = dataset::open(folder.path(), &options()).unwrap();
    for pose in files::poses() {
        let view = data.views.iter().find(|v| v.name == pose.name).unwrap();
        let camera = view.camera;
        assert_eq!((camera.width, camera.height), (WIDTH, HEIGHT));
        assert_eq!((camera.focal.to_array(), camera.center.to_array()), (FOCAL, CENTER));
        assert!(camera.rotation.abs_diff_eq(pose.rotation(), 1e-12));
        assert!(camera.position.abs_diff_eq(pose.position(), 1e-12));
        let photo = photo::load(view).unwrap();
        assert_eq!(photo.rgba[3], [60, 0, pose.id as u8, 255]);
        assert_eq!(photo.rgba[WIDTH as usize + 1], [20, 30, pose.id as u8, 255]);
    }
    let mut points = files::points();
    points.sort_by_key(|(id, _)| *id);
    let points: Vec<_> = points.into_iter().map(|(_, point)| point).collect();
    assert_eq!(data.points, points, "in the order of their ids");
    // The first view in sorted order is the test view.
    assert_eq!(data.split(Split::Test), [0]);
    assert_eq!(data.split(Split::Train), [1, 2]);
}

#[test]
fn the_model_may_lie_anywhere_usual() {
    let folder = tempfile::tempdir().unwrap();
    files::write_photos(&folder.path().join("images"));
    let expect = |opened: &Path| {
        let data = dataset::open(opened, &options()).unwrap();
        assert_eq!(data.views.len(), 3, "{}", opened.display());
    };
    files::write_binary(&folder.path().join("sparse/0"));
    // Files of COLMAP 3.12 and later, which a model may do without.
    std::fs::write(folder.path().join("sparse/0/rigs.bin"), b"?").unwrap();
    std::fs::write(folder.path().join("sparse/0/frames.bin"), b"?").unwrap();
    expect(folder.path());
    expect(&folder.path().join("sparse/0"));
    std::fs::rename(folder.path().join("sparse/0"), folder.path().join("flat")).unwrap();
    std::fs::remove_dir(folder.path().join("sparse")).unwrap();
    std::fs::rename(folder.path().join("flat"), folder.path().join("sparse")).unwrap();
    expect(folder.path());
    // A folder of photographs under another name.
    std::fs::rename(folder.path().join("images"), folder.path().join("photos")).unwrap();
    let text = error_at(dataset::open(folder.path(), &options()), folder.path());
    assert!(text.contains("3 of 3 photographs are missing"), "{text}");
    let named = OpenOptions {
        images: Some("photos".into()),
        ..options()
    };
    assert_eq!(dataset::open(folder.path(), &named).unwrap().views.len(), 3);
    let cameras_only = OpenOptions {
        photos_required: false,
        ..options()
    };
    let data = dataset::open(folder.path(), &cameras_only).unwrap();
    assert!(data.views.iter().all(|v| v.photo == PhotoSource::Absent));
}

#[test]
fn a_model_cut_anywhere_is_an_error() {
    let (folder, _) = both_forms();
    for name in ["cameras.bin", "images.bin", "points3D.bin"] {
        let path = folder.path().join("sparse/0").join(name);
        let contents = std::fs::read(&path).unwrap();
        let open = |_: &Path| dataset::open(folder.path(), &options());
        for_every_prefix(&contents, &path, open, |_, result| {
            error_at(result, &path);
        });
        std::fs::write(&path, &contents).unwrap();
    }
    dataset::open(folder.path(), &options()).unwrap();
}

#[test]
fn no_damage_to_a_model_is_fatal() {
    let (binary, text) = both_forms();
    for (folder, extension) in [(&binary, "bin"), (&text, "txt")] {
        for stem in ["cameras", "images", "points3D"] {
            let path = folder.path().join(format!("sparse/0/{stem}.{extension}"));
            let contents = std::fs::read(&path).unwrap();
            for at in 0..contents.len() {
                for byte in [0, 0x7f, 0xff, b'\n', b' '] {
                    let mut damaged = contents.clone();
                    damaged[at] = byte;
                    std::fs::write(&path, damaged).unwrap();
                    if let Ok(data) = dataset::open(folder.path(), &options()) {
                        let poses = data.views.iter().map(|v| v.camera);
                        assert!(poses.clone().all(|c| c.position.is_finite()));
                        let orthonormal = |c: ashfall::scene::Camera| {
                            let square = c.rotation * c.rotation.transpose();
                            square.abs_diff_eq(glam::DMat3::IDENTITY, 1e-9)
                        };
                        assert!(poses.clone().all(orthonormal), "{stem} {at} {byte}");
                    }
                }
            }
            std::fs::write(&path, contents).unwrap();
        }
    }
}

#[test]
fn camera_models_become_pinholes_with_distortion() {
    let (_, folder) = both_forms();
    let cameras = folder.path().join("sparse/0/cameras.txt");
    let open = |line: &str| {
        std::fs::write(&cameras, format!("5 {line}\n")).unwrap();
        dataset::open(folder.path(), &options())
    };
    let distortion = |data: Dataset| match &data.views[0].photo {
        PhotoSource::File { optics, .. } => optics.as_ref().map(|optics| match optics.lens {
            Lens::Brown(d) => [d.k1, d.k2, d.p1, d.p2],
            other => panic!("{other:?}"),
        }),
        _ => panic!("no file"),
    };
    for (line, focal, expected) in [
        ("SIMPLE_PINHOLE 12 8 20 6 4", [20.0, 20.0], None),
        ("PINHOLE 12 8 20 21 6 4", [20.0, 21.0], None),
        (
            "SIMPLE_RADIAL 12 8 20 6 4 0.1",
            [20.0, 20.0],
            Some([0.1, 0.0, 0.0, 0.0]),
        ),
        ("RADIAL 12 8 20 6 4 0.1 0.2", [20.0, 20.0], Some([0.1, 0.2, 0.0, 0.0])),
        ("OPENCV 12 8 20 21 6 4 0 0 0 0", [20.0, 21.0], None),
        (
            "OPENCV 12 8 20 21 6 4 0.1 0.2 0.3 0.4",
            [20.0, 21.0],
            Some([0.1, 0.2, 0.3, 0.4]),
        ),
    ] {
        let data = open(line).unwrap();
        assert_eq!(data.views[0].camera.focal.to_array(), focal, "{line}");
        assert_eq!(data.views[0].camera.center.to_array(), [6.0, 4.0], "{line}");
        let mask = if expected.is_some() {
            AlphaMode::Mask
        } else {
            AlphaMode::Composite
        };
        assert_eq!(data.alpha, mask, "borders are empty where there is distortion");
        assert_eq!(distortion(data), expected, "{line}");
    }
    for model in ["OPENCV_FISHEYE", "FOV", "EUCM", "EQUIRECTANGULAR"] {
        let text = error_at(open(&format!("{model} 12 8 {}", "1 ".repeat(12).trim())), &cameras);
        assert!(text.contains(model) && text.contains("more"), "{text}");
    }
    assert!(error_at(open("OPENCV 12 8 20 21 6 4 nan 0 0 0"), &cameras).contains("distortion"));
}

#[test]
fn numbers_of_c_libraries_are_read() {
    let (_, folder) = both_forms();
    let path = folder.path().join("sparse/0/points3D.txt");
    let mut text = std::fs::read_to_string(&path).unwrap();
    text += "1000 -nan(ind) 0 0 1 2 3 0\n1001 1.#INF 0 0 1 2 3 0\n1002 -1.#IND 0 0 1 2 3 0\n";
    std::fs::write(&path, text).unwrap();
    let data = dataset::open(folder.path(), &options()).unwrap();
    assert_eq!(data.points.len(), 4);
    assert!(data.warnings[0].contains("3 of 7 points"), "{:?}", data.warnings);
}

#[test]
fn the_shared_scenes_are_as_described() {
    let Some(root) = shared("fox/colmap").map(|p| p.join("../..")) else {
        return;
    };
    for (scene, views, points, tests, size) in [
        (
            "fox/colmap",
            50,
            11920,
            "0001.jpg 0012.jpg 0027.jpg 0042.jpg 0073.jpg 0089.jpg 0110.jpg",
            (270, 480),
        ),
        ("castle", 11, 5024, "100_7100.jpg 100_7108.jpg", (960, 710)),
        ("banana", 14, 4421, "DSC_0423.jpg DSC_0432.jpg", (960, 638)),
    ] {
        let data = dataset::open(&root.join(scene), &options()).unwrap();
        assert_eq!(data.warnings, Vec::<String>::new());
        assert_eq!((data.views.len(), data.points.len()), (views, points), "{scene}");
        let held_out = data.split(Split::Test).into_iter();
        let held_out: Vec<&str> = held_out.map(|i| data.views[i].name.as_str()).collect();
        assert_eq!(held_out, tests.split(' ').collect::<Vec<_>>());
        let camera = data.views[0].camera;
        assert_eq!((camera.width, camera.height), size);
        assert!(data.extent() > 0.1, "{}", data.extent());
        // At least half of the points are in front of and inside some view.
        let seen = data.points.iter().filter(|point| {
            let point = glam::DVec3::from(point.position);
            data.views.iter().any(|view| {
                view.camera
                    .pixel_from_world(point)
                    .is_some_and(|p| p.x > 0.0 && p.y > 0.0 && p.x < size.0.into() && p.y < size.1.into())
            })
        });
        assert_eq!(seen.count(), points, "{scene}: all points are seen");
    }
}

/// `rigs.bin` and `frames.bin` of the poses: the camera of the images is the second of a rig.
fn write_rigs(model: &Path) {
    let pose = |turn: DQuat, shift: DVec3| {
        let numbers = [turn.w, turn.x, turn.y, turn.z, shift.x, shift.y, shift.z];
        numbers.map(f64::to_le_bytes).concat()
    };
    let (turn, shift) = (DQuat::from_rotation_y(0.4), DVec3::new(0.2, -0.1, 0.3));
    let mut rigs = [
        &1u64.to_le_bytes()[..],
        &[3u32, 2, 0, 9, 0, 5].map(u32::to_le_bytes).concat(),
        &[1],
    ]
    .concat();
    rigs.extend(pose(turn, shift));
    std::fs::write(model.join("rigs.bin"), rigs).unwrap();
    let poses = files::poses();
    let mut frames = (poses.len() as u64).to_le_bytes().to_vec();
    for (id, view) in (0u32..).zip(poses) {
        frames.extend([id, 3].map(u32::to_le_bytes).concat());
        let from_world = turn.inverse() * view.quaternion;
        frames.extend(pose(from_world, turn.inverse() * (view.translation - shift)));
        frames.extend([1u32, 0, 5, view.id, 0].map(u32::to_le_bytes).concat());
    }
    std::fs::write(model.join("frames.bin"), frames).unwrap();
}

#[test]
fn poses_of_rigs_and_frames_come_before_stale_ones() {
    let (folder, _) = both_forms();
    let model = folder.path().join("sparse/0");
    let wanted = dataset::open(folder.path(), &options()).unwrap();
    write_rigs(&model);
    let same = dataset::open(folder.path(), &options()).unwrap();
    assert_eq!(same.warnings, Vec::<String>::new());
    assert_eq!(
        same.views, wanted.views,
        "poses within rounding are those of images.bin"
    );
    // A translation that is off.
    let path = model.join("images.bin");
    let mut images = std::fs::read(&path).unwrap();
    images[44..52].copy_from_slice(&7.5f64.to_le_bytes());
    std::fs::write(&path, &images).unwrap();
    let mended = dataset::open(folder.path(), &options()).unwrap();
    assert!(
        mended.warnings[0].contains("1 of 3 poses differ"),
        "{:?}",
        mended.warnings
    );
    let out = tempfile::tempdir().unwrap();
    refined::write(folder.path(), out.path(), &refined::PoseMotions::new()).unwrap();
    let named = OpenOptions {
        images: Some(folder.path().join("images")),
        ..options()
    };
    let refined = dataset::open(out.path(), &named).unwrap();
    for data in [&mended, &refined] {
        for (a, b) in data.views.iter().zip(&wanted.views) {
            assert!(a.camera.rotation.abs_diff_eq(b.camera.rotation, 1e-9), "{}", a.name);
            assert!(a.camera.position.abs_diff_eq(b.camera.position, 1e-9), "{}", a.name);
        }
    }
    // Files that are cut short are not used, and a warning names them.
    for name in ["rigs.bin", "frames.bin"] {
        let contents = std::fs::read(model.join(name)).unwrap();
        for length in 0..contents.len() {
            std::fs::write(model.join(name), &contents[..length]).unwrap();
            let data = dataset::open(folder.path(), &options()).unwrap();
            assert!(data.warnings[0].contains(name), "{:?}", data.warnings);
        }
        std::fs::write(model.join(name), contents).unwrap();
    }
}
