//! Invalid tables of RealityCapture's and lists of Metashape's: each is refused in one line that names file and fault.

use crate::common::camera_lists::{COLUMNS, component, metashape, sensor};
use crate::common::files::{self, CENTER, HEIGHT, WIDTH};
use crate::io::error_at;
use crate::io::transforms::open;
use ashfall::scene::{Camera, Similarity};
use glam::{DMat3, DVec2, DVec3};
use std::path::Path;

/// A folder with photographs.
fn photos() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    files::write_photos(&folder.path().join("images"));
    folder
}

/// The refusal of a file by its name and by its folder.
fn refusal(folder: &Path, name: &str, contents: &[u8]) -> String {
    let file = folder.join(name);
    std::fs::write(&file, contents).unwrap();
    let text = error_at(open(&file), &file);
    assert_eq!(text.lines().count(), 1, "{text}");
    text
}

#[test]
fn tables_are_refused() {
    let folder = photos();
    let row = |name: &str, f: &str| format!("{name},1,2,3,10,80,-5,{f},0,0,0,0,0,0,0,0\n");
    let whole = |rows: &str| format!("{COLUMNS}\n{rows}");
    let cases = [
        (String::new(), &["#name"][..]),
        ("a table\n".into(), &["line 1", "#name"]),
        (row("c.png", "20"), &["line 1", "#name"]),
        (whole(""), &["no cameras"]),
        (
            whole("").replace("heading,", ""),
            &["line 1", "columns heading are missing"],
        ),
        (
            whole("").replace("x,y,alt", "x,y,z"),
            &["line 1", "columns alt are missing"],
        ),
        (whole("").replace("k2", "k1"), &["line 1", "column occurs twice"]),
        (whole("c.png,1,2,3\n"), &["line 2", "4 fields", "16 columns"]),
        (whole(&row("c,d.png", "20")), &["line 2", "17 fields"]),
        (whole(&row("c.png", "abc")), &["line 2", "\"c.png\"", "f is \"abc\""]),
        (whole(&row("c.png", "nan")), &["line 2", "not a finite number"]),
        (whole(&row("c.png", "1e999")), &["line 2", "not a finite number"]),
        (whole(&row("c.png", "")), &["line 2", "f is \"\""]),
        (whole(&row("c.png", "0")), &["line 2", "focal length", "not positive"]),
        (whole(&row("c.png", "-20")), &["line 2", "focal length"]),
        (
            whole(&row("c.png", "20")).replace(",1,2,3,", ",1e30,2,3,"),
            &["line 2", "camera at 1000"],
        ),
        (
            whole(&(row("c.png", "20") + &row("c", "21"))),
            &["line 3", "occurs twice"],
        ),
        (
            whole(&row("d.png", "20")),
            &["1 of 1 photographs are missing", "\"d.png\""],
        ),
        (whole(&row("../../etc/", "20")), &["line 2", "refused"]),
        (whole(&row("c\u{7}.png", "20")), &["line 2", "refused"]),
    ];
    for (text, words) in cases {
        let said = refusal(folder.path(), "cameras.csv", text.as_bytes());
        assert!(words.iter().all(|word| said.contains(word)), "{words:?} not in: {said}");
    }
    refusal(folder.path(), "cameras.csv", b"#name,\xff\n");
    std::fs::create_dir(folder.path().join("images/other")).unwrap();
    let [b, other] = ["images/sub/b.png", "images/other/b.png"].map(|name| folder.path().join(name));
    std::fs::copy(b, other).unwrap();
    let said = refusal(folder.path(), "cameras.csv", whole(&row("b", "20")).as_bytes());
    assert!(
        said.contains("line 2") && said.contains("several photographs"),
        "{said}"
    );
    std::fs::write(folder.path().join("images/c.png"), "no picture").unwrap();
    std::fs::write(folder.path().join("cameras.csv"), whole(&row("c.png", "20"))).unwrap();
    error_at(open(folder.path()), &folder.path().join("images/c.png"));
    std::fs::copy(folder.path().join("cameras.csv"), folder.path().join("more.CSV")).unwrap();
    let said = error_at(open(folder.path()), folder.path());
    assert!(said.contains("\"cameras.csv\" and \"more.CSV\""), "{said}");
}

/// A sound list.
fn sound() -> String {
    let camera = |i: usize| Camera {
        width: WIDTH,
        height: HEIGHT,
        focal: DVec2::splat(9.0),
        center: DVec2::from(CENTER),
        rotation: DMat3::IDENTITY,
        position: DVec3::new(i as f64, 2.0, 3.0),
    };
    let cameras = ["c", "a b c"]
        .into_iter()
        .enumerate()
        .map(|(i, label)| (label, camera(i)));
    let parts = [
        sensor(0, "frame", [WIDTH, HEIGHT], "<f>9</f><k1>0.1</k1>"),
        component(&Similarity::IDENTITY),
    ];
    metashape(cameras, &Similarity::IDENTITY, [&parts[0], &parts[1]])
}

