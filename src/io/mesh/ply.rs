//! Writing a mesh as binary PLY.

use super::super::atomic::write_atomically;
use crate::error::Result;
use crate::io::png::to_byte;
use crate::scene::Mesh;
use glam::DVec3;
use std::io::Write;
use std::path::Path;

pub(super) fn write(path: &Path, mesh: &Mesh, origin: DVec3) -> Result<()> {
    write_atomically(path, |file| {
        file.write_all(header(mesh, origin).as_bytes())?;
        let mut row = Vec::with_capacity(27);
        for (i, position) in mesh.positions.iter().enumerate() {
            row.clear();
            let floats = position.iter().chain(mesh.normals.get(i).into_iter().flatten());
            floats.for_each(|value| row.extend(value.to_le_bytes()));
            row.extend(mesh.colors.get(i).into_iter().flatten().map(|&c| to_byte(c)));
            file.write_all(&row)?;
        }
        for triangle in &mesh.triangles {
            row.clear();
            row.push(3);
            triangle.iter().for_each(|vertex| row.extend(vertex.to_le_bytes()));
            file.write_all(&row)?;
        }
        Ok(())
    })
}

fn header(mesh: &Mesh, origin: DVec3) -> String {
    let mut text = "ply\nformat binary_little_endian 1.0\n".to_string();
    if origin != DVec3::ZERO {
        text += &format!("comment SplatOrigin: {} {} {}\n", origin.x, origin.y, origin.z);
    }
    text += &format!("element vertex {}\n", mesh.positions.len());
    let mut properties = |kind: &str, names: [&str; 3]| {
        names
            .iter()
            .for_each(|name| text += &format!("property {kind} {name}\n"));
    };
    properties("float", ["x", "y", "z"]);
    if !mesh.normals.is_empty() {
        properties("float", ["nx", "ny", "nz"]);
    }
    if !mesh.colors.is_empty() {
        properties("uchar", ["red", "green", "blue"]);
    }
    let faces = mesh.triangles.len();
    text + &format!("element face {faces}\nproperty list uchar int vertex_indices\nend_header\n")
}
