//! Files of triangle meshes.

use crate::io::files_in;
use ashfall::io::mesh::{read, write};
use ashfall::scene::Mesh;
use glam::DVec3;
use std::path::Path;

fn mesh() -> Mesh {
    Mesh {
        positions: vec![[0.1, -2.0, 3e-7], [1.0, 0.0, 0.0], [0.0, 1.5, 0.25], [-1.0, 2.0, 1e6]],
        colors: vec![[0.0, 0.2, 1.0], [0.4, 0.6, 0.8], [1.0; 3], [0.0; 3]],
        normals: vec![[0.0, 0.0, 1.0], [0.6, 0.8, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        triangles: vec![[0, 1, 2], [2, 1, 3]],
    }
}

#[test]
fn ply_meshes_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    for origin in [DVec3::ZERO, DVec3::new(4e6, -0.1, 1.0 / 3.0)] {
        write(&path, &mesh(), origin).unwrap();
        let (found, at) = read(&path).unwrap();
        assert_eq!(
            (found.positions, found.triangles, at),
            (mesh().positions, mesh().triangles, origin)
        );
        // Eight bits hold 255ths of these.
        assert_eq!(found.colors, mesh().colors);
    }
    let bytes = std::fs::read(&path).unwrap();
    let text = String::from_utf8_lossy(&bytes);
    for line in [
        "property float nx",
        "property uchar red",
        "property list uchar int vertex_indices",
    ] {
        assert!(text.contains(line), "{line}");
    }
    assert_eq!(files_in(folder.path()), ["a.ply"]);
}

#[test]
fn obj_meshes_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.obj");
    write(&path, &mesh(), DVec3::ZERO).unwrap();
    let (found, at) = read(&path).unwrap();
    assert_eq!(at, DVec3::ZERO);
    assert_eq!((found.positions, found.colors), (mesh().positions, mesh().colors));
    assert_eq!(found.triangles, mesh().triangles);
    write(&path, &mesh(), DVec3::new(1e9, 0.0, 0.0)).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.starts_with("v 1000000000.1 -2 "), "{text}");
    assert!(
        text.contains("vn 0.6 0.8 0") && text.ends_with("f 3//3 2//2 4//4\n"),
        "{text}"
    );
}

#[test]
fn glb_meshes_are_y_up_and_linear() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.glb");
    write(&path, &mesh(), DVec3::new(1.0, 2.0, 3.0)).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!((&bytes[..4], word(4), word(8)), (&b"glTF"[..], 2, bytes.len()));
    let json: serde_json::Value = serde_json::from_slice(&bytes[20..20 + word(12)]).unwrap();
    let buffer = &bytes[28 + word(12)..];
    assert_eq!(json["buffers"][0]["byteLength"], buffer.len());
    assert_eq!(json["nodes"][0]["translation"], serde_json::json!([-1.0, -2.0, 3.0]));
    let primitive = &json["meshes"][0]["primitives"][0];
    let part = |accessor: &serde_json::Value| {
        let view = &json["bufferViews"][json["accessors"][accessor.as_u64().unwrap() as usize]["bufferView"]
            .as_u64()
            .unwrap() as usize];
        let at = view["byteOffset"].as_u64().unwrap() as usize;
        &buffer[at..at + view["byteLength"].as_u64().unwrap() as usize]
    };
    let positions: Vec<u8> = mesh()
        .positions
        .as_flattened()
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    assert_eq!(part(&primitive["attributes"]["POSITION"]), positions);
    let indices: Vec<u8> = [0u32, 1, 2, 2, 1, 3].iter().flat_map(|x| x.to_le_bytes()).collect();
    assert_eq!(part(&primitive["indices"]), indices);
    let colors = part(&primitive["attributes"]["COLOR_0"]);
    let level = |i: usize| f64::from(u16::from_le_bytes([colors[2 * i], colors[2 * i + 1]])) / 65_535.0;
    // 0.2 and 0.6 on the sRGB curve.
    assert!((level(1) - 0.033_105).abs() < 2e-5 && (level(5) - 0.318_547).abs() < 2e-5);
    assert_eq!((level(0), level(2), level(3)), (0.0, 1.0, 1.0));
    // Half a turn about z: y down becomes y up.
    assert_eq!(json["nodes"][0]["rotation"], serde_json::json!([0.0, 0.0, 1.0, 0.0]));
    write(&path, &Mesh::default(), DVec3::ZERO).unwrap();
    assert!(std::fs::read(&path).unwrap().len() < 200);
}

#[test]
fn ply_meshes_of_other_programs_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n\
                element edge 1\nproperty int a\nelement face 2\nproperty uchar flags\n\
                property list uchar uint vertex_index\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n7\n0 4 0 1 2 3\n1 3 0 2 1\n";
    std::fs::write(&path, text).unwrap();
    let (mesh, _) = read(&path).unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [0, 2, 1]]);
    assert!(mesh.colors.is_empty() && mesh.positions[2] == [1.0, 1.0, 0.0]);
}

#[test]
fn faults_of_mesh_files_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    let told = |path: &Path| read(path).unwrap_err().to_string();
    let vertices = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
    let faces = "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n";
    for (text, what) in [
        (format!("{vertices}end_header\n0 0 0\n1 0 0\n0 1 0\n"), "it is no mesh"),
        (format!("{vertices}{faces}0 1 0\n3 0 1 3\n"), "names the vertex 3 of 3"),
        (
            format!("{vertices}{faces}0 1 0\n3 0 1 -1\n"),
            "names the vertex -1 of 3",
        ),
        (format!("{vertices}{faces}0 nan 0\n3 0 1 2\n"), "not finite"),
        (format!("{vertices}{faces}0 1 0\n2 0 1\n"), "holds no faces"),
        (format!("{vertices}{faces}0 1 0\n3 0 1\n"), "lacks a number"),
        (format!("{vertices}{faces}0 1 0\n300 0 1\n"), "has the length 300"),
        (format!("{vertices}{faces}0 1 0\n"), "0 bytes left"),
        (
            format!(
                "{vertices}{}0 1 0\n3 0 1 2\n",
                faces.replace("vertex_indices", "corners")
            ),
            "vertex_indices",
        ),
    ] {
        std::fs::write(&path, &text).unwrap();
        let found = told(&path);
        assert!(found.contains(what) && found.contains("a.ply"), "{found}");
    }
    // A binary file cut short.
    write(&path, &mesh(), DVec3::ZERO).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    for length in (0..bytes.len()).step_by(7) {
        std::fs::write(&path, &bytes[..length]).unwrap();
        assert!(told(&path).contains("a.ply"), "{length} bytes");
    }
    assert!(told(&folder.path().join("a.stl")).contains(".ply, .obj or .glb"));
    assert!(told(&folder.path().join("a.glb")).contains("are read from .ply and .obj"));
}
