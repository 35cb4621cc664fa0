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

    /// Removes vertices without a triangle; the others keep their order.
    pub fn drop_unused_vertices(&mut self) {
        let mut is_used = vec![false; self.positions.len()];
        self.triangles
            .iter()
            .flatten()
            .for_each(|&v| is_used[v as usize] = true);
        let mut place = vec![0u32; self.positions.len()];
        let mut count = 0;
        for (place, &is_used) in place.iter_mut().zip(&is_used) {
            *place = count;
            count += u32::from(is_used);
        }
        for values in [&mut self.positions, &mut self.normals, &mut self.colors] {
            let mut used = is_used.iter();
            values.retain(|_| used.next().copied().unwrap_or(false));
        }
        self.triangles
            .iter_mut()
            .flatten()
            .for_each(|v| *v = place[*v as usize]);
    }
}
