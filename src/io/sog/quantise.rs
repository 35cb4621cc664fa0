//! Quantisation of a scene: every code is the one nearest to its value.

use super::codebook::{self, nearest};
use super::codes::{QUATERNION_TAG, SogCodes, SogPalette, numbers_of};
use super::palette;
use super::tree::Vectors;
use crate::scene::{Splats, sigmoid};
use rayon::prelude::*;

/// Choices of [`SogCodes::quantise`].
#[derive(Clone, Copy, Debug, Default)]
pub struct SogOptions<'a> {
    /// Most entries of the palette of harmonics, 1 to 65,536; `None` for splat-transform's rule:
    /// 1024 · min(64, 2^⌊log₂(n / 1024)⌋) for n splats, 512 below 1024 splats.
    pub palette_entries: Option<usize>,
    /// Importance of each splat in the fit of codebooks and palette, not negative, in any unit; `None` for equal ones.
    /// Each is raised by a thousandth of their mean, so that none is free.
    pub weights: Option<&'a [f32]>,
}

impl SogCodes {
    /// Quantises a scene. Splats are put in Morton order of their means, so that neighbours in the images are
    /// neighbours in space; those with numbers that are not finite are left out, and the origin is. Means, rotations
    /// and opacities are rounded to the nearest code. Codebooks have the least squared error of all, the palette the
    /// least that k-means finds.
    ///
    /// # Panics
    /// There are weights, but not one for each splat.
    pub fn quantise(splats: &Splats, options: &SogOptions) -> SogCodes {
        if let Some(weights) = options.weights {
            assert_eq!(weights.len(), splats.len(), "a weight for each splat");
        }
        let means = MeanCodes::new(splats);
        let order = means.order;
        let weights = weights(options.weights, &order);
        let (scale_codebook, color_codebook) = rayon::join(
            || codebook::fit(repeated(order.iter().map(|&i| splats.log_scale[i as usize]), &weights)),
            || codebook::fit(repeated(order.iter().map(|&i| constant(splats, i)), &weights)),
        );
        let palette = palette_of(splats, &order, &weights, options.palette_entries);
        let color = |&i: &u32| {
            let [r, g, b] = constant(splats, i).map(|c| nearest(&color_codebook, c));
            let opacity = sigmoid(splats.opacity_logit[i as usize].into());
            [r, g, b, (255.0 * opacity).round() as u8]
        };
        let scale = |&i: &u32| splats.log_scale[i as usize].map(|s| nearest(&scale_codebook, s));
        let quaternion = order
            .par_iter()
            .map(|&i| nearest_rotation(splats.quaternion[i as usize]));
        SogCodes {
            mean: means.codes,
            mean_min: means.min,
            mean_max: means.max,
            quaternion: quaternion.collect(),
            scale: order.par_iter().map(scale).collect(),
            color: order.par_iter().map(color).collect(),
            scale_codebook,
            color_codebook,
            palette,
            filter: splats.filter,
            order,
        }
    }

    /// Fits the codebook of the harmonics of degree 0 anew, to those of a scene in the order of the one quantised.
    ///
    /// # Panics
    /// If `splats` are fewer.
    pub fn set_colors(&mut self, splats: &Splats) {
        let weights = vec![1.0; self.order.len()];
        let colors = self.order.iter().map(|&i| constant(splats, i));
        self.color_codebook = codebook::fit(repeated(colors, &weights));
        for (codes, &i) in self.color.iter_mut().zip(&self.order) {
            let [r, g, b] = constant(splats, i).map(|c| nearest(&self.color_codebook, c));
            *codes = [r, g, b, codes[3]];
        }
    }
}

/// Codes of the means in Morton order.
struct MeanCodes {
    codes: Vec<[u16; 3]>,
    /// Index of each splat in the scene.
    order: Vec<u32>,
    /// Logarithm of code 0 along each axis.
    min: [f64; 3],
    /// Logarithm of code 65535 along each axis.
    max: [f64; 3],
}

impl MeanCodes {
    fn new(splats: &Splats) -> MeanCodes {
        let sound = (0..splats.len() as u32).filter(|&i| splats.is_finite(i as usize));
        let sound: Vec<u32> = sound.collect();
        let logarithms = |i: u32| splats.mean[i as usize].map(logarithmic);
        let (min, max) = bounds(sound.iter().map(|&i| logarithms(i)));
        let code = |&i: &u32| {
            let t = logarithms(i);
            let codes = [0, 1, 2].map(|axis| nearest_mean(t[axis], min[axis], max[axis]));
            (morton(codes), i, codes)
        };
        let mut coded: Vec<(u64, u32, [u16; 3])> = sound.par_iter().map(code).collect();
        coded.par_sort_unstable();
        MeanCodes {
            codes: coded.iter().map(|(.., codes)| *codes).collect(),
            order: coded.iter().map(|(_, i, _)| *i).collect(),
            min,
            max,
        }
    }
}

/// Harmonics of degree 0 of a splat.
fn constant(splats: &Splats, i: u32) -> [f32; 3] {
    let start = i as usize * splats.sh_stride();
    [splats.sh[start], splats.sh[start + 1], splats.sh[start + 2]]
}

/// sign(v) ln(1 + |v|).
fn logarithmic(value: f32) -> f64 {
    let value = f64::from(value);
    value.abs().ln_1p().copysign(value)
}

