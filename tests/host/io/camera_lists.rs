//! RealityCapture's table and Metashape's list: poses, intrinsics and pixels are those of the same scene in COLMAP's
//! form.

use crate::common::camera_lists::{COLUMNS, cloud, component, metashape, sensor, table, transform};
use crate::common::files::{self, HEIGHT, WIDTH};
use crate::io::transforms::open;
use ashfall::io::refined::{self, PoseMotions};
use ashfall::io::{metashape as list, photo, realitycapture};
use ashfall::scene::{Camera, Dataset, Lens, PhotoSource, Similarity};
use glam::{DMat3, DQuat, DVec2, DVec3};
use std::fmt::Write as _;
use std::path::Path;

/// Largest difference of poses and intrinsics from COLMAP's form.
const TOLERANCE: f64 = 1e-6;

const NAMES: [&str; 3] = ["a b c.png", "c.png", "sub/b.png"];

/// Heading, pitch and roll in degrees, and position.
const POSES: [([f64; 3], [f64; 3]); 3] = [
    (
        [170.3483067926429, 85.18637269312288, -22.74995074830745],
        [44.5, -138.25, 6.8219],
    ),
    ([-35.5, 61.25, 12.0], [-3.0, 2.5, 1e-3]),
    ([90.0, 90.0, 0.0], [0.125, 1000.5, -7.75]),
];

/// Chunk to world, of no simple rotation.
fn world() -> Similarity {
    Similarity {
        rotation: DMat3::from_quat(DQuat::from_xyzw(0.3, -0.5, 0.1, 0.8).normalize()),
        scale: 12.354192447331316,
        translation: DVec3::new(-24.5, 42.75, 4.03),
    }
}

/// `view_from_world` of the angles: turns of the z, x and y axes, and half a turn about x to the axes of COLMAP.
fn view_from_world(angles: [f64; 3]) -> DQuat {
    let [heading, pitch, roll] = angles.map(|angle| 0.5 * angle.to_radians());
    let about = |axis: DVec3, half: f64| {
        DQuat::from_xyzw(
            axis.x * half.sin(),
            axis.y * half.sin(),
            axis.z * half.sin(),
            half.cos(),
        )
    };
    let opengl = about(DVec3::Z, -heading) * about(DVec3::X, pitch) * about(DVec3::Y, roll);
    (opengl * DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0)).conjugate()
}

/// A data set in COLMAP's form with photographs, all of one camera: a line of cameras.txt without its id.
fn colmap(line: &str) -> (tempfile::TempDir, Dataset) {
    let folder = tempfile::tempdir().unwrap();
    files::write_photos(&folder.path().join("images"));
    let model = folder.path().join("sparse/0");
    std::fs::create_dir_all(&model).unwrap();
    std::fs::write(model.join("cameras.txt"), format!("1 {line}\n")).unwrap();
    let mut images = String::new();
    for (name, (angles, position)) in NAMES.iter().zip(POSES) {
        let q = view_from_world(angles);
        let t = -(q * DVec3::from(position));
        writeln!(
            images,
            "1 {} {} {} {} {} {} {} 1 {name}\n",
            q.w, q.x, q.y, q.z, t.x, t.y, t.z
        )
        .unwrap();
    }
    std::fs::write(model.join("images.txt"), images).unwrap();
    let data = open(folder.path()).unwrap();
    (folder, data)
}

/// The same folder with a list of cameras in place of the model.
fn with_list(folder: &Path, name: &str, text: &str) -> Dataset {
    let _ = std::fs::remove_dir_all(folder.join("sparse"));
    std::fs::write(folder.join(name), text).unwrap();
    let data = open(folder).unwrap();
    std::fs::remove_file(folder.join(name)).unwrap();
    data
}

/// Rows of the table with the angles as they are.
fn rows(f: f64, tail: &str) -> String {
    let mut text = format!("#cameras 3\r\n{COLUMNS}\r\n");
    let labels = ["a b c", r"C:\shots\c.png", "sub/b.png"];
    for (label, ([heading, pitch, roll], [x, y, alt])) in labels.iter().zip(POSES) {
        write!(text, "{label},{x},{y},{alt},{heading},{pitch},{roll},{f},{tail}\r\n").unwrap();
    }
    text
}

