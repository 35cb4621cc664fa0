//! Triangles of a volume's surface, block by block.

use super::cubes::{CORNERS, EDGES, table};
use super::flood_fill::FloodFill;
use super::volume::{Key, SIDE, VOXELS, Volume, Voxel, VoxelBlock};
use crate::scene::Mesh;
use glam::Vec3;
use rayon::prelude::*;
use std::collections::HashMap;

/// A block with one voxel around it before and two behind: corners of its cubes and their differences.
const HALO: usize = SIDE + 3;

/// Shares of an edge at which crossings are held, so that no triangle collapses.
const SHARE: [f32; 2] = [0.01, 0.99];

/// Vertex of a surface, on the edge between two voxels.
#[derive(Clone, Copy, Debug)]
struct Vertex {
    position: [f32; 3],
    normal: [f32; 3],
    color: [f32; 3],
}

/// An edge between voxels: first voxel and axis.
type EdgeKey = ([i32; 3], u8);

/// True for an edge on the border of blocks, whose cubes are in several.
fn is_shared((first, axis): &EdgeKey) -> bool {
    (0..3).any(|i| i != usize::from(*axis) && first[i].rem_euclid(SIDE as i32) == 0)
}

/// Triangles of a block; corners are places in `vertices`.
#[derive(Default)]
struct Piece {
    vertices: Vec<(EdgeKey, Vertex)>,
    triangles: Vec<[u32; 3]>,
}

/// A mesh that grows by the pieces of blocks; vertices on their borders are shared.
#[derive(Debug, Default)]
pub(super) struct MeshBuilder {
    pub mesh: Mesh,
    vertex_from_edge: HashMap<EdgeKey, u32>,
}

impl MeshBuilder {
    /// Adds the surface in the cubes of the blocks that `wanted` names. Cubes with a corner that fewer than `views_min`
    /// views saw are left open, or take its side from `outside`.
    pub(super) fn add(
        &mut self,
        volume: &Volume,
        (views_min, outside): (u32, Option<&FloodFill>),
        wanted: impl Fn(&Key) -> bool + Sync,
    ) {
        let mut keys = volume.keys.clone();
        if outside.is_some() {
            // The first corners of a cube may be in a block that is not stored.
            let before = |key: &Key| {
                (1..8).map({
                    let key = *key;
                    move |i| [0, 1, 2].map(|axis| key[axis] - (i >> axis & 1))
                })
            };
            keys.extend(volume.keys.iter().flat_map(before));
            keys.sort_unstable();
            keys.dedup();
        }
        keys.retain(&wanted);
        // In parts, so that pieces do not pile up.
        for part in keys.chunks(1024) {
            let pieces: Vec<Piece> = part
                .par_iter()
                .map(|&key| piece(volume, key, views_min, outside))
                .collect();
            pieces.iter().for_each(|piece| self.join(piece));
        }
    }

    fn join(&mut self, piece: &Piece) {
        let mesh = &mut self.mesh;
        let mut push = |vertex: &Vertex| {
            mesh.positions.push(vertex.position);
            mesh.normals.push(vertex.normal);
            mesh.colors.push(vertex.color);
            mesh.positions.len() as u32 - 1
        };
        let place = |(edge, vertex): &(EdgeKey, Vertex)| match is_shared(edge) {
            true => *self.vertex_from_edge.entry(*edge).or_insert_with(|| push(vertex)),
            false => push(vertex),
        };
        let places: Vec<u32> = piece.vertices.iter().map(place).collect();
        let corners = |t: &[u32; 3]| t.map(|vertex| places[vertex as usize]);
        self.mesh.triangles.extend(piece.triangles.iter().map(corners));
    }
}

/// The voxels of a block and around it; `None` where too few views saw them.
struct Neighbourhood {
    /// Index of the first voxel, one before the block's.
    first: [i32; 3],
    voxels: Vec<Option<Voxel>>,
}

