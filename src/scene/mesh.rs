//! A triangle mesh: contents of a file, surface of a scene, and target of ray casting.

/// Triangles over shared vertices; all indices are below `positions.len()`, all numbers finite.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions in world units.
    pub positions: Vec<[f32; 3]>,
    /// Vertex colours, 0 to 1 (display-referred): one per position, or empty.
    pub colors: Vec<[f32; 3]>,
    /// Unit normals of the vertices, outward: one per position, or empty.
    pub normals: Vec<[f32; 3]>,
    /// Indices of the corners, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// The corners of triangle `index`.
    pub fn corners(&self, index: usize) -> [[f32; 3]; 3] {
        self.triangles[index].map(|vertex| self.positions[vertex as usize])
    }
}
