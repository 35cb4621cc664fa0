//! First palette: a tree of cells, each split across its direction of largest variance.

use rayon::prelude::*;

/// Weighted vectors of one length: ends of rows of an array, which a copy would double.
pub(super) struct Vectors<'a> {
    /// Numbers of a row.
    pub(super) stride: usize,
    /// Numbers of a vector: the last ones of its row.
    pub(super) length: usize,
    pub(super) numbers: &'a [f32],
    /// Row of each vector.
    pub(super) order: &'a [u32],
    /// Positive.
    pub(super) weights: &'a [f32],
}

impl Vectors<'_> {
    pub(super) fn len(&self) -> usize {
        self.order.len()
    }

    pub(super) fn row(&self, i: usize) -> &[f32] {
        let end = (self.order[i] as usize + 1) * self.stride;
        &self.numbers[end - self.length..end]
    }
}

/// Squared distance of vectors of equal length.
pub(super) fn distance2(a: &[f32], b: &[f32]) -> f32 {
    sum_of(a, b, |a, b| (a - b) * (a - b))
}

/// Inner product of vectors of equal length.
fn dot(a: &[f32], b: &[f32]) -> f32 {
    sum_of(a, b, |a, b| a * b)
}

/// Sum of a term of each pair, in eight lanes.
fn sum_of(a: &[f32], b: &[f32], term: impl Fn(f32, f32) -> f32) -> f32 {
    let mut sums = [0.0f32; 8];
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    for (a, b) in a.iter().zip(b) {
        for i in 0..8 {
            sums[i] += term(a[i], b[i]);
        }
    }
    for (sum, (a, b)) in sums.iter_mut().zip(a_rest.iter().zip(b_rest)) {
        *sum += term(*a, *b);
    }
    sums.iter().sum()
}

/// A leaf of the tree.
pub(super) struct Cell {
    /// Number of its vectors.
    count: usize,
    pub(super) mean: Vec<f32>,
    /// Weighted sum of squared distances from the mean.
    error: f64,
}

/// Vectors from which a direction is estimated at most.
const SAMPLE: usize = 2048;

/// Iterations of the power method.
const POWER_ITERATIONS: usize = 6;

impl Cell {
    fn new(vectors: &Vectors, members: &[u32]) -> Cell {
        let mut sum = vec![0.0f64; vectors.length];
        let mut weight = 0.0;
        for &i in members {
            let w = f64::from(vectors.weights[i as usize]);
            weight += w;
            for (sum, v) in sum.iter_mut().zip(vectors.row(i as usize)) {
                *sum += w * f64::from(*v);
            }
        }
        let mean: Vec<f32> = sum.iter().map(|sum| (sum / weight) as f32).collect();
        let errors = members.iter().map(|&i| {
            let distance = distance2(vectors.row(i as usize), &mean);
            f64::from(vectors.weights[i as usize]) * f64::from(distance)
        });
        Cell {
            count: members.len(),
            error: errors.sum(),
            mean,
        }
    }

    /// Direction of largest variance; not normalised. `None` for equal vectors.
    fn direction(&self, vectors: &Vectors, members: &[u32]) -> Option<Vec<f32>> {
        let step = members.len().div_ceil(SAMPLE);
        let sample: Vec<(f32, Vec<f32>)> = members
            .iter()
            .step_by(step)
            .map(|&i| {
                let row = vectors.row(i as usize).iter().zip(&self.mean);
                (vectors.weights[i as usize], row.map(|(v, m)| v - m).collect())
            })
            .collect();
        let farthest = sample
            .iter()
            .max_by(|a, b| dot(&a.1, &a.1).total_cmp(&dot(&b.1, &b.1)))?;
        let mut direction = farthest.1.clone();
        for _ in 0..POWER_ITERATIONS {
            let length = dot(&direction, &direction).sqrt();
            if !(length > 0.0 && length.is_finite()) {
                return None;
            }
            direction.iter_mut().for_each(|v| *v /= length);
            let mut next = vec![0.0f32; direction.len()];
            for (weight, row) in &sample {
                let factor = weight * dot(row, &direction);
                next.iter_mut().zip(row).for_each(|(n, v)| *n += factor * v);
            }
            if dot(&next, &next) > 0.0 {
                direction = next;
            }
        }
        Some(direction)
    }