#[track_caller]
fn assert_same(found: &Dataset, wanted: &Dataset) {
    assert_eq!(found.views.len(), wanted.views.len());
    for (a, b) in found.views.iter().zip(&wanted.views) {
        assert_eq!(a.name, b.name);
        let (x, y) = (a.camera, b.camera);
        assert_eq!((x.width, x.height), (y.width, y.height));
        assert!(
            x.rotation.abs_diff_eq(y.rotation, TOLERANCE),
            "{}: {} {}",
            a.name,
            x.rotation,
            y.rotation
        );
        assert!(
            x.position.abs_diff_eq(y.position, TOLERANCE),
            "{}: {} {}",
            a.name,
            x.position,
            y.position
        );
        assert!(x.focal.abs_diff_eq(y.focal, TOLERANCE) && x.center.abs_diff_eq(y.center, TOLERANCE));
        let (a, b) = (photo::load(a).unwrap(), photo::load(b).unwrap());
        let off = a
            .rgba
            .iter()
            .flatten()
            .zip(b.rgba.iter().flatten())
            .map(|(a, b)| a.abs_diff(*b));
        assert!(off.max().is_some_and(|off| off <= 1), "pixels differ");
    }
}

fn lens(data: &Dataset) -> Option<Lens> {
    match &data.views[0].photo {
        PhotoSource::File { optics, .. } => optics.as_ref().map(|optics| optics.lens),
        other => panic!("{other:?}"),
    }
}

#[test]
fn angles_are_those_of_a_compass() {
    let folder = tempfile::tempdir().unwrap();
    files::write_photos(&folder.path().join("images"));
    let row = "c.png,1,2,3,90,90,0,20\na b c.png,1,2,3,0,60,0,20\nsub/b.png,1,2,3,0,0,0,20\n";
    let data = with_list(
        folder.path(),
        "x.csv",
        &format!("#name,x,y,alt,heading,pitch,roll,f\n{row}"),
    );
    let forward = |view: usize| data.views[view].camera.rotation.row(2);
    assert!(forward(1).abs_diff_eq(DVec3::X, 1e-12), "a level camera looks east");
    let down = DVec3::new(0.0, 60_f64.to_radians().sin(), -0.5);
    assert!(
        forward(0).abs_diff_eq(down, 1e-12),
        "north, 30 degrees down: {}",
        forward(0)
    );
    assert!(forward(2).abs_diff_eq(DVec3::NEG_Z, 1e-12), "down");
    assert!(
        data.views
            .iter()
            .all(|view| view.camera.focal == DVec2::splat(20.0 * 12.0 / 36.0))
    );
    assert_eq!(lens(&data), None);
}

#[test]
fn the_table_has_the_cameras_of_colmap() {
    // Focal length 0.6 and principal point (0.02, -0.03) in longer sides; t1 is p2, and t2 is p1.
    let (folder, wanted) = colmap("FULL_OPENCV 12 8 7.2 7.2 6.24 3.64 0.1 -0.02 0.004 -0.003 0.005 0 0 0");
    let tail = "2e-002,-3.0e-2,0.1,-0.02,0.005,0,-0.003,0.004";
    let found = with_list(folder.path(), "x.csv", &rows(21.6, tail));
    assert_same(&found, &wanted);
    assert_eq!(lens(&found), lens(&wanted));
    let brown = with_list(folder.path(), "x.csv", &rows(21.6, "0,0,0.1,-0.02,0,0,-0.003,0.004"));
    assert!(matches!(lens(&brown), Some(Lens::Brown(_))));
    let wide = with_list(folder.path(), "x.csv", &rows(21.6, "0,0,0.1,-0.02,0.005,0.001,0,0"));
    let radial = [0.1, -0.02, 0.005, 0.001];
    assert!(matches!(lens(&wide), Some(Lens::Polynomial { radial: found, .. }) if found == radial));
    // The same rows by the geometry of the axes.
    let cameras = NAMES.iter().zip(&wanted.views).map(|(name, view)| (*name, view.camera));
    let again = with_list(
        folder.path(),
        "x.csv",
        &table(cameras, [0.1, -0.02, 0.005, 0.0, -0.003, 0.004]),
    );
    assert_same(&again, &wanted);
}

