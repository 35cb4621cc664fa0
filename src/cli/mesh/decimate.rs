//! Fewer triangles of a mesh.

use crate::scene::Mesh;
use crate::{Error, Result};
use meshopt::{SimplifyOptions, VertexDataAdapter, simplify};

/// Collapses edges by their quadric error (Garland and Heckbert 1997, by `meshopt`) until at most `triangles` are left,
/// or none can go without a change of topology. Vertices that stay keep their place.
pub(super) fn decimate(mesh: &mut Mesh, triangles: usize) -> Result<()> {
    if mesh.triangles.len() <= triangles {
        return Ok(());
    }
    let bytes: Vec<u8> = mesh
        .positions
        .as_flattened()
        .iter()
        .flat_map(|x| x.to_ne_bytes())
        .collect();
    let vertices = VertexDataAdapter::new(&bytes, size_of::<[f32; 3]>(), 0);
    let vertices = vertices.map_err(|error| Error::Config(format!("the mesh cannot be simplified: {error}")))?;
    // No limit on the error: the count alone decides.
    let options = SimplifyOptions::None;
    let corners = simplify(
        mesh.triangles.as_flattened(),
        &vertices,
        3 * triangles,
        f32::MAX,
        options,
        None,
    );
    mesh.triangles = corners.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
    mesh.drop_unused_vertices();
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lab::synth::icosphere;
    use glam::Vec3;

    #[test]
    fn a_sphere_keeps_its_place_with_fewer_triangles() {
        let full = icosphere(5);
        let mut mesh = full.clone();
        mesh.normals = mesh.positions.clone();
        decimate(&mut mesh, 2_000).unwrap();
        assert!(
            (1_500..=2_000).contains(&mesh.triangles.len()),
            "{}",
            mesh.triangles.len()
        );
        assert_eq!(mesh.normals, mesh.positions, "attributes of other vertices");
        assert!(mesh.positions.len() < 1_200);
        for i in 0..mesh.triangles.len() {
            let [a, b, c] = mesh.corners(i).map(Vec3::from);
            assert!(((a + b + c) / 3.0).length() > 0.98);
        }
        let mut same = full.clone();
        decimate(&mut same, full.triangles.len()).unwrap();
        assert_eq!(same, full);
    }
}
