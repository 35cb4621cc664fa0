//! Connected components of a mesh, and removal of small ones.

use crate::scene::Mesh;
use glam::Vec3;

/// Least triangles of a component that stays, besides the largest.
const TRIANGLES_MIN: usize = 100;
/// Least share of the largest component's area.
const AREA_MIN: f64 = 0.01;

/// Connected triangles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshComponent {
    /// A vertex that names it.
    root: u32,
    /// Number of triangles.
    pub triangles: usize,
    /// Their area, square world units.
    pub area: f64,
}

/// Components by area, the largest first, ties by their first vertex.
pub fn components(mesh: &Mesh) -> Vec<MeshComponent> {
    collect(mesh, &roots(mesh))
}

/// Removes all but the `largest` components, or without a number those with fewer than 100 triangles or less than a
/// hundredth of the largest one's area; returns the number of components removed. Vertices without a triangle go too.
pub fn clean(mesh: &mut Mesh, largest: Option<usize>) -> usize {
    let roots = roots(mesh);
    let all = collect(mesh, &roots);
    let kept = match largest {
        Some(count) => count.min(all.len()),
        None => {
            let least = all.first().map_or(0.0, |first| AREA_MIN * first.area);
            let stays = |c: &MeshComponent| c.triangles >= TRIANGLES_MIN && c.area >= least;
            // By area: a component behind one that goes may have more triangles.
            return keep(mesh, &roots, &all, |i, c| i == 0 || stays(c));
        }
    };
    keep(mesh, &roots, &all, |i, _| i < kept)
}

fn keep(mesh: &mut Mesh, roots: &[u32], all: &[MeshComponent], stays: impl Fn(usize, &MeshComponent) -> bool) -> usize {
    let mut is_kept = vec![false; mesh.positions.len()];
    let mut removed = 0;
    for (i, component) in all.iter().enumerate() {
        is_kept[component.root as usize] = stays(i, component);
        removed += usize::from(!stays(i, component));
    }
    mesh.triangles.retain(|t| is_kept[roots[t[0] as usize] as usize]);
    mesh.drop_unused_vertices();
    removed
}

/// Root of each vertex: union by the lower index, with halving of paths.
fn roots(mesh: &Mesh) -> Vec<u32> {
    let mut parent: Vec<u32> = (0..mesh.positions.len() as u32).collect();
    for t in &mesh.triangles {
        for (a, b) in [(t[0], t[1]), (t[1], t[2])] {
            let (a, b) = (find(&mut parent, a), find(&mut parent, b));
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    (0..parent.len() as u32).map(|v| find(&mut parent, v)).collect()
}

fn find(parent: &mut [u32], mut vertex: u32) -> u32 {
    while parent[vertex as usize] != vertex {
        parent[vertex as usize] = parent[parent[vertex as usize] as usize];
        vertex = parent[vertex as usize];
    }
    vertex
}

fn collect(mesh: &Mesh, roots: &[u32]) -> Vec<MeshComponent> {
    let mut all = vec![(0usize, 0.0f64); roots.len()];
    for (i, t) in mesh.triangles.iter().enumerate() {
        let [a, b, c] = mesh.corners(i).map(Vec3::from);
        let sums = &mut all[roots[t[0] as usize] as usize];
        sums.0 += 1;
        sums.1 += 0.5 * f64::from((b - a).cross(c - a).length());
    }
    let found = all.iter().enumerate().filter(|(_, sums)| sums.0 > 0);
    let mut found: Vec<MeshComponent> = found
        .map(|(root, &(triangles, area))| MeshComponent {
            root: root as u32,
            triangles,
            area,
        })
        .collect();
    found.sort_by(|a, b| b.area.total_cmp(&a.area).then(a.root.cmp(&b.root)));
    found
}