impl Neighbourhood {
    fn new(volume: &Volume, key: Key, views_min: u32, outside: Option<&FloodFill>) -> Neighbourhood {
        let first = key.map(|k| k * SIDE as i32 - 1);
        let keys = (0..27).map(|i| [0, 1, 2].map(|axis| key[axis] + i / [1, 3, 9][axis] % 3 - 1));
        let around: Vec<(Key, Option<VoxelBlock<'_>>)> = keys.map(|key| (key, volume.block(key))).collect();
        let voxel = |i: usize| {
            let place = [i % HALO, i / HALO % HALO, i / (HALO * HALO)].map(|k| k + SIDE - 1);
            let (key, block) = around[place[0] / SIDE + 3 * (place[1] / SIDE) + 9 * (place[2] / SIDE)];
            let inner = place.map(|k| k % SIDE);
            let inner = inner[0] + SIDE * (inner[1] + SIDE * inner[2]);
            block.and_then(|block| block.voxel(inner, views_min)).or_else(|| {
                let distance = outside?.side(key, inner);
                Some(Voxel { distance, color: None })
            })
        };
        Neighbourhood {
            first,
            voxels: (0..HALO * HALO * HALO).map(voxel).collect(),
        }
    }

    fn at(&self, place: [usize; 3]) -> Option<Voxel> {
        self.voxels[place[0] + HALO * (place[1] + HALO * place[2])]
    }

    /// Slope of the distances at a known voxel: central differences where both neighbours are known, else one-sided.
    fn gradient(&self, place: [usize; 3]) -> Vec3 {
        let distance = |place: [usize; 3]| self.at(place).map(|voxel| voxel.distance);
        let Some(middle) = distance(place) else {
            return Vec3::ZERO;
        };
        let along = |axis: usize| {
            let moved = |step: usize| {
                let mut to = place;
                to[axis] = to[axis] + step - 1;
                (to[axis] < HALO).then(|| distance(to)).flatten()
            };
            let before = place[axis].checked_sub(1).and_then(|_| moved(0));
            match (before, moved(2)) {
                (Some(before), Some(behind)) => 0.5 * (behind - before),
                (Some(before), None) => middle - before,
                (None, Some(behind)) => behind - middle,
                (None, None) => 0.0,
            }
        };
        Vec3::new(along(0), along(1), along(2))
    }
}

fn piece(volume: &Volume, key: Key, views_min: u32, outside: Option<&FloodFill>) -> Piece {
    let mut piece = Piece::default();
    let around = Neighbourhood::new(volume, key, views_min, outside);
    let mut vertex_from_edge: HashMap<EdgeKey, u32> = HashMap::new();
    for cube in 0..VOXELS {
        let low = [cube % SIDE, cube / SIDE % SIDE, cube / (SIDE * SIDE)].map(|k| k + 1);
        let corner = |c: usize| [low[0] + (c & 1), low[1] + (c >> 1 & 1), low[2] + (c >> 2)];
        let Some(inside) = inside(&around, corner) else {
            continue;
        };
        for triangle in &table()[inside] {
            let corners = triangle.map(|edge| {
                let (first, axis) = EDGES[edge];
                let ends = [corner(first), corner(first | 1 << axis)];
                let index = [0, 1, 2].map(|i| around.first[i] + ends[0][i] as i32);
                *vertex_from_edge.entry((index, axis as u8)).or_insert_with(|| {
                    piece
                        .vertices
                        .push(((index, axis as u8), vertex(&around, ends, axis, volume.voxel)));
                    piece.vertices.len() as u32 - 1
                })
            });
            piece.triangles.push(corners);
        }
    }
    piece
}

/// Set of the corners inside, or `None` if one is unknown.
fn inside(around: &Neighbourhood, corner: impl Fn(usize) -> [usize; 3]) -> Option<usize> {
    let mut inside = 0;
    for c in 0..CORNERS {
        inside |= usize::from(around.at(corner(c))?.distance < 0.0) << c;
    }
    Some(inside)
}

/// The vertex between two known voxels on either side of the surface.
fn vertex(around: &Neighbourhood, ends: [[usize; 3]; 2], axis: usize, voxel: f64) -> Vertex {
    let [a, b] = ends.map(|end| around.at(end).unwrap_or_default());
    let share = (a.distance / (a.distance - b.distance)).clamp(SHARE[0], SHARE[1]);
    let mut position = [0, 1, 2].map(|i| f64::from(around.first[i]) + ends[0][i] as f64);
    position[axis] += f64::from(share);
    let [slope_a, slope_b] = ends.map(|end| around.gradient(end));
    let normal = slope_a.lerp(slope_b, share).normalize_or_zero();
    let color = match (a.color, b.color) {
        (Some(a), Some(b)) => a.lerp(b, share),
        (of_a, of_b) => of_a.or(of_b).unwrap_or_default(),
    };
    Vertex {
        position: position.map(|x| (x * voxel) as f32),
        normal: normal.to_array(),
        color: color.clamp(Vec3::ZERO, Vec3::ONE).to_array(),
    }
}
