//! Made scenes with their truth, and the scores of depths and normals against it.

use super::*;

/// The scores of a scene's depths and normals, and the text.
fn scores(scene: &Path, data: &Path, truth: &Path) -> (Value, String) {
    let arguments = ["eval", word(scene), word(data), "--depths", word(truth)];
    let text = stdout(&arguments);
    let json = stdout(&[&arguments[..], &["--json"]].concat());
    (serde_json::from_str(&json).unwrap(), text)
}

#[test]
fn depths_of_a_trained_plane_are_near_the_true_ones() {
    let folder = folder();
    let out = folder.path().join("plane");
    let size = [
        "--photos",
        "9",
        "--size",
        "64x48",
        "--iterations",
        "200",
        "--orbit",
        "1",
    ];
    stdout(&[&["demo", "--scene", "plane", "--truth", "--out", word(&out)], &size[..]].concat());
    let (data, truth) = (out.join("data"), out.join("data/truth"));
    let (found, text) = scores(&out.join("scene.ply"), &data, &truth);
    let median = &found["mean"]["median"];
    let number = |name: &str| median[name].as_f64().unwrap();
    println!("{text}");
    assert!(
        number("depth_median") < 0.02 && number("normal_median_deg") < 20.0,
        "{text}"
    );
    assert!(number("depth_median") > 0.0 && number("missing_share") < 0.01, "{text}");
    // Every eighth photograph is a test view.
    assert_eq!(found["views"].as_array().unwrap().len(), 2);
    assert!(text.starts_with("2 views; "), "{text}");
    // Without any file, and with one of another size.
    let empty = folder.path().join("empty");
    fs::create_dir(&empty).unwrap();
    let refused = |truth: &Path| {
        error(&[
            "eval",
            word(&out.join("scene.ply")),
            word(&data),
            "--depths",
            word(truth),
        ])
    };
    assert!(refused(&empty).contains("holds depths (NAME.exr) of no view"));
    let names = fs::read_dir(&truth).unwrap().map(|entry| entry.unwrap().file_name());
    let name = names
        .map(|name| name.into_string().unwrap())
        .find(|name| name.ends_with("exr"));
    let other = empty.join(name.unwrap());
    ashfall::io::exr::write(&other, 2, 1, &[[0.0; 4]; 2], &[1.0; 2], Some(&[[0.0; 3]; 2])).unwrap();
    assert!(refused(&empty).contains("is 2 x 1 pixels, its view 64 x 48"));
    ashfall::io::exr::write(&other, 64, 48, &[[0.0; 4]; 64 * 48], &[1.0; 64 * 48], None).unwrap();
    assert!(refused(&empty).contains("depths and normals: "), "{}", refused(&empty));
}

#[test]
fn a_mesh_becomes_a_made_scene() {
    let folder = folder();
    let (mesh, out) = (folder.path().join("ball.obj"), folder.path().join("out"));
    ashfall::io::mesh::write(&mesh, &synth::icosphere(2), Default::default()).unwrap();
    let options = [
        "--truth",
        "--data-only",
        "--photos",
        "3",
        "--size",
        "32x24",
        "--out",
        word(&out),
    ];
    stdout(&[&["demo", "--scene", word(&mesh)], &options[..]].concat());
    let truth = out.join("data/truth/mesh.ply");
    let (found, _) = ashfall::io::mesh::read(&truth).unwrap();
    assert_eq!(found.triangles.len(), 20 * 16);
    let compared = stdout(&[
        "eval",
        "--mesh",
        word(&truth),
        "--truth",
        word(&truth),
        "--points",
        "1000",
    ]);
    assert!(compared.contains("F1 1.0000"), "{compared}");
    fs::write(&mesh, "v 0 0 0\n").unwrap();
    let refused = error(&["demo", "--scene", word(&mesh), "--data-only", "--out", word(&out)]);
    assert!(refused.contains("ball.obj"), "{refused}");
    let unknown = run(&["demo", "--scene", "moon", "--data-only"]);
    assert_eq!(unknown.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&unknown.stderr).contains("plane, sphere"));
}
