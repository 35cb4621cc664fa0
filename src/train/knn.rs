//! Nearest neighbours of every point of a set: a k-d tree in one index array, queried in parallel.

use rayon::prelude::*;
use std::cmp::Ordering;

/// Maximum number of points of a leaf; below this a scan is faster than a descent.
const LEAF: usize = 8;

/// Neighbours of the mean distance (3DGS: "the mean of the distance to the closest three points").
const NEIGHBORS: usize = 3;

/// Mean distance of every point to its three nearest others at a different place, or to as many as there are; 0 if
/// there is none. All points must be finite.
pub(crate) fn mean_neighbor_distance(points: &[[f32; 3]]) -> Vec<f64> {
    // Duplicates would all be visited by each other's search: one stands for all.
    let mut places = points.to_vec();
    places.sort_unstable_by(compare);
    places.dedup_by(|a, b| compare(a, b).is_eq());
    let tree = KdTree::new(&places);
    let mean = |&query: &[f32; 3]| {
        // Coincident points, including the point itself, have no spacing.
        let found = tree.nearest(query, NEIGHBORS, |squared, _| squared > 0.0);
        let distances: Vec<f64> = found.iter().map(|(squared, _)| squared.sqrt()).collect();
        distances.iter().sum::<f64>() / distances.len().max(1) as f64
    };
    points.par_iter().map(mean).collect()
}

/// For each of `points`, the indices of at most `count` nearest others, nearest first. All points must be finite.
/// Coincident points are neighbours of each other.
pub(crate) fn neighbors(points: &[[f32; 3]], count: usize) -> Vec<Vec<u32>> {
    let tree = KdTree::new(points);
    let near = |query: usize| {
        let found = tree.nearest(points[query], count, |_, index| index as usize != query);
        found.into_iter().map(|(_, index)| index).collect()
    };
    (0..points.len()).into_par_iter().map(near).collect()
}

fn compare(a: &[f32; 3], b: &[f32; 3]) -> Ordering {
    let axes = a.iter().zip(b).map(|(x, y)| x.total_cmp(y));
    axes.fold(Ordering::Equal, Ordering::then)
}

/// k-d tree of points, all finite.
pub(super) struct KdTree<'a> {
    points: &'a [[f32; 3]],
    order: Vec<u32>,
}

/// Search for the nearest points that pass the `filter` of squared distance and index.
struct Search<F> {
    query: [f64; 3],
    count: usize,
    filter: F,
    /// Squared distances and indices so far, ascending.
    found: Vec<(f64, u32)>,
}

impl<'a> KdTree<'a> {
    pub(super) fn new(points: &'a [[f32; 3]]) -> KdTree<'a> {
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        build(points, &mut order, 0);
        KdTree { points, order }
    }

    /// Squared distances and indices of at most `count` nearest points that pass the filter, nearest first.
    pub(super) fn nearest(&self, query: [f32; 3], count: usize, filter: impl Fn(f64, u32) -> bool) -> Vec<(f64, u32)> {
        let mut search = Search {
            query: query.map(f64::from),
            count,
            filter,
            found: Vec::with_capacity(count + 1),
        };
        search.descend(self.points, &self.order, 0);
        search.found
    }
}

/// Splits the range at its median along the axes in turn. The depth is the logarithm of the count, even with
/// duplicates.
fn build(points: &[[f32; 3]], order: &mut [u32], axis: usize) {
    if order.len() <= LEAF {
        return;
    }
    let middle = order.len() / 2;
    let coordinate = |&i: &u32| points[i as usize][axis];
    order.select_nth_unstable_by(middle, |a, b| coordinate(a).total_cmp(&coordinate(b)).then(a.cmp(b)));
    let (left, right) = order.split_at_mut(middle);
    build(points, left, (axis + 1) % 3);
    build(points, &mut right[1..], (axis + 1) % 3);
}

impl<F: Fn(f64, u32) -> bool> Search<F> {
    fn offer(&mut self, points: &[[f32; 3]], index: u32) {
        let point = points[index as usize].map(f64::from);
        let squared = (0..3).map(|axis| (self.query[axis] - point[axis]).powi(2)).sum();
        if (self.filter)(squared, index) {
            let place = self.found.partition_point(|&other| other < (squared, index));
            self.found.insert(place, (squared, index));
            self.found.truncate(self.count);
        }
    }

    fn descend(&mut self, points: &[[f32; 3]], order: &[u32], axis: usize) {
        if order.len() <= LEAF {
            order.iter().for_each(|&i| self.offer(points, i));
            return;
        }
        let middle = order.len() / 2;
        let pivot = order[middle];
        self.offer(points, pivot);
        let offset = self.query[axis] - f64::from(points[pivot as usize][axis]);
        let (left, right) = (&order[..middle], &order[middle + 1..]);
        let (near, far) = if offset < 0.0 { (left, right) } else { (right, left) };
        self.descend(points, near, (axis + 1) % 3);
        let is_full = self.found.len() == self.count;
        // Strictly less: among many coincident points any `count` will do.
        if !is_full || self.found.last().is_some_and(|&(worst, _)| offset * offset < worst) {
            self.descend(points, far, (axis + 1) % 3);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::rng::{self, Stream};

    /// Squared distances and indices of all points, ascending.
    fn scan(points: &[[f32; 3]], query: [f32; 3]) -> Vec<(f64, u32)> {
        let squared = |point: &[f32; 3]| {
            (0..3)
                .map(|k| (f64::from(point[k]) - f64::from(query[k])).powi(2))
                .sum()
        };
        let mut all: Vec<(f64, u32)> = points.iter().map(squared).zip(0..).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        all
    }

    #[test]
    fn the_tree_finds_what_a_scan_of_all_points_finds() {
        for count in [0_u32, 1, 2, 3, 8, 9, 10, 100, 900, 1_500] {
            let mut points: Vec<[f32; 3]> = (0..count)
                .map(|i| rng::uniform(3, count, i, Stream::RandomInit))
                .map(|[x, y, z, _]| [x, y * 0.1, z * 10.0])
                .collect();
            for (found, query) in neighbors(&points, 6).iter().zip(0..) {
                let others = scan(&points, points[query as usize]).into_iter().map(|(_, i)| i);
                let wanted: Vec<u32> = others.filter(|&i| i != query).take(6).collect();
                assert_eq!(found, &wanted, "{query} of {count}");
            }
            for i in (0..points.len()).step_by(5) {
                points[i] = points[0];
            }
            let mut places = points.clone();
            places.sort_unstable_by(compare);
            places.dedup();
            let mean = |&query: &[f32; 3]| {
                let distances = scan(&places, query).into_iter().map(|(squared, _)| squared.sqrt());
                let nearest: Vec<f64> = distances.filter(|&d| d > 0.0).take(NEIGHBORS).collect();
                nearest.iter().sum::<f64>() / nearest.len().max(1) as f64
            };
            let wanted: Vec<f64> = points.iter().map(mean).collect();
            assert_eq!(mean_neighbor_distance(&points), wanted, "{count}");
        }
    }

    #[test]
    fn points_in_one_place_have_no_spacing() {
        assert_eq!(mean_neighbor_distance(&[[1.0; 3]; 100]), vec![0.0; 100]);
        assert_eq!(mean_neighbor_distance(&[[0.0; 3], [2.0, 0.0, 0.0]]), [2.0, 2.0]);
    }

    #[test]
    fn points_in_one_place_find_each_other() {
        for (found, query) in neighbors(&[[1.0; 3]; 5_000], 4).iter().zip(0..) {
            assert_eq!(found.len(), 4);
            assert!(!found.contains(&query));
        }
    }
}