#[test]
fn lists_are_refused() {
    let folder = photos();
    std::fs::write(folder.path().join("cameras.xml"), sound()).unwrap();
    open(folder.path()).unwrap();
    let (deep, pose) = ("<a>".repeat(100_000), "1 0 0 0 0 1 0 2 0 0 1 3 0 0 0 1");
    for (old, new, words) in [
        ("</document>", "", &["cannot be parsed as XML"][..]),
        ("<cameras>", "<cameras", &["cannot be parsed as XML"]),
        (
            "<document",
            "<!DOCTYPE a [<!ENTITY b \"c\">]><document",
            &["XML", "DTD"],
        ),
        ("<cameras>", &deep, &["nested more than 64 deep"]),
        ("<document version=\"2.0.0\">", "<document/><!--", &["cannot be parsed"]),
        ("document", "calibration", &["its root is \"calibration\""]),
        ("chunk", "project", &["no <chunk>"]),
        ("<chunk label", "<chunk/><chunk label", &["2 chunks"]),
        ("sensors>", "lenses>", &["no <sensors>"]),
        (
            pose,
            "1 0 0 0 0 1 0 2 0 0 1 3 0 0 0",
            &["camera \"c\"", "15 numbers in place of 16"],
        ),
        (pose, "1 0 0 0 0 1 0 2 0 0 1 3 0 0 1 1", &["camera \"c\"", "last row"]),
        (
            pose,
            "1 0 0 0 0 1 0 2 0 0 -1 3 0 0 0 1",
            &["camera \"c\"", "reflection"],
        ),
        (pose, "1 0 0 0 0 0 0 2 0 0 0 3 0 0 0 1", &["camera \"c\"", "singular"]),
        (
            pose,
            "1 0 0 nan 0 1 0 2 0 0 1 3 0 0 0 1",
            &["camera \"c\"", "\"nan\", not a finite number"],
        ),
        (
            pose,
            "1 0 0 x 0 1 0 2 0 0 1 3 0 0 0 1",
            &["camera \"c\"", "\"x\", not a finite number"],
        ),
        (
            pose,
            "1 0 0 1e20 0 1 0 2 0 0 1 3 0 0 0 1",
            &["camera \"c\"", "camera at 1000"],
        ),
        (
            "<scale>1<",
            "<scale>0<",
            &["component \"0\"", "scale 0 is not positive"],
        ),
        ("<scale>1<", "<scale>inf<", &["component \"0\"", "not a finite number"]),
        (
            "<rotation>1 ",
            "<rotation>",
            &["component \"0\"", "8 numbers in place of 9"],
        ),
        ("<rotation>1 ", "<rotation>-1 ", &["component \"0\"", "reflection"]),
        (
            "sensor_id=\"0\"",
            "sensor_id=\"3\"",
            &["camera \"c\"", "sensor \"3\"", "not among the 1"],
        ),
        ("sensor_id=\"0\"", "", &["camera \"c\"", "no sensor_id"]),
        (
            "component_id=\"0\"",
            "component_id=\"5\"",
            &["camera \"c\"", "component \"5\""],
        ),
        (
            "type=\"frame\"",
            "type=\"cylindrical\"",
            &["sensor \"0\"", "\"cylindrical\" is not supported"],
        ),
        (
            "type=\"frame\"",
            "type=\"rpc\"",
            &["sensor \"0\"", "\"rpc\" is not supported"],
        ),
        ("calibration", "covariance", &["sensor \"0\"", "no <calibration>"]),
        ("resolution", "size", &["sensor \"0\"", "no <resolution>"]),
        ("width=\"12\"", "width=\"0\"", &["sensor \"0\"", "0 x 8"]),
        (
            "width=\"12\"",
            "width=\"12.5\"",
            &["sensor \"0\"", "not a whole number"],
        ),
        ("<f>9</f>", "", &["sensor \"0\"", "no <f>"]),
        ("<f>9</f>", "<f>-9</f>", &["sensor \"0\"", "focal length"]),
        ("<f>9</f>", "<f>0</f><b2>1</b2>", &["sensor \"0\"", "focal length"]),
        (
            "<k1>0.1</k1>",
            "<k1>nan</k1>",
            &["sensor \"0\"", "<k1>", "not a finite number"],
        ),
        (
            "<k1>0.1</k1>",
            "<p3>0.1</p3>",
            &["sensor \"0\"", "p3 = 0.1 is not supported"],
        ),
        (
            "<sensors>",
            "<sensors><sensor id=\"0\"/>",
            &["sensor \"0\" occurs twice"],
        ),
        (
            "label=\"c\"",
            "label=\"a b c.png\"",
            &["camera \"a b c\"", "occurs twice"],
        ),
        ("label=\"c\"", "label=\"\"", &["camera \"\"", "refused"]),
        ("label=\"c\"", "label=\"&#7;\"", &["cannot be parsed as XML"]),
        ("<transform>1", "<pose>1", &["cannot be parsed as XML"]),
    ] {
        let text = sound().replace(old, new);
        assert_ne!(text, sound(), "{old} is not in the list");
        let said = refusal(folder.path(), "cameras.xml", text.as_bytes());
        assert!(words.iter().all(|word| said.contains(word)), "{words:?} not in: {said}");
        assert!(!said.chars().any(char::is_control) && said.len() < 400, "{said}");
    }
    let without = sound().replace(" label=", " enabled=\"false\" label=");
    assert!(refusal(folder.path(), "cameras.xml", without.as_bytes()).contains("no camera with a pose"));
    refusal(folder.path(), "cameras.xml", &[sound().as_bytes(), b"\xff"].concat());
    // Photographs that are all missing.
    std::fs::remove_dir_all(folder.path().join("images")).unwrap();
    std::fs::write(folder.path().join("cameras.xml"), sound()).unwrap();
    let said = error_at(open(folder.path()), folder.path());
    assert!(said.contains("2 of 2 photographs are missing"), "{said}");
    std::fs::remove_file(folder.path().join("cameras.xml")).unwrap();
    let said = error_at(open(folder.path()), folder.path());
    assert!(
        said.contains(".csv of RealityCapture") && said.contains(".xml of Metashape"),
        "{said}"
    );
}
