//! Palettes of vectors by k-means in near-linear time.
//!
//! Cells of a tree, more than are wanted, are the first clusters; those that cost least are merged. Then a vector is
//! compared with its own centroid and with the nearest centroids of that one, instead of with all, and moves on while
//! it finds a nearer one. Neighbours come from a graph refined by neighbours of neighbours (NN-descent, Dong, Moses and
//! Li 2011).

use super::tree::{Vectors, cells, distance2};
use rayon::prelude::*;

/// Neighbours of each centroid.
const NEIGHBOURS: usize = 24;

/// Rounds in which a first graph is refined; one round follows each iteration.
const GRAPH_ROUNDS: usize = 6;

/// Most iterations of k-means.
const ITERATIONS: usize = 12;

/// Relative decrease of the error in an iteration below which it ends.
const DECREASE_MIN: f64 = 1e-3;

/// Fraction of the entries by which the first clusters are more: merging heals splits in the wrong place.
const EXCESS_DIVISOR: usize = 2;

/// Palette of vectors.
pub(super) struct FittedPalette {
    /// `[entry][number]`.
    pub(super) centroids: Vec<f32>,
    /// Entry of each vector.
    pub(super) labels: Vec<u32>,
    graph: Graph,
}

/// Nearest other centroids of each.
type Graph = Vec<Box<[u32]>>;

/// Palette of at most `count` entries with the least weighted sum of squared distances found. The same vectors give the
/// same palette on any number of threads.
pub(super) fn fit(vectors: &Vectors, count: usize) -> FittedPalette {
    let (cells, labels) = cells(vectors, count + count / EXCESS_DIVISOR);
    // Of known length: a vector that grows may take twice the room.
    let mut centroids = Vec::with_capacity(cells.len() * vectors.length);
    cells.into_iter().for_each(|cell| centroids.extend(cell.mean));
    let mut palette = FittedPalette {
        centroids,
        labels,
        graph: Graph::new(),
    };
    palette.graph = first_graph(&palette.centroids, vectors.length);
    for _ in 0..GRAPH_ROUNDS {
        palette.refine_graph(vectors.length);
    }
    while palette.graph.len() > count {
        palette.merge(vectors, count);
        palette.refine_graph(vectors.length);
    }
    let mut before = f64::INFINITY;
    for _ in 0..ITERATIONS {
        let error = palette.assign(vectors);
        if error.is_nan() || error >= before * (1.0 - DECREASE_MIN) {
            break;
        }
        before = error;
        palette.update(vectors);
        palette.refine_graph(vectors.length);
    }
    palette
}

/// Neighbours in the order of the tree.
fn first_graph(centroids: &[f32], length: usize) -> Graph {
    let count = centroids.len() / length;
    let half = NEIGHBOURS / 2;
    let around = |i: usize| i.saturating_sub(half)..(i + half + 1).min(count);
    let neighbours = |i: usize| around(i).filter(|&j| j != i).map(|j| j as u32).collect();
    (0..count).map(neighbours).collect()
}

impl FittedPalette {
    fn centroid(&self, entry: u32, length: usize) -> &[f32] {
        &self.centroids[entry as usize * length..][..length]
    }

    /// Replaces neighbours by nearer ones among the neighbours of neighbours, in either direction of the edges.
    fn refine_graph(&mut self, length: usize) {
        let mut reverse = vec![([0; NEIGHBOURS], 0); self.graph.len()];
        for (i, neighbours) in (0u32..).zip(&self.graph) {
            for &j in neighbours {
                let (list, count) = &mut reverse[j as usize];
                if *count < NEIGHBOURS {
                    list[*count] = i;
                    *count += 1;
                }
            }
        }
        let near = |i: u32| {
            let (list, count) = &reverse[i as usize];
            self.graph[i as usize].iter().chain(&list[..*count])
        };
        let refined = (0..self.graph.len() as u32).into_par_iter().map(|i| {
            let mut found: Vec<u32> = near(i).copied().collect();
            found.extend(near(i).flat_map(|&j| near(j)));
            found.sort_unstable();
            found.dedup();
            let own = self.centroid(i, length);
            let mut ranked: Vec<(f32, u32)> = found
                .into_iter()
                .filter(|&j| j != i)
                .map(|j| (distance2(own, self.centroid(j, length)), j))
                .collect();
            ranked.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            ranked.truncate(NEIGHBOURS);
            // By reference: a vector collected in place would keep the room of all candidates.
            ranked.iter().map(|(_, j)| *j).collect()
        });
        self.graph = refined.collect();
    }

