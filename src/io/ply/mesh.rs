//! Reading triangle meshes.

use super::super::reader::{Reader, excerpt};
use super::super::source::Source;
use super::comments::origin;
use super::header::{PlyElement, PlyHeader};
use super::read::colored_vertex_columns;
use super::rows;
use crate::error::{Error, Result};
use crate::scene::Mesh;
use glam::DVec3;

/// Most corners of a polygon.
const CORNERS_MAX: usize = 256;

/// Reads a mesh and the origin in its comments: positions of `vertex`, `red green blue` if present (0 to 255 as
/// integers, 0 to 1 as floats), and the polygons of `face` as fans of triangles.
///
/// # Errors
/// Names the file and the place: not a PLY file, no vertices or faces, counts beyond the file, a position that is not
/// finite, an index without a vertex.
pub fn read_mesh<'a>(source: impl Into<Source<'a>>) -> Result<(Mesh, DVec3)> {
    let source = source.into();
    let path = source.name();
    let mut reader = Reader::open(source)?;
    let header = PlyHeader::read(&mut reader)?;
    let (Some((vertex_index, vertex)), Some((face_index, face))) = (header.element("vertex"), header.element("face"))
    else {
        return Err(Error::file(
            path,
            "has no elements \"vertex\" and \"face\": it is no mesh",
        ));
    };
    if face_index < vertex_index {
        return Err(Error::file(path, "the faces stand before the vertices"));
    }
    let origin = origin(path, &header.comments)?;
    let mut mesh = Mesh::default();
    rows::skip_to(&mut reader, &header, vertex_index)?;
    read_vertices(&mut reader, &header, vertex, &mut mesh)?;
    for element in &header.elements[vertex_index + 1..face_index] {
        rows::skip(&mut reader, header.encoding, element)?;
    }
    let list = face.find("vertex_indices").or_else(|| face.find("vertex_index"));
    let Some(list) = list.filter(|&list| face.properties[list].list.is_some()) else {
        return Err(Error::file(path, "the faces have no list \"vertex_indices\""));
    };
    rows::check_count(&reader, header.encoding, face)?;
    let count = mesh.positions.len();
    rows::read_lists(
        &mut reader,
        header.encoding,
        face,
        list,
        CORNERS_MAX,
        |reader, corners| {
            let known = |&corner: &f64| corner >= 0.0 && corner < count as f64;
            if let Some(corner) = corners.iter().find(|corner| !known(corner)) {
                return Err(reader.fault(format!("a face names the vertex {corner} of {count}")));
            }
            for pair in corners.windows(2).skip(1) {
                mesh.triangles.push([corners[0] as u32, pair[0] as u32, pair[1] as u32]);
            }
            Ok(())
        },
    )?;
    if mesh.triangles.is_empty() {
        return Err(Error::file(path, "holds no faces"));
    }
    Ok((mesh, origin))
}

fn read_vertices(reader: &mut Reader, header: &PlyHeader, vertex: &PlyElement, mesh: &mut Mesh) -> Result<()> {
    let path = reader.path();
    if vertex.has_list() {
        return Err(Error::file(path, "lists in the vertices of a mesh are not supported"));
    }
    let (columns, unit) = colored_vertex_columns(path, vertex)?;
    let count = rows::check_count(reader, header.encoding, vertex)?;
    if count as u64 >= u64::from(u32::MAX) {
        return Err(Error::file(path, "more vertices than 32-bit indices can name"));
    }
    mesh.positions.reserve(count);
    rows::read(reader, header.encoding, vertex, &columns, |row| {
        mesh.positions.push([row[0] as f32, row[1] as f32, row[2] as f32]);
        if let Some(unit) = unit {
            mesh.colors.push([0, 1, 2].map(|c| (row[3 + c] * unit) as f32));
        }
    })?;
    match mesh.positions.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
        Some(at) => Err(Error::file(path, format!("{} {at} is not finite", excerpt("vertex")))),
        None => Ok(()),
    }
}