/// Cameras of COLMAP's data set with labels as of Metashape. The front of a panorama has its pose.
fn labelled(wanted: &Dataset) -> Vec<(&'static str, Camera)> {
    let labels = ["a b c", "/srv/x/shots/c.png", r"D:\sub\b"];
    let is_whole = |name: &str| name.split_once('#').is_none_or(|(_, side)| side == "front");
    let views = wanted.views.iter().filter(|view| is_whole(&view.name));
    labels.into_iter().zip(views.map(|view| view.camera)).collect()
}

#[test]
fn the_list_has_the_cameras_of_colmap() {
    let (folder, wanted) = colmap("FULL_OPENCV 12 8 7.5 7.2 6.25 3.5 0.1 -0.02 0.004 -0.003 0.005 0 0 0");
    let calibration = "<f>7.2</f><cx>0.25</cx><cy>-0.5</cy><b1>0.3</b1><k1>0.1</k1><k2>-0.02</k2><k3>0.005</k3>\
        <p1>-0.003</p1><p2>0.004</p2>";
    let sensor = sensor(0, "frame", [WIDTH, HEIGHT], calibration);
    let (own, plain) = (component(&world()), component(&Similarity::IDENTITY));
    let (above, none) = (transform(&world()), "<components><component id=\"0\"/></components>");
    for (name, place, transforms) in [
        ("of the component", world(), own.clone()),
        (
            "of the component, not of the chunk",
            world(),
            own + &transform(&Similarity::IDENTITY),
        ),
        ("of the chunk", world(), above + none),
        ("none", Similarity::IDENTITY, plain),
    ] {
        println!("{name}");
        let text = metashape(labelled(&wanted), &place, [&sensor, &transforms]);
        let found = with_list(folder.path(), "x.xml", &text);
        assert_same(&found, &wanted);
        assert_eq!(lens(&found), lens(&wanted));
        let warned = found.warnings.iter().filter(|warning| !warning.contains("no points"));
        assert_eq!(warned.count(), 0, "{:?}", found.warnings);
    }
}

#[test]
fn fisheye_and_spherical_sensors_are_those_of_colmap() {
    let open = |line: &str, kind: &str, calibration: &str| {
        let (folder, wanted) = colmap(line);
        let sensor = sensor(0, kind, [WIDTH, HEIGHT], calibration);
        let text = metashape(labelled(&wanted), &world(), [&sensor, &component(&world())]);
        (with_list(folder.path(), "x.xml", &text), wanted, folder)
    };
    let fisheye = "<f>9.5</f><cx>0.25</cx><cy>-0.5</cy><k1>0.1</k1><k2>-0.02</k2><k3>0.003</k3><k4>0.001</k4>";
    let (found, wanted, _folder) = open(
        "OPENCV_FISHEYE 12 8 9.5 9.5 6.25 3.5 0.1 -0.02 0.003 0.001",
        "fisheye",
        fisheye,
    );
    assert_same(&found, &wanted);
    assert_eq!(lens(&found), lens(&wanted));
    let prism = fisheye.to_owned() + "<p1>0.002</p1><p2>-0.004</p2>";
    let line = "THIN_PRISM_FISHEYE 12 8 9.5 9.5 6.25 3.5 0.1 -0.02 -0.004 0.002 0.003 0.001 0 0";
    let (found, wanted, _folder) = open(line, "fisheye", &prism);
    assert_eq!(lens(&found), lens(&wanted));
    // Sides of the panorama are compared.
    let (found, wanted, _folder) = open("EQUIRECTANGULAR 12 8 12 8", "spherical", "");
    assert!(found.views.len() > 3, "{}", found.views.len());
    assert_same(&found, &wanted);
}