    /// Merges pairs of neighbours where it raises the error least (Ward 1963), each entry at most once, until `count`
    /// remain or no pair is left.
    fn merge(&mut self, vectors: &Vectors, count: usize) {
        let (length, entries) = (vectors.length, self.graph.len());
        let weights = self.entry_weights(vectors);
        let ranked = (0..entries as u32).into_par_iter().filter_map(|i| {
            let costs = self.graph[i as usize].iter().map(|&j| {
                let (a, b) = (f64::from(weights[i as usize]), f64::from(weights[j as usize]));
                let distance = distance2(self.centroid(i, length), self.centroid(j, length));
                (a * b / (a + b).max(f64::MIN_POSITIVE) * f64::from(distance), j)
            });
            let (cost, j) = costs.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))?;
            Some((cost, i, j))
        });
        let mut ranked: Vec<(f64, u32, u32)> = ranked.collect();
        ranked.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        // Half of a large excess at a time: a merged entry may be the cheapest to merge again.
        let excess = match entries - count {
            few if few <= count / 16 => few,
            many => many.div_ceil(2),
        };
        let mut partner: Vec<Option<u32>> = vec![None; entries];
        let mut merged = 0;
        for (_, i, j) in ranked {
            if merged < excess && partner[i as usize].is_none() && partner[j as usize].is_none() {
                (partner[i as usize], partner[j as usize]) = (Some(j), Some(i));
                merged += 1;
            }
        }
        let is_kept = |i: usize| partner[i].is_none_or(|j| i < j as usize);
        let kept: Vec<usize> = (0..entries).filter(|&i| is_kept(i)).collect();
        let mut number_of = vec![0; entries];
        for (number, &i) in (0u32..).zip(&kept) {
            number_of[i] = number;
            if let Some(j) = partner[i] {
                number_of[j as usize] = number;
                let share = weights[j as usize] / (weights[i] + weights[j as usize]).max(f32::MIN_POSITIVE);
                for k in 0..length {
                    let (a, b) = (self.centroids[i * length + k], self.centroids[j as usize * length + k]);
                    self.centroids[i * length + k] = a + share * (b - a);
                }
            }
        }
        let lists = kept.iter().map(|&i| {
            let own = partner[i].map_or(&[][..], |j| &self.graph[j as usize]);
            let both = self.graph[i].iter().chain(own).map(|&j| number_of[j as usize]);
            let mut list: Vec<u32> = both.filter(|&j| j != number_of[i]).collect();
            list.sort_unstable();
            list.dedup();
            list.into_boxed_slice()
        });
        self.graph = lists.collect();
        for (number, &i) in kept.iter().enumerate() {
            self.centroids
                .copy_within(i * length..(i + 1) * length, number * length);
        }
        self.centroids.truncate(kept.len() * length);
        self.centroids.shrink_to_fit();
        self.labels
            .iter_mut()
            .for_each(|label| *label = number_of[*label as usize]);
    }

    /// Squared distance and entry of the nearest centroid reached from an entry along the graph.
    fn nearest(&self, row: &[f32], start: u32) -> (f32, u32) {
        let mut best = (distance2(row, self.centroid(start, row.len())), start);
        loop {
            let from = best.1;
            for &entry in &self.graph[from as usize] {
                let distance = distance2(row, self.centroid(entry, row.len()));
                if distance < best.0 {
                    best = (distance, entry);
                }
            }
            if best.1 == from {
                return best;
            }
        }
    }

    /// Moves every vector to the nearest centroid reached along the graph; returns the weighted sum of squared
    /// distances.
    pub(super) fn assign(&mut self, vectors: &Vectors) -> f64 {
        let mut labels = std::mem::take(&mut self.labels);
        let distances = labels.par_iter_mut().enumerate().map(|(i, label)| {
            let (distance, nearest) = self.nearest(vectors.row(i), *label);
            *label = nearest;
            distance
        });
        let distances: Vec<f32> = distances.collect();
        self.labels = labels;
        let errors = distances.iter().zip(vectors.weights);
        errors
            .map(|(distance, weight)| f64::from(*distance) * f64::from(*weight))
            .sum()
    }

    /// Moves every centroid to the mean of its vectors, and those without any to the vectors of largest error.
    fn update(&mut self, vectors: &Vectors) {
        let length = vectors.length;
        let members = Members::new(&self.labels, self.graph.len());
        let rows = self.centroids.par_chunks_exact_mut(length).enumerate();
        let free = rows.filter_map(|(entry, centroid)| {
            let mut sum = vec![0.0f64; length];
            let mut weight = 0.0;
            for &i in members.of(entry) {
                let w = f64::from(vectors.weights[i as usize]);
                weight += w;
                sum.iter_mut()
                    .zip(vectors.row(i as usize))
                    .for_each(|(s, v)| *s += w * f64::from(*v));
            }
            if weight > 0.0 {
                centroid.iter_mut().zip(sum).for_each(|(c, s)| *c = (s / weight) as f32);
            }
            (weight <= 0.0).then_some(entry)
        });
        let free: Vec<usize> = free.collect();
        if free.is_empty() {
            return;
        }
        let mut errors: Vec<(f32, u32)> = (0..vectors.len())
            .map(|i| {
                let distance = distance2(vectors.row(i), self.centroid(self.labels[i], length));
                (distance * vectors.weights[i], i as u32)
            })
            .filter(|(error, _)| *error > 0.0)
            .collect();
        errors.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        for (entry, (_, i)) in free.into_iter().zip(errors) {
            let i = i as usize;
            self.centroids[entry * length..][..length].copy_from_slice(vectors.row(i));
            // The vector itself leads the search of its neighbours to the new place.
            let neighbours = self.graph[self.labels[i] as usize].clone();
            self.graph[entry] = neighbours;
            self.labels[i] = entry as u32;
        }
    }

    /// Weight of the vectors of each entry.
    pub(super) fn entry_weights(&self, vectors: &Vectors) -> Vec<f32> {
        let mut weights = vec![0.0; self.graph.len()];
        for (label, weight) in self.labels.iter().zip(vectors.weights) {
            weights[*label as usize] += weight;
        }
        weights
    }
}

/// Vectors of each entry.
struct Members {
    starts: Vec<usize>,
    list: Vec<u32>,
}

impl Members {
    fn new(labels: &[u32], count: usize) -> Members {
        let mut starts = vec![0; count + 1];
        labels.iter().for_each(|&label| starts[label as usize + 1] += 1);
        for entry in 0..count {
            starts[entry + 1] += starts[entry];
        }
        let mut next = starts.clone();
        let mut list = vec![0; labels.len()];
        for (i, &label) in (0u32..).zip(labels) {
            let slot = &mut next[label as usize];
            list[*slot] = i;
            *slot += 1;
        }
        Members { starts, list }
    }

    fn of(&self, entry: usize) -> &[u32] {
        &self.list[self.starts[entry]..self.starts[entry + 1]]
    }
}
