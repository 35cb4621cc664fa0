//! Files of triangle meshes: `.ply`, `.obj` and `.glb`.

mod glb;
mod ply;

use super::atomic::write_atomically;
use super::obj;
use crate::error::{Error, Result};
use crate::scene::Mesh;
use glam::DVec3;
use std::io::Write;
use std::path::Path;

/// Format of a mesh file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// Binary PLY with normals and colours of 8 bits. A comment holds the origin, as in `scene.ply`.
    Ply,
    /// Wavefront OBJ with colours after the positions, origin included.
    Obj,
    /// glTF: y up, linear colours of 16 bits, unlit, both sides. A node holds the origin.
    Glb,
}

impl MeshFormat {
    /// Format of a file by its name's end.
    ///
    /// # Errors
    /// [`Error::File`] for others.
    pub fn of(path: &Path) -> Result<MeshFormat> {
        let end = path.extension().map(|end| end.to_string_lossy().to_lowercase());
        match end.as_deref() {
            Some("ply") => Ok(MeshFormat::Ply),
            Some("obj") => Ok(MeshFormat::Obj),
            Some("glb") => Ok(MeshFormat::Glb),
            _ => Err(Error::file(path, "is no mesh file by its name: .ply, .obj or .glb")),
        }
    }
}

/// Writes a mesh in the format of the file's name; atomic. Positions are relative to `origin`.
///
/// # Errors
/// A name of another format; more than 4 GiB as GLB; those of the file system.
pub fn write(path: &Path, mesh: &Mesh, origin: DVec3) -> Result<()> {
    let vertices = mesh.positions.len();
    for values in [&mesh.normals, &mesh.colors] {
        assert!(values.is_empty() || values.len() == vertices, "one per vertex, or none");
    }
    match MeshFormat::of(path)? {
        MeshFormat::Ply => ply::write(path, mesh, origin),
        MeshFormat::Obj => write_obj(path, mesh, origin),
        MeshFormat::Glb => glb::write(path, mesh, origin),
    }
}

/// Reads a mesh from a `.ply` or `.obj` file, and its origin.
///
/// # Errors
/// Names the file and its fault; `.glb` files are only written.
pub fn read(path: &Path) -> Result<(Mesh, DVec3)> {
    match MeshFormat::of(path)? {
        MeshFormat::Ply => super::ply::read_mesh(path),
        MeshFormat::Obj => Ok((obj::read(path)?, DVec3::ZERO)),
        MeshFormat::Glb => Err(Error::file(path, "meshes are read from .ply and .obj files")),
    }
}

/// Shortest decimals that give the same floats; with an origin, doubles.
fn write_obj(path: &Path, mesh: &Mesh, origin: DVec3) -> Result<()> {
    write_atomically(path, |file| {
        for (i, position) in mesh.positions.iter().enumerate() {
            match origin == DVec3::ZERO {
                true => write!(file, "v {} {} {}", position[0], position[1], position[2])?,
                false => {
                    let [x, y, z] = (origin + DVec3::from(position.map(f64::from))).to_array();
                    write!(file, "v {x} {y} {z}")?;
                }
            }
            match mesh.colors.get(i) {
                Some([r, g, b]) => writeln!(file, " {r} {g} {b}")?,
                None => writeln!(file)?,
            }
        }
        for [x, y, z] in &mesh.normals {
            writeln!(file, "vn {x} {y} {z}")?;
        }
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(|vertex| vertex + 1);
            match mesh.normals.is_empty() {
                true => writeln!(file, "f {a} {b} {c}")?,
                false => writeln!(file, "f {a}//{a} {b}//{b} {c}//{c}")?,
            }
        }
        Ok(())
    })
}