#[test]
fn four_radial_coefficients_and_a_skew_are_carried() {
    let direction = DVec3::new(0.3, -0.4, 1.0);
    let (x, y, r2) = (0.3, -0.4, 0.25_f64);
    let radial = 1.0 + 0.1 * r2 - 0.02 * r2.powi(2) + 0.005 * r2.powi(3) + 0.03 * r2.powi(4);
    let place = DVec2::new(
        x * radial - 0.003 * (r2 + 2.0 * x * x) + 2.0 * 0.004 * x * y,
        y * radial + 0.004 * (r2 + 2.0 * y * y) - 2.0 * 0.003 * x * y,
    );
    let calibration = "<f>7.2</f><cx>0.25</cx><cy>-0.5</cy><b1>0.3</b1><b2>-0.6</b2><k1>0.1</k1><k2>-0.02</k2>\
        <k3>0.005</k3><k4>0.03</k4><p1>-0.003</p1><p2>0.004</p2>";
    let (folder, wanted) = colmap("PINHOLE 12 8 7.5 7.2 6.25 3.5");
    let sensor = sensor(0, "frame", [WIDTH, HEIGHT], calibration);
    let text = metashape(labelled(&wanted), &world(), [&sensor, &component(&world())]);
    let found = with_list(folder.path(), "x.xml", &text);
    let lens = lens(&found).unwrap();
    let pixel = lens.project(direction).unwrap() * found.views[0].camera.focal + found.views[0].camera.center;
    let f = 7.2;
    let wanted = DVec2::new(6.25 + (f + 0.3) * place.x - 0.6 * place.y, 3.5 + f * place.y);
    assert!(pixel.abs_diff_eq(wanted, 1e-9), "{pixel} {wanted}");
    let Lens::Polynomial {
        radial,
        tangential,
        shear,
        ..
    } = lens
    else {
        panic!("{lens:?}")
    };
    let wide = Lens::Polynomial {
        is_angular: true,
        radial,
        tangential,
        shear,
    };
    // An angle in place of its tangent.
    let same = wide
        .project((direction.truncate().normalize() * 0.5_f64.sin()).extend(0.5_f64.cos()))
        .unwrap();
    let plain = lens
        .project((direction.truncate().normalize() * 0.5).extend(1.0))
        .unwrap();
    assert!(same.abs_diff_eq(plain, 1e-12), "{same} {plain}");
}

#[test]
fn cameras_that_are_off_or_without_a_pose_are_left_out() {
    let (folder, wanted) = colmap("PINHOLE 12 8 7.2 7.2 6 4");
    let sensor = sensor(0, "frame", [WIDTH, HEIGHT], "<f>7.2</f>");
    let text = metashape(labelled(&wanted), &world(), [&sensor, &component(&world())]);
    let off = text.replacen("<camera id=\"0\"", "<camera enabled=\"false\" id=\"0\"", 1);
    let found = with_list(folder.path(), "x.xml", &off);
    assert_eq!(found.views.len(), 2);
    assert!(!found.warnings.concat().contains("pose"), "{:?}", found.warnings);
    let more = "<group id=\"0\"><camera id=\"7\" sensor_id=\"0\" label=\"d.png\"/></group></cameras>";
    let found = with_list(folder.path(), "x.xml", &text.replace("</cameras>", more));
    assert_same(&found, &wanted);
    let warning = found
        .warnings
        .iter()
        .find(|warning| warning.contains("have no pose"))
        .unwrap();
    assert!(
        warning.contains("1 of 4 cameras") && warning.contains("\"d.png\""),
        "{warning}"
    );
    let grouped = text
        .replace("<cameras>", "<cameras><group id=\"1\"><group id=\"2\">")
        .replace("</cameras>", "</group></group></cameras>");
    assert_same(&with_list(folder.path(), "x.xml", &grouped), &wanted);
    // A photograph that is gone leaves its view out, and points lie beside the list.
    std::fs::remove_file(folder.path().join("images/c.png")).unwrap();
    let points: Vec<_> = files::points().into_iter().map(|(_, point)| point).collect();
    std::fs::write(folder.path().join("x.ply"), cloud(&points)).unwrap();
    for (name, text) in [("x.xml", text), ("x.csv", rows(20.0, "0,0,0,0,0,0,0,0"))] {
        let found = with_list(folder.path(), name, &text);
        assert!(
            found.warnings.concat().contains("1 of 3 photographs are missing"),
            "{:?}",
            found.warnings
        );
        assert_eq!((found.views.len(), found.points.len()), (2, points.len()));
    }
}

