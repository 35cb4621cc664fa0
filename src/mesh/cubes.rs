//! Triangles of a cube by the signs of its corners (marching cubes, Lorensen and Cline 1987).
//!
//! The table is derived, not listed. On each face, every run of inside corners is cut off by a segment of its own,
//! which depends on the face's corners alone: neighbouring cubes agree, without cracks. Segments join to loops, and
//! loops are cut into triangles by diagonals that lie in no face, where a neighbour's might lie too: each edge has two
//! triangles.

use std::sync::OnceLock;

/// Corner `c` of a cube is at (c & 1, c >> 1 & 1, c >> 2).
pub(super) const CORNERS: usize = 8;

/// Edges of a cube: first corner and axis.
pub(super) const EDGES: [(usize, usize); 12] = [
    (0, 0),
    (2, 0),
    (4, 0),
    (6, 0),
    (0, 1),
    (1, 1),
    (4, 1),
    (5, 1),
    (0, 2),
    (1, 2),
    (2, 2),
    (3, 2),
];

/// Corners of each face, counter-clockwise seen from outside.
const FACES: [[usize; 4]; 6] = [
    [0, 4, 6, 2],
    [1, 3, 7, 5],
    [0, 1, 5, 4],
    [2, 6, 7, 3],
    [0, 2, 3, 1],
    [4, 5, 7, 6],
];

/// Triangles of a cube, as edges, counter-clockwise seen from outside (where distances are positive).
pub(super) type Triangles = Vec<[usize; 3]>;

/// Triangles for each set of inside corners, bit c for corner c.
pub(super) fn table() -> &'static [Triangles] {
    static TABLE: OnceLock<Vec<Triangles>> = OnceLock::new();
    TABLE.get_or_init(|| (0..1 << CORNERS).map(triangles_of).collect())
}

/// The edge between two neighbouring corners.
fn edge_between(a: usize, b: usize) -> usize {
    let (first, axis) = (a.min(b), (a ^ b).trailing_zeros() as usize);
    EDGES.iter().position(|&edge| edge == (first, axis)).unwrap_or(0)
}

/// Faces that an edge lies in, as a bit set.
fn faces_of(edge: usize) -> u8 {
    let (first, axis) = EDGES[edge];
    let ends = [first, first | 1 << axis];
    let lies_in = |face: &[usize; 4]| ends.iter().all(|corner| face.contains(corner));
    (0..6).filter(|&f| lies_in(&FACES[f])).fold(0, |set, f| set | 1 << f)
}

fn triangles_of(inside: usize) -> Triangles {
    let is_inside = |corner: usize| inside >> corner & 1 == 1;
    // Next edge of the loop after each edge.
    let mut next = [None; 12];
    for face in FACES {
        let crossing = |i: usize| edge_between(face[i % 4], face[(i + 1) % 4]);
        for begin in 0..4 {
            // Entering the inside between two corners; leaving it after the run.
            if is_inside(face[begin]) || !is_inside(face[(begin + 1) % 4]) {
                continue;
            }
            let leave = (begin + 1..begin + 4).find(|&i| !is_inside(face[(i + 1) % 4]));
            if let Some(leave) = leave {
                next[crossing(begin)] = Some(crossing(leave));
            }
        }
    }
    let mut triangles = Vec::new();
    for start in 0..12 {
        let mut polygon = Vec::new();
        let mut edge = start;
        while let Some(after) = next[edge].take() {
            polygon.push(edge);
            edge = after;
        }
        if polygon.len() >= 3 {
            triangles.extend(cut(&polygon).unwrap_or_default());
        }
    }
    triangles
}

/// Triangles of a polygon whose diagonals join no two edges of one face, if there are such.
fn cut(polygon: &[usize]) -> Option<Triangles> {
    let count = polygon.len();
    if count < 3 {
        return Some(Vec::new());
    }
    let (first, last) = (polygon[0], polygon[count - 1]);
    // The triangle on the side between the last and the first.
    (1..count - 1).find_map(|apex| {
        let sound = |a: usize, b: usize, is_side: bool| is_side || faces_of(a) & faces_of(b) == 0;
        let corner = polygon[apex];
        let fits = sound(first, corner, apex == 1) && sound(corner, last, apex == count - 2);
        let parts = fits.then(|| Some([cut(&polygon[..=apex])?, cut(&polygon[apex..])?]))??;
        Some([&[[first, corner, last]], &parts[0][..], &parts[1][..]].concat())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use std::collections::BTreeMap;

    fn middle(edge: usize) -> Vec3 {
        let (first, axis) = EDGES[edge];
        let corner = [first & 1, first >> 1 & 1, first >> 2].map(|k| k as f32);
        let mut middle = Vec3::from(corner);
        middle[axis] = 0.5;
        middle
    }

    #[test]
    fn every_crossing_is_in_a_loop_and_every_loop_is_cut() {
        for (inside, triangles) in table().iter().enumerate() {
            let crossed = |&(first, axis): &(usize, usize)| (inside >> first ^ inside >> (first | 1 << axis)) & 1 == 1;
            let crossings: Vec<usize> = (0..12).filter(|&e| crossed(&EDGES[e])).collect();
            let mut used: Vec<usize> = triangles.iter().flatten().copied().collect();
            used.sort_unstable();
            used.dedup();
            assert_eq!(used, crossings, "{inside:08b}");
            // Sides that are not shared within the cube lie in its faces.
            let mut sides: BTreeMap<[usize; 2], i32> = BTreeMap::new();
            for t in triangles {
                for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                    *sides.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
                }
            }
            for ([a, b], balance) in sides {
                let in_face = faces_of(a) & faces_of(b) != 0;
                assert_eq!(balance.abs(), i32::from(in_face), "{inside:08b}: {a} and {b}");
            }
        }
    }

    #[test]
    fn triangles_face_the_outside() {
        for corner in 0..CORNERS {
            let [[a, b, c]] = table()[1 << corner][..] else {
                panic!("one corner makes one triangle")
            };
            let inside = Vec3::from([corner & 1, corner >> 1 & 1, corner >> 2].map(|k| k as f32));
            let normal = (middle(b) - middle(a)).cross(middle(c) - middle(a));
            assert!(normal.dot(middle(a) - inside) > 0.0, "corner {corner}");
        }
    }

    #[test]
    fn neighbours_cut_their_face_alike() {
        // A face of one cube and the opposite face of its neighbour along each axis.
        for axis in 0..3 {
            let bit = 1 << axis;
            for inside in 0..256usize {
                let far: Vec<usize> = (0..8).filter(|c| c & bit != 0).collect();
                let shared = far.iter().map(|c| inside >> c & 1);
                let other = far.iter().zip(shared).fold(0, |set, (c, is)| set | is << (c ^ bit));
                let segments = |inside: usize, on: usize| -> Vec<[usize; 2]> {
                    let flat = |edge: usize| {
                        let (first, along) = EDGES[edge];
                        (along != axis && (first & bit != 0) == (on == 1)).then_some((first & !bit, along))
                    };
                    let name = |edge| EDGES.iter().position(|e| Some(*e) == flat(edge));
                    let mut found: Vec<[usize; 2]> = Vec::new();
                    for t in &table()[inside] {
                        for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                            if let (Some(a), Some(b)) = (name(a), name(b)) {
                                found.push(if on == 1 { [a, b] } else { [b, a] });
                            }
                        }
                    }
                    found.sort_unstable();
                    found
                };
                assert_eq!(segments(inside, 1), segments(other, 0), "axis {axis}, {inside:08b}");
            }
        }
    }
}