    /// Sorts the members into two halves; returns both, or nothing if they cannot be told apart.
    fn split(&self, vectors: &Vectors, members: &mut [u32]) -> Option<[Cell; 2]> {
        let direction = self.direction(vectors, members)?;
        let offset = dot(&self.mean, &direction);
        let along: Vec<(f32, u32)> = members
            .iter()
            .map(|&i| (dot(vectors.row(i as usize), &direction) - offset, i))
            .collect();
        let threshold = threshold(vectors, &along);
        let (left, right): (Vec<_>, Vec<_>) = along.into_iter().partition(|(t, _)| *t <= threshold);
        if left.is_empty() || right.is_empty() {
            return None;
        }
        let middle = left.len();
        let sorted = left.into_iter().chain(right).map(|(_, i)| i);
        members.iter_mut().zip(sorted).for_each(|(member, i)| *member = i);
        let (left, right) = members.split_at(middle);
        Some([Cell::new(vectors, left), Cell::new(vectors, right)])
    }
}

/// Boundary between two means along a line, by Lloyd's iteration from the common mean.
fn threshold(vectors: &Vectors, along: &[(f32, u32)]) -> f32 {
    let mut threshold = 0.0f32;
    for _ in 0..8 {
        let mut sums = [[0.0f64; 2]; 2];
        for &(t, i) in along {
            let sums = &mut sums[usize::from(t > threshold)];
            let w = f64::from(vectors.weights[i as usize]);
            sums[0] += w;
            sums[1] += w * f64::from(t);
        }
        let [[wa, a], [wb, b]] = sums;
        if wa <= 0.0 || wb <= 0.0 {
            break;
        }
        let next = ((a / wa + b / wb) / 2.0) as f32;
        if next == threshold {
            break;
        }
        threshold = next;
    }
    threshold
}

/// At most `count` cells of least error, neighbours in space near each other in the list, and the cell of each vector.
/// The cells of largest error are split first.
pub(super) fn cells(vectors: &Vectors, count: usize) -> (Vec<Cell>, Vec<u32>) {
    let mut members: Vec<u32> = (0..vectors.len() as u32).collect();
    let mut cells = vec![Cell::new(vectors, &members)];
    while cells.len() < count {
        let mut order: Vec<usize> = (0..cells.len())
            .filter(|&i| cells[i].error > 0.0 && cells[i].count > 1)
            .collect();
        order.sort_by(|&a, &b| cells[b].error.total_cmp(&cells[a].error).then(a.cmp(&b)));
        order.truncate((count - cells.len()).min(cells.len().div_ceil(2)));
        let mut chosen = vec![false; cells.len()];
        order.iter().for_each(|&i| chosen[i] = true);
        let mut rest = members.as_mut_slice();
        let mut jobs = Vec::with_capacity(cells.len());
        for (cell, chosen) in cells.into_iter().zip(chosen) {
            let (own, after) = rest.split_at_mut(cell.count);
            rest = after;
            jobs.push((cell, chosen, own));
        }
        let parts = jobs.into_par_iter().map(|(mut cell, chosen, own)| {
            if !chosen {
                return vec![cell];
            }
            match cell.split(vectors, own) {
                Some(parts) => parts.into(),
                None => {
                    // Equal but for rounding.
                    cell.error = 0.0;
                    vec![cell]
                }
            }
        });
        cells = parts.collect::<Vec<_>>().into_iter().flatten().collect();
        if order.is_empty() {
            break;
        }
    }
    let mut cell_of = vec![0; vectors.len()];
    let mut start = 0;
    for (index, cell) in (0u32..).zip(&cells) {
        members[start..start + cell.count]
            .iter()
            .for_each(|&i| cell_of[i as usize] = index);
        start += cell.count;
    }
    (cells, cell_of)
}