#[test]
fn photographs_and_masks_may_lie_beside_the_table() {
    let folder = tempfile::tempdir().unwrap();
    files::write_photos(folder.path());
    let text = "#name,x,y,alt,heading,pitch,roll,f\nc,1,2,3,0,90,0,20\na b c.png,1,2,3,0,60,0,20\n";
    std::fs::write(folder.path().join("cameras.csv"), text).unwrap();
    std::fs::create_dir(folder.path().join("masks")).unwrap();
    image::GrayImage::new(WIDTH, HEIGHT)
        .save(folder.path().join("masks/c.png"))
        .unwrap();
    let (whole, file) = (
        open(folder.path()).unwrap(),
        open(&folder.path().join("cameras.csv")).unwrap(),
    );
    assert_eq!((whole.views.len(), &whole.views), (2, &file.views));
    assert!(matches!(&whole.views[1].photo, PhotoSource::File { mask: Some(_), .. }));
    assert_eq!(
        realitycapture::find(folder.path()).unwrap(),
        Some(folder.path().join("cameras.csv"))
    );
    assert_eq!(list::find(folder.path()).unwrap(), None);
}

#[test]
fn refined_poses_are_written_in_the_form_they_came_in() {
    let (folder, wanted) = colmap("PINHOLE 12 8 7.2 7.2 6 4");
    let motion = (
        DQuat::from_xyzw(0.1, -0.2, 0.05, 0.9).normalize(),
        DVec3::new(0.5, -0.25, 2.0),
    );
    let motions: PoseMotions = NAMES[..2].iter().map(|name| ((*name).to_owned(), motion)).collect();
    let sensor = sensor(0, "frame", [WIDTH, HEIGHT], "<f>7.2</f>");
    let text = metashape(labelled(&wanted), &world(), [&sensor, &component(&world())]);
    std::fs::remove_dir_all(folder.path().join("sparse")).unwrap();
    for (name, text) in [("x.xml", text), ("x.csv", rows(21.6, "0,0,0,0,0,0,0,0"))] {
        let (file, out) = (folder.path().join(name), tempfile::tempdir().unwrap());
        std::fs::write(&file, &text).unwrap();
        refined::write(folder.path(), out.path(), &motions).unwrap();
        std::fs::copy(out.path().join(name), &file).unwrap();
        let found = open(folder.path()).unwrap();
        for (view, given) in found.views.iter().zip(&wanted.views) {
            let moved = motions.contains_key(&view.name);
            let (turn, shift) = if moved { motion } else { (DQuat::IDENTITY, DVec3::ZERO) };
            let rotation = given.camera.rotation * DMat3::from_quat(turn);
            assert!(view.camera.rotation.abs_diff_eq(rotation, 1e-9), "{name} {}", view.name);
            let position = given.camera.position + shift;
            assert!(view.camera.position.abs_diff_eq(position, 1e-9), "{name} {}", view.name);
        }
        let changed = |text: &str| text.lines().map(str::to_owned).collect::<Vec<_>>();
        let (old, new) = (changed(&text), changed(&std::fs::read_to_string(&file).unwrap()));
        assert_eq!(old.len(), new.len());
        assert_eq!(
            old.iter().zip(&new).filter(|(old, new)| old != new).count(),
            2,
            "{name}"
        );
        std::fs::remove_file(&file).unwrap();
    }
}
