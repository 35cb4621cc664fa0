//! Codebooks of numbers: 256 values with the least weighted sum of squared errors.
//!
//! In one dimension the optimum is found by dynamic programming, as clusters are intervals of the sorted numbers
//! (Bellman 1973; Wu 1991; monotone boundaries by divide and conquer). It runs over bins of neighbouring numbers;
//! Lloyd's iteration over the numbers themselves follows.

use rayon::prelude::*;

/// Values of a codebook.
const SIZE: usize = 256;

/// Bins by equal weight, and as many by equal width, so that neither the bulk nor the tails are coarse.
const BINS: usize = 3072;

/// Most iterations over the numbers after the dynamic programme.
const ITERATIONS: usize = 20;

/// Codebook of at most 256 ascending values for numbers with weights; empty without numbers. All are finite.
pub(super) fn fit(mut numbers: Vec<(f32, f32)>) -> Vec<f32> {
    // The second key makes sums independent of the order of arrival.
    numbers.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let (Some(first), Some(last)) = (numbers.first(), numbers.last()) else {
        return Vec::new();
    };
    let range = [f64::from(first.0), f64::from(last.0)];
    let bins = PrefixSums::of_bins(&numbers, range);
    let ends = optimal_ends(&bins);
    let mut from = 0;
    let centers = ends.iter().map(|&end| {
        let center = bins.mean(from, end);
        from = end;
        center
    });
    let mut centers: Vec<f64> = centers.collect();
    polish(&mut centers, &numbers);
    let mut values: Vec<f32> = centers
        .into_iter()
        .map(|center| shortened(center, range) as f32)
        .collect();
    values.dedup();
    values
}

/// Index of the value nearest to a number; the codebook is ascending and not empty.
pub(super) fn nearest(codebook: &[f32], number: f32) -> u8 {
    let above = codebook.partition_point(|value| *value < number);
    let distance = |i: usize| codebook.get(i).map_or(f32::INFINITY, |value| (value - number).abs());
    let below = above.saturating_sub(1);
    let index = if distance(below) <= distance(above) {
        below
    } else {
        above
    };
    index as u8
}

/// A value rounded to the decimal that divides a 65,536th of the range, because its text counts in small files.
fn shortened(value: f64, [min, max]: [f64; 2]) -> f64 {
    let step = (max - min) / 65_536.0;
    if !(step > 0.0 && step.is_finite()) {
        return value;
    }
    let scale = 10f64.powi((-step.log10()).ceil().clamp(-30.0, 30.0) as i32);
    (value * scale).round() / scale
}

/// Sorted items with prefix sums of weight, weight · number, and weight · number².
struct PrefixSums {
    /// Largest number of each item.
    last: Vec<f32>,
    /// One more than items; numbers are relative to `origin`.
    prefix: Vec<[f64; 3]>,
    origin: f64,
}

impl PrefixSums {
    fn new(capacity: usize, origin: f64) -> PrefixSums {
        let mut prefix = Vec::with_capacity(capacity + 1);
        prefix.push([0.0; 3]);
        PrefixSums {
            last: Vec::with_capacity(capacity),
            prefix,
            origin,
        }
    }

    fn push(&mut self, last: f32, sums: [f64; 3]) {
        self.last.push(last);
        let before = self.prefix[self.prefix.len() - 1];
        self.prefix.push([0, 1, 2].map(|i| before[i] + sums[i]));
    }

    fn moments(&self, (number, weight): (f32, f32)) -> [f64; 3] {
        let (x, w) = (f64::from(number) - self.origin, f64::from(weight));
        [w, w * x, w * x * x]
    }

    /// Items of neighbouring numbers; equal numbers share one.
    fn of_bins(numbers: &[(f32, f32)], [min, max]: [f64; 2]) -> PrefixSums {
        let total: f64 = numbers.iter().map(|n| f64::from(n.1)).sum();
        let width = ((max - min) / BINS as f64).max(f64::MIN_POSITIVE);
        let bin_of = |number: f32| ((f64::from(number) - min) / width) as u64;
        let mut sums = PrefixSums::new(2 * BINS, min);
        let mut own = [0.0; 3];
        for (i, &number) in numbers.iter().enumerate() {
            let moments = sums.moments(number);
            own = [0, 1, 2].map(|k| own[k] + moments[k]);
            let ends = match numbers.get(i + 1) {
                Some(next) if next.0 == number.0 => false,
                Some(next) => own[0] >= total / BINS as f64 || bin_of(next.0) != bin_of(number.0),
                None => true,
            };
            if ends {
                sums.push(number.0, own);
                own = [0.0; 3];
            }
        }
        sums
    }

    fn len(&self) -> usize {
        self.last.len()
    }

    fn between(&self, from: usize, to: usize) -> [f64; 3] {
        [0, 1, 2].map(|i| self.prefix[to][i] - self.prefix[from][i])
    }

    /// Weighted sum of squared differences from the mean.
    fn cost(&self, from: usize, to: usize) -> f64 {
        let [w, x, xx] = self.between(from, to);
        if w > 0.0 { (xx - x * x / w).max(0.0) } else { 0.0 }
    }