/// Least and largest values along each axis; zeros without values.
fn bounds(values: impl Iterator<Item = [f64; 3]> + Clone) -> ([f64; 3], [f64; 3]) {
    let fold = |pick: fn(f64, f64) -> f64| {
        let combined = |a: [f64; 3], b: [f64; 3]| [0, 1, 2].map(|axis| pick(a[axis], b[axis]));
        values.clone().reduce(combined).unwrap_or_default()
    };
    (fold(f64::min), fold(f64::max))
}

fn nearest_mean(t: f64, min: f64, max: f64) -> u16 {
    match max > min {
        true => (65_535.0 * (t - min) / (max - min)).round() as u16,
        false => 0,
    }
}

/// Bits of the three codes in turn.
fn morton(codes: [u16; 3]) -> u64 {
    let spread = |code: u16| (0..16).fold(0u64, |sum, bit| sum | (u64::from(code) >> bit & 1) << (3 * bit));
    let [x, y, z] = codes.map(spread);
    x | y << 1 | z << 2
}

/// Bytes of a rotation of any length; none for length zero.
fn nearest_rotation(quaternion: [f32; 4]) -> [u8; 4] {
    let q = quaternion.map(f64::from);
    let longest = q.iter().fold(0.0f64, |longest, v| longest.max(v.abs()));
    if longest <= 0.0 {
        return [128, 128, 128, QUATERNION_TAG];
    }
    let q = q.map(|v| v / longest);
    let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
    let largest = (0..4)
        .rev()
        .max_by(|&a, &b| q[a].abs().total_cmp(&q[b].abs()))
        .unwrap_or(0);
    let factor = std::f64::consts::SQRT_2.copysign(q[largest]) / length;
    let mut bytes = [0, 0, 0, QUATERNION_TAG + largest as u8];
    let others = (0..4).filter(|&i| i != largest);
    for (byte, i) in bytes.iter_mut().zip(others) {
        *byte = (127.5 * (q[i] * factor + 1.0)).round() as u8;
    }
    bytes
}

/// Weights in a given order, with a mean of one.
fn weights(given: Option<&[f32]>, order: &[u32]) -> Vec<f32> {
    let Some(given) = given else {
        return vec![1.0; order.len()];
    };
    let sound = |i: &u32| f64::from(given[*i as usize]).clamp(0.0, 1e30);
    let mean = order.iter().map(sound).sum::<f64>() / order.len().max(1) as f64;
    if mean <= 0.0 || mean.is_nan() {
        return vec![1.0; order.len()];
    }
    order.iter().map(|i| (sound(i) / mean + 1e-3) as f32).collect()
}

/// Three numbers of each splat with its weight.
fn repeated(numbers: impl Iterator<Item = [f32; 3]>, weights: &[f32]) -> Vec<(f32, f32)> {
    let mut all = Vec::with_capacity(3 * weights.len());
    for (three, weight) in numbers.zip(weights) {
        all.extend(three.map(|number| (number, *weight)));
    }
    all
}

/// Entries of splat-transform's palette for a number of splats.
pub fn usual_entries(count: usize) -> usize {
    match count / 1024 {
        0 => 512,
        thousands => 1024 * (1 << thousands.ilog2().min(6)),
    }
}

fn palette_of(splats: &Splats, order: &[u32], weights: &[f32], entries: Option<usize>) -> Option<SogPalette> {
    let numbers = numbers_of(splats.sh_degree);
    if numbers == 0 || order.is_empty() {
        return None;
    }
    let entries = entries.unwrap_or(usual_entries(order.len())).clamp(1, 1 << 16);
    let vectors = Vectors {
        stride: splats.sh_stride(),
        length: numbers,
        numbers: &splats.sh,
        order,
        weights,
    };
    let mut palette = palette::fit(&vectors, entries);
    let entry_weights = palette.entry_weights(&vectors);
    let rows = || palette.centroids.chunks_exact(numbers);
    let weighted = rows().zip(&entry_weights).filter(|(_, weight)| **weight > 0.0);
    let weighted = weighted.flat_map(|(row, weight)| row.iter().map(|v| (*v, *weight)));
    let mut coefficients = Vec::with_capacity(palette.centroids.len());
    coefficients.extend(weighted);
    let codebook = codebook::fit(coefficients);
    // Vectors choose among the entries as they will be read.
    let codes: Vec<Vec<u8>> = rows()
        .map(|row| row.iter().map(|v| nearest(&codebook, *v)).collect())
        .collect();
    for (row, codes) in palette.centroids.chunks_exact_mut(numbers).zip(&codes) {
        row.iter_mut()
            .zip(codes)
            .for_each(|(v, code)| *v = codebook[usize::from(*code)]);
    }
    palette.assign(&vectors);
    let (labels, used) = in_order_of_use(&palette.labels, codes.len());
    Some(SogPalette {
        sh_degree: splats.sh_degree,
        codebook,
        centroids: used.iter().flat_map(|&entry| &codes[entry]).copied().collect(),
        labels,
    })
}

/// Entries numbered by their first use, the others left out: labels then grow along the file, and neighbours in the
/// palette are neighbours in space.
fn in_order_of_use(labels: &[u32], count: usize) -> (Vec<u16>, Vec<usize>) {
    let mut number_of = vec![None; count];
    let mut used = Vec::new();
    let labels = labels.iter().map(|&label| {
        *number_of[label as usize].get_or_insert_with(|| {
            used.push(label as usize);
            (used.len() - 1) as u16
        })
    });
    (labels.collect(), used)
}
