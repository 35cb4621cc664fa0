//! Nearest neighbours of every point of a set, by index.

use crate::train::knn::{LEAF, build};
use rayon::prelude::*;

/// For each of `points`, the indices of at most `count` nearest others, nearest first. All points must be finite.
/// Coincident points are neighbours of each other.
pub(super) fn neighbors(points: &[[f32; 3]], count: usize) -> Vec<Vec<u32>> {
    let mut order: Vec<u32> = (0..points.len() as u32).collect();
    build(points, &mut order, 0);
    let tree = Tree { points, order };
    let near = |query: usize| {
        let mut nearest = Nearest {
            query,
            count,
            found: Vec::with_capacity(count + 1),
        };
        tree.search(&tree.order, 0, &mut nearest);
        nearest.found.into_iter().map(|(_, i)| i).collect()
    };
    (0..points.len()).into_par_iter().map(near).collect()
}

struct Tree<'a> {
    points: &'a [[f32; 3]],
    order: Vec<u32>,
}

/// Nearest points so far, ascending by squared distance and index.
struct Nearest {
    query: usize,
    count: usize,
    found: Vec<(f64, u32)>,
}

impl Nearest {
    fn worst(&self) -> f64 {
        match self.found.len() < self.count {
            true => f64::INFINITY,
            false => self.found.last().map_or(0.0, |(distance, _)| *distance),
        }
    }

    fn offer(&mut self, index: u32, distance: f64) {
        if index as usize == self.query {
            return;
        }
        let before = |&(other, i): &(f64, u32)| (other, i) < (distance, index);
        let place = self.found.partition_point(before);
        self.found.insert(place, (distance, index));
        self.found.truncate(self.count);
    }
}

impl Tree<'_> {
    fn search(&self, order: &[u32], axis: usize, nearest: &mut Nearest) {
        let query = self.points[nearest.query].map(f64::from);
        let distance = |i: u32| {
            let point = self.points[i as usize].map(f64::from);
            (0..3).map(|k| (point[k] - query[k]).powi(2)).sum::<f64>()
        };
        if order.len() <= LEAF {
            order.iter().for_each(|&i| nearest.offer(i, distance(i)));
            return;
        }
        let middle = order.len() / 2;
        let pivot = order[middle];
        nearest.offer(pivot, distance(pivot));
        let offset = query[axis] - f64::from(self.points[pivot as usize][axis]);
        let (left, right) = (&order[..middle], &order[middle + 1..]);
        let (near, far) = if offset < 0.0 { (left, right) } else { (right, left) };
        self.search(near, (axis + 1) % 3, nearest);
        // Strictly less: among many coincident points any `count` will do.
        if offset * offset < nearest.worst() {
            self.search(far, (axis + 1) % 3, nearest);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::rng::{self, Stream};

    #[test]
    fn the_tree_finds_what_a_scan_of_all_points_finds() {
        for size in [0_u32, 1, 2, 9, 10, 100, 900] {
            let points: Vec<[f32; 3]> = (0..size)
                .map(|i| rng::uniform(3, size, i, Stream::RandomInit))
                .map(|[x, y, z, _]| [x, y * 0.1, z * 10.0])
                .collect();
            let found = neighbors(&points, 6);
            for (query, found) in found.iter().enumerate() {
                let distance = |i: u32| {
                    let (a, b) = (points[i as usize].map(f64::from), points[query].map(f64::from));
                    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>()
                };
                let mut all: Vec<u32> = (0..size).filter(|&i| i as usize != query).collect();
                all.sort_by(|&a, &b| distance(a).total_cmp(&distance(b)).then(a.cmp(&b)));
                all.truncate(6);
                assert_eq!(found, &all, "{query} of {size}");
            }
        }
    }

    #[test]
    fn points_in_one_place_find_each_other() {
        let found = neighbors(&[[1.0; 3]; 5_000], 4);
        for (query, found) in found.iter().enumerate() {
            assert_eq!(found.len(), 4);
            assert!(!found.contains(&(query as u32)));
        }
    }
}