    fn mean(&self, from: usize, to: usize) -> f64 {
        let [w, x, _] = self.between(from, to);
        match w > 0.0 {
            true => self.origin + x / w,
            false => self.last.get(from).map_or(self.origin, |last| f64::from(*last)),
        }
    }
}

/// Ends of the intervals of least cost, at most [`SIZE`].
fn optimal_ends(bins: &PrefixSums) -> Vec<usize> {
    let count = bins.len();
    if count <= SIZE {
        return (1..=count).collect();
    }
    // Cost of the first j + 1 bins in the intervals so far, and start of the last of them.
    let mut cost: Vec<f64> = (0..count).map(|j| bins.cost(0, j + 1)).collect();
    let mut starts: Vec<Vec<u32>> = vec![vec![0; count]];
    for layer in 1..SIZE {
        let mut next = vec![f64::INFINITY; count];
        let mut start = vec![0; count];
        let mut open = vec![(layer, count, layer, count - 1)];
        while let Some((from, to, low, high)) = open.pop() {
            if from >= to {
                continue;
            }
            let middle = (from + to) / 2;
            let mut best = (f64::INFINITY, low);
            for first in low..=high.min(middle) {
                let candidate = cost[first - 1] + bins.cost(first, middle + 1);
                if candidate < best.0 {
                    best = (candidate, first);
                }
            }
            (next[middle], start[middle]) = (best.0, best.1 as u32);
            open.push((from, middle, low, best.1));
            open.push((middle + 1, to, best.1, high));
        }
        cost = next;
        starts.push(start);
    }
    let mut ends = Vec::with_capacity(SIZE);
    let mut end = count;
    for start in starts.iter().rev() {
        ends.push(end);
        end = start[end - 1] as usize;
        if end == 0 {
            break;
        }
    }
    ends.reverse();
    ends
}

/// Lloyd's iteration on sorted numbers with weights: a number belongs to the nearest centre, a centre is the mean of
/// its numbers.
fn polish(centers: &mut [f64], numbers: &[(f32, f32)]) {
    for _ in 0..ITERATIONS {
        let before = centers.to_vec();
        let mut rest = numbers;
        for (i, center) in centers.iter_mut().enumerate() {
            let middle = before.get(i + 1).map_or(f64::INFINITY, |next| (before[i] + next) / 2.0);
            let (own, after) = rest.split_at(rest.partition_point(|n| f64::from(n.0) <= middle));
            rest = after;
            let (mut weight, mut offset) = (0.0, 0.0);
            for &(number, w) in own {
                weight += f64::from(w);
                offset += f64::from(w) * (f64::from(number) - before[i]);
            }
            if weight > 0.0 {
                *center = before[i] + offset / weight;
            }
        }
        if *centers == before {
            break;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(codebook: &[f32], numbers: &[f32]) -> f64 {
        let squares = numbers.iter().map(|n| {
            let value = codebook[usize::from(nearest(codebook, *n))];
            f64::from(value - n).powi(2)
        });
        squares.sum()
    }

    #[test]
    fn few_numbers_are_their_own_codebook() {
        let numbers = [3.0, -1.0, 0.5, 3.0];
        assert_eq!(fit(numbers.map(|n| (n, 1.0)).to_vec()), [-1.0, 0.5, 3.0]);
        assert_eq!(fit(vec![(2.5, 1.0); 7]), [2.5]);
        assert_eq!(fit(Vec::new()), [0.0; 0]);
    }

    /// For a uniform density the optimum is 256 equal intervals, with an error of step² / 12.
    #[test]
    fn uniform_numbers_get_equal_intervals() {
        let numbers: Vec<f32> = (0..65_536).map(|i| i as f32 / 65_536.0).collect();
        let codebook = fit(numbers.iter().map(|n| (*n, 1.0)).collect());
        assert_eq!(codebook.len(), 256);
        let wanted = 65_536.0 * (1.0f64 / 256.0).powi(2) / 12.0;
        let found = error(&codebook, &numbers);
        assert!(found < 1.01 * wanted, "{found} of {wanted}");
    }

    #[test]
    fn weights_draw_values_to_them() {
        let mut numbers: Vec<(f32, f32)> = (0..10_000).map(|i| (i as f32, 1e-3)).collect();
        numbers.iter_mut().take(200).for_each(|n| n.1 = 1e6);
        let codebook = fit(numbers);
        let exact = (0..200).filter(|i| codebook.contains(&(*i as f32))).count();
        assert_eq!(exact, 200, "each heavy number is a value");
    }

    #[test]
    fn nearest_values_are_found() {
        let codebook = [-1.0, 0.0, 0.25, 9.0];
        for (number, index) in [(-9.0, 0), (-0.6, 0), (-0.4, 1), (0.2, 2), (4.0, 2), (5.0, 3), (99.0, 3)] {
            assert_eq!(nearest(&codebook, number), index, "{number}");
        }
    }
}
