//! Meshes: indices of every kind, errors by line, and points sampled uniformly by area.

use crate::io::{error_at, for_every_prefix, shared};
use ashfall::io::obj;
use ashfall::scene::Mesh;
use std::path::PathBuf;

fn write(text: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.obj");
    std::fs::write(&path, text).unwrap();
    (folder, path)
}

fn read(text: &str) -> ashfall::Result<Mesh> {
    obj::read(&write(text).1)
}

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

#[test]
fn faces_of_every_kind_are_read() {
    let (_folder, path) = write(&format!(
        "# a square, four times\nmtllib none.mtl\no thing\n{SQUARE}vt 0 0\nvn 0 0 1\nusemtl x\n\
         f 1 2 3 4\nf 1/1 2/1 3/1\r\nf 1//1 3/1/1 4//1\nf -4 -3 -2\nl 1 2\n"
    ));
    let mesh = obj::read(&path).unwrap();
    assert_eq!(mesh.positions.len(), 4);
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 2], [0, 2, 3], [0, 1, 2]]);
    assert!(mesh.colors.is_empty());
}

#[test]
fn faults_are_named_by_line() {
    for (line, words) in [
        ("f 1 2 5", "line 5: vertex 5 does not exist, there are 4"),
        ("f 0 1 2", "line 5: \"0\" names no vertex"),
        ("f 1 2 -5", "line 5: \"-5\" names no vertex"),
        ("f 1 2 9223372036854775807", "line 5:"),
        ("f 1 2 -9223372036854775808", "line 5:"),
        ("f 1 2 x", "line 5: \"x\""),
        ("f 1 2", "three corners"),
        ("f", "without corners"),
        ("v 1 2", "three coordinates"),
        ("v 1 2 inf", "no finite number"),
        ("v 1 2 0x1", "no finite number"),
        ("", "no faces"),
    ] {
        let (_folder, path) = write(&format!("{SQUARE}{line}\n"));
        let text = error_at(obj::read(&path), &path);
        assert!(text.contains(words), "{line}: {text}");
    }
}

#[test]
fn a_file_cut_anywhere_is_read_or_refused() {
    let (_folder, path) = write("");
    let text = format!("{SQUARE}f 1 2 3\nf -1/2/3 -2//3 -3\n");
    for_every_prefix(
        text.as_bytes(),
        &path,
        |path| obj::read(path),
        |_, result| {
            if let Ok(mesh) = result {
                let count = mesh.positions.len() as u32;
                assert!(mesh.triangles.iter().flatten().all(|v| *v < count));
            }
        },
    );
}

#[test]
fn colours_are_kept_only_if_all_have_one() {
    let mesh = read("v 0 0 0 1 0 0\nv 1 0 0 0 2 0\nv 0 1 0 0 0 0.5\nf 1 2 3\n").unwrap();
    assert_eq!(mesh.colors, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.5]]);
    assert_eq!(obj::vertices(&mesh)[2].color, [0.0, 0.0, 0.5]);
    let mesh = read("v 0 0 0 1 0 0\nv 1 0 0\nv 0 1 0 1\nf 1 2 3\n").unwrap();
    assert!(mesh.colors.is_empty());
    assert_eq!(obj::vertices(&mesh)[2].color, [0.5; 3]);
}

#[test]
fn points_are_spread_by_area() {
    // Areas 1 and 3, and a degenerate face that must get no point.
    let mesh = read(
        "v 0 0 0\nv 2 0 0\nv 0 1 0\nv 0 0 5\nv 6 0 5\nv 0 1 5\nv 9 9 9\n\
         f 1 2 3\nf 4 5 6\nf 7 7 7\n",
    )
    .unwrap();
    let points = obj::sample(&mesh, 20_000, 1);
    assert_eq!(points.len(), 20_000);
    assert_eq!(points, obj::sample(&mesh, 20_000, 1));
    assert_ne!(points, obj::sample(&mesh, 20_000, 2));
    let low = points.iter().filter(|p| p.position[2] == 0.0).count();
    let high = points.iter().filter(|p| (p.position[2] - 5.0).abs() < 1e-5).count();
    assert_eq!(low + high, 20_000);
    // Five standard deviations of a binomial with p = 1/4.
    assert!(low.abs_diff(5000) < 310, "{low}");
    // Uniform inside: the mean is the centroid, and all points lie within.
    let of_low = points.iter().filter(|p| p.position[2] == 0.0);
    let mean = of_low.clone().map(|p| p.position[0]).sum::<f64>() / low as f64;
    assert!((mean - 2.0 / 3.0).abs() < 0.05, "{mean}");
    assert!(
        of_low
            .clone()
            .all(|p| p.position[0] / 2.0 + p.position[1] <= 1.0 + 1e-6)
    );
    assert!(obj::sample(&Mesh::default(), 5, 1).is_empty());
}

#[test]
fn the_shared_mesh_is_as_described() {
    let Some(path) = shared("mesh/bunny.obj") else {
        return;
    };
    let mesh = obj::read(&path).unwrap();
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (2503, 4968));
    assert_eq!(obj::sample(&mesh, 100, 3).len(), 100);
}
