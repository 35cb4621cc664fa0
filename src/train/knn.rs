//! Nearest neighbours of every point of a set: a k-d tree in one index array, queried in parallel.

use rayon::prelude::*;
use std::cmp::Ordering;

/// Maximum number of points of a leaf; below this a scan is faster than a descent.
pub(crate) const LEAF: usize = 8;

/// Neighbours of the mean distance (3DGS: "the mean of the distance to the closest three points").
const NEIGHBORS: usize = 3;

/// Mean distance of every point to its three nearest others at a different place, or to as many as there are; 0 if
/// there is none. All points must be finite.
pub(crate) fn mean_neighbor_distance(points: &[[f32; 3]]) -> Vec<f64> {
    // Duplicates would all be visited by each other's search: one stands for all.
    let mut places = points.to_vec();
    places.sort_unstable_by(compare);
    places.dedup_by(|a, b| compare(a, b).is_eq());
    let mut order: Vec<u32> = (0..places.len() as u32).collect();
    build(&places, &mut order, 0);
    points
        .par_iter()
        .map(|&query| {
            let mut nearest = NearestDistances::default();
            search(&places, &order, 0, query, &mut nearest);
            nearest.mean_distance()
        })
        .collect()
}

fn compare(a: &[f32; 3], b: &[f32; 3]) -> Ordering {
    let axes = a.iter().zip(b).map(|(x, y)| x.total_cmp(y));
    axes.fold(Ordering::Equal, Ordering::then)
}

/// Splits the range at its median along the axes in turn. The depth is the logarithm of the count, even with
/// duplicates.
pub(crate) fn build(points: &[[f32; 3]], order: &mut [u32], axis: usize) {
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

/// Squared distances of the nearest points so far, ascending.
struct NearestDistances([f64; NEIGHBORS]);

impl Default for NearestDistances {
    fn default() -> NearestDistances {
        NearestDistances([f64::INFINITY; NEIGHBORS])
    }
}

impl NearestDistances {
    fn offer(&mut self, a: [f32; 3], b: [f32; 3]) {
        let mut squared = 0.0;
        for axis in 0..3 {
            squared += (f64::from(a[axis]) - f64::from(b[axis])).powi(2);
        }
        // Coincident points, including the point itself, have no spacing.
        if squared > 0.0 && squared < self.0[NEIGHBORS - 1] {
            self.0[NEIGHBORS - 1] = squared;
            self.0.sort_unstable_by(f64::total_cmp);
        }
    }

    fn mean_distance(&self) -> f64 {
        let found: Vec<f64> = self.0.iter().filter(|d| d.is_finite()).map(|d| d.sqrt()).collect();
        found.iter().sum::<f64>() / found.len().max(1) as f64
    }
}

fn search(points: &[[f32; 3]], order: &[u32], axis: usize, query: [f32; 3], best: &mut NearestDistances) {
    if order.len() <= LEAF {
        for &i in order {
            best.offer(query, points[i as usize]);
        }
        return;
    }
    let middle = order.len() / 2;
    let pivot = points[order[middle] as usize];
    best.offer(query, pivot);
    let offset = f64::from(query[axis]) - f64::from(pivot[axis]);
    let (left, right) = (&order[..middle], &order[middle + 1..]);
    let (near, far) = if offset < 0.0 { (left, right) } else { (right, left) };
    search(points, near, (axis + 1) % 3, query, best);
    if offset * offset < best.0[NEIGHBORS - 1] {
        search(points, far, (axis + 1) % 3, query, best);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::rng::{self, Stream};

    fn brute_force(points: &[[f32; 3]]) -> Vec<f64> {
        let mut places = points.to_vec();
        places.sort_unstable_by(compare);
        places.dedup();
        let all = |&query: &[f32; 3]| {
            let mut nearest = NearestDistances::default();
            places.iter().for_each(|&p| nearest.offer(query, p));
            nearest.mean_distance()
        };
        points.iter().map(all).collect()
    }

    #[test]
    fn the_tree_finds_what_a_scan_of_all_points_finds() {
        for count in [0_u32, 1, 2, 3, 8, 9, 10, 100, 1_500] {
            let mut points: Vec<[f32; 3]> = (0..count)
                .map(|i| rng::uniform(3, count, i, Stream::RandomInit))
                .map(|[x, y, z, _]| [x, y * 0.1, z * 10.0])
                .collect();
            for i in (0..points.len()).step_by(5) {
                points[i] = points[0];
            }
            assert_eq!(mean_neighbor_distance(&points), brute_force(&points), "{count}");
        }
    }

    #[test]
    fn points_in_one_place_have_no_spacing() {
        assert_eq!(mean_neighbor_distance(&[[1.0; 3]; 100]), vec![0.0; 100]);
        assert_eq!(mean_neighbor_distance(&[[0.0; 3], [2.0, 0.0, 0.0]]), [2.0, 2.0]);
    }
}
