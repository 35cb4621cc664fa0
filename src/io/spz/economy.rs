//! Rate-distortion optimisation of codes: those that compress better, at the price of small errors.
//!
//! The bytes of an attribute are compressed by a Huffman code of their own statistics: frequent values are cheap. Each
//! splat takes those codes near its values for which error and price of the bits have the least sum. The statistics
//! follow the choice, and a few passes settle both. A rotation has 24 equivalents, by permutations of the axes.

use super::codes::SpzCodes;
use super::steps::{self, ROTATION_SHIFTS};
use crate::scene::{Axes, Splats, sigmoid};
use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;

/// Costs of a splat's errors and bits, in a common unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CodeCosts {
    /// Of a squared world unit of distance.
    pub position: f64,
    /// Of a squared unit of distance between quaternions of length 1.
    pub rotation: f64,
    /// Of a squared unit of a harmonic of degree 0.
    pub color: f64,
    /// Of a squared unit of opacity.
    pub opacity: f64,
    /// Of a bit.
    pub bit: f64,
}

/// Passes over splats, after each of which prices follow.
const PASSES: usize = 5;

/// Splats on which prices settle, at most.
const SAMPLE: usize = 50_000;

/// Largest distance of a code in a pass.
const REACH: i32 = 4;

impl SpzCodes {
    /// Exchanges codes of `splats`, which are in RDF axes, for cheaper ones by the costs of each splat. Scales change
    /// places with the axes of their splat.
    ///
    /// # Panics
    /// If the number of splats is another.
    pub fn economize(&mut self, splats: &Splats, costs: impl Fn(usize) -> CodeCosts + Sync) {
        assert_eq!(splats.len(), self.len(), "splats of the codes");
        let mut splats = splats.clone();
        splats.change_axes(Axes::RDF, self.axes);
        self.economize_positions(&splats, &costs);
        self.economize_colors(&splats, &costs);
        settle(
            &mut self.alpha,
            |alpha| [*alpha],
            |i, code, prices| {
                let CodeCosts { opacity, bit, .. } = costs(i);
                let value = sigmoid(f64::from(splats.opacity_logit[i]));
                let cost = |code: u8| {
                    let error = f64::from(code) / 255.0 - value;
                    opacity * error * error + bit * prices.of(&[code])
                };
                least(near(code), cost).unwrap_or(code)
            },
        );
        self.economize_rotations(&splats, costs);
    }

    fn economize_positions(&mut self, splats: &Splats, costs: impl Fn(usize) -> CodeCosts + Sync) {
        let bits = self.fractional_bits;
        settle(&mut self.position, position_bytes, |i, codes, prices| {
            let CodeCosts { position, bit, .. } = costs(i);
            std::array::from_fn(|axis| {
                let value = f64::from(splats.mean[i][axis]);
                let cost = |code: i32| {
                    let error = f64::from(steps::position(code, bits)) - value;
                    position * error * error + bit * prices.of(&low_bytes(code))
                };
                let near = (codes[axis] - REACH..=codes[axis] + REACH).filter(|code| steps::is_position(*code));
                least(near, cost).unwrap_or(codes[axis])
            })
        });
    }

    fn economize_colors(&mut self, splats: &Splats, costs: impl Fn(usize) -> CodeCosts + Sync) {
        let stride = splats.sh_stride();
        settle(
            &mut self.color,
            |color| *color,
            |i, codes, prices| {
                let CodeCosts { color, bit, .. } = costs(i);
                std::array::from_fn(|channel| {
                    let value = f64::from(splats.sh[i * stride + channel]);
                    let cost = |code: u8| {
                        let error = f64::from(steps::color(code)) - value;
                        color * error * error + bit * prices.of(&[code])
                    };
                    least(near(codes[channel]), cost).unwrap_or(codes[channel])
                })
            },
        );
    }

    /// Exchanges rotations, and the places of scales, for cheaper ones.
    fn economize_rotations(&mut self, splats: &Splats, costs: impl Fn(usize) -> CodeCosts + Sync) {
        let permutations = axis_permutations();
        let mut shapes: Vec<(u32, [u8; 3])> = self.rotation.iter().copied().zip(self.scale.iter().copied()).collect();
        let given = shapes.clone();
        settle(
            &mut shapes,
            |shape| shape.0.to_le_bytes(),
            |i, shape, prices| {
                let CodeCosts { rotation, bit, .. } = costs(i);
                let q = quaternion(splats.quaternion[i]);
                if !q.is_normalized() {
                    return shape;
                }
                let equivalents = permutations.iter().map(|permutation| {
                    let turned = q * permutation.turn;
                    let cost = |code: u32| {
                        let cosine = turned.dot(quaternion(steps::rotation(code))).abs();
                        rotation * (2.0 - 2.0 * cosine) + bit * prices.of(&code.to_le_bytes())
                    };
                    let [x, y, z, w] = turned.to_array().map(|v| v as f32);
                    let mut code = steps::rotation_code([w, x, y, z]);
                    for shift in ROTATION_SHIFTS {
                        code = least(steps::rotations_near(code, shift, REACH), cost).unwrap_or(code);
                    }
                    (cost(code), code, permutation.axis)
                });
                let cheapest = equivalents.min_by(|a, b| a.0.total_cmp(&b.0));
                cheapest.map_or(shape, |(_, code, axes)| (code, axes.map(|axis| given[i].1[axis])))
            },
        );
        self.rotation = shapes.iter().map(|shape| shape.0).collect();
        self.scale = shapes.iter().map(|shape| shape.1).collect();
    }
}

/// Permutation of a splat's axes with signs: a rotation of the cube, which leaves the covariance as it is.
struct AxisPermutation {
    turn: DQuat,
    /// Former index of each axis.
    axis: [usize; 3],
}

/// All 24.
fn axis_permutations() -> Vec<AxisPermutation> {
    let units = [DVec3::X, DVec3::Y, DVec3::Z, -DVec3::X, -DVec3::Y, -DVec3::Z];
    let pairs = units.iter().flat_map(|&x| units.iter().map(move |&y| (x, y)));
    let across = pairs.filter(|(x, y)| x.dot(*y) == 0.0);
    let permutations = across.map(|(x, y)| {
        let turn = DMat3::from_cols(x, y, x.cross(y));
        AxisPermutation {
            turn: DQuat::from_mat3(&turn),
            axis: [turn.x_axis, turn.y_axis, turn.z_axis].map(|axis| axis.abs().max_position()),
        }
    });
    permutations.collect()
}

/// Quaternion of length 1 from w, x, y, z; NaN from zero.
fn quaternion(wxyz: [f32; 4]) -> DQuat {
    let [w, x, y, z] = wxyz.map(f64::from);
    DQuat::from_xyzw(x, y, z, w).normalize()
}

/// Codes near one.
fn near(code: u8) -> impl Iterator<Item = u8> {
    (-REACH..=REACH).filter_map(move |by| u8::try_from(i32::from(code) + by).ok())
}

/// Candidate of the least cost, the first of equal ones.
fn least<C: Copy>(candidates: impl Iterator<Item = C>, cost: impl Fn(C) -> f64) -> Option<C> {
    let costs = candidates.map(|candidate| (cost(candidate), candidate));
    costs.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, candidate)| candidate)
}

/// Bytes of a position's code in a file.
fn low_bytes(code: i32) -> [u8; 3] {
    let [a, b, c, _] = code.to_le_bytes();
    [a, b, c]
}

fn position_bytes(codes: &[i32; 3]) -> [u8; 9] {
    let bytes = codes.map(low_bytes);
    std::array::from_fn(|i| bytes[i / 3][i % 3])
}

/// Bits of each byte of a stream.
struct BytePrices([f64; 256]);

impl BytePrices {
    fn new(bytes: impl Iterator<Item = u8>) -> BytePrices {
        let mut counts = [0.5; 256];
        bytes.for_each(|byte| counts[usize::from(byte)] += 1.0);
        let total: f64 = counts.iter().sum();
        BytePrices(counts.map(|count: f64| (total / count).log2().min(LONGEST_CODE)))
    }

    fn of(&self, bytes: &[u8]) -> f64 {
        bytes.iter().map(|&byte| self.0[usize::from(byte)]).sum()
    }
}

/// Longest code of a byte in zstd, bits.
const LONGEST_CODE: f64 = 11.0;

/// Lets `choose` replace each code by the prices of all, which settle on a sample.
fn settle<C: Copy + Send + Sync, const N: usize>(
    codes: &mut [C],
    bytes: impl Fn(&C) -> [u8; N],
    choose: impl Fn(usize, C, &BytePrices) -> C + Sync,
) {
    let stride = codes.len().div_ceil(SAMPLE).max(1);
    let mut sample: Vec<C> = codes.iter().step_by(stride).copied().collect();
    for _ in 1..PASSES {
        let prices = BytePrices::new(sample.iter().flat_map(&bytes));
        let rows = sample.par_iter_mut().enumerate();
        rows.for_each(|(i, code)| *code = choose(i * stride, *code, &prices));
    }
    for (code, settled) in codes.iter_mut().step_by(stride).zip(&sample) {
        *code = *settled;
    }
    let prices = BytePrices::new(sample.iter().flat_map(&bytes));
    let rows = codes.par_iter_mut().enumerate();
    rows.for_each(|(i, code)| *code = choose(i, *code, &prices));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::spz::SpzOptions;

    /// Splats of many shapes, in RDF axes.
    fn splats(count: usize) -> Splats {
        let noise = |i: usize| {
            let mixed = (i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            let mixed = (mixed ^ mixed >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            (mixed >> 40) as f32 / (1 << 23) as f32 - 1.0
        };
        let row = |i: usize| [noise(3 * i), noise(3 * i + 1), noise(3 * i + 2)];
        Splats {
            mean: (0..count).map(|i| row(i + 7)).collect(),
            quaternion: (0..count)
                .map(|i| [noise(i), noise(2 * i + 3), noise(5 * i + 1), 0.1])
                .collect(),
            log_scale: (0..count).map(|i| row(i + 11).map(|v| v - 3.0)).collect(),
            opacity_logit: (0..count).map(noise).collect(),
            sh: (0..count).flat_map(row).collect(),
            sh_degree: 0,
            ..Splats::default()
        }
    }

    fn costs(bit: f64) -> CodeCosts {
        CodeCosts {
            position: 1e4,
            rotation: 1e2,
            color: 1.0,
            opacity: 10.0,
            bit,
        }
    }

    fn covariance(splats: &Splats, i: usize) -> DMat3 {
        let rotation = DMat3::from_quat(quaternion(splats.quaternion[i]));
        let variance = splats.log_scale[i].map(|v| (2.0 * f64::from(v)).exp());
        rotation * DMat3::from_diagonal(variance.into()) * rotation.transpose()
    }

    /// Largest difference of a splat's covariance, relative to its largest entry.
    fn difference(a: &Splats, b: &Splats) -> f64 {
        let entries = |of: &Splats, i| covariance(of, i).to_cols_array();
        let relative = |i| {
            let (a, b) = (entries(a, i), entries(b, i));
            let size = a.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
            a.iter()
                .zip(b)
                .fold(0.0_f64, |most, (a, b)| most.max((a - b).abs() / size))
        };
        (0..a.len()).map(relative).fold(0.0, f64::max)
    }

    #[test]
    fn each_permutation_of_the_axes_has_the_same_covariance() {
        let permutations = axis_permutations();
        assert_eq!(permutations.len(), 24);
        let one = splats(1);
        for (i, permutation) in permutations.iter().enumerate() {
            let others = &permutations[..i];
            assert!(
                others
                    .iter()
                    .all(|other| other.turn.dot(permutation.turn).abs() < 0.999),
                "{i}"
            );
            let [x, y, z, w] = (quaternion(one.quaternion[0]) * permutation.turn)
                .to_array()
                .map(|v| v as f32);
            let permuted = Splats {
                quaternion: vec![[w, x, y, z]],
                log_scale: vec![permutation.axis.map(|axis| one.log_scale[0][axis])],
                ..one.clone()
            };
            assert!(difference(&one, &permuted) < 1e-6, "{i}");
        }
    }

    #[test]
    fn free_bits_leave_the_nearest_codes() {
        let source = splats(200);
        let nearest = SpzCodes::nearest(&source, &SpzOptions::default());
        let mut codes = nearest.clone();
        codes.economize(&source, |_| costs(0.0));
        assert_eq!(
            (&codes.position, &codes.color, &codes.alpha),
            (&nearest.position, &nearest.color, &nearest.alpha)
        );
        // A step of a rotation is √½ / 511, and scales have the same codes.
        assert!(difference(&nearest.decode(), &codes.decode()) < 0.01);
    }

    #[test]
    fn dear_bits_are_fewer_and_cost_no_more_than_they_save() {
        let source = splats(2000);
        let nearest = SpzCodes::nearest(&source, &SpzOptions::default());
        let mut codes = nearest.clone();
        let bit = 1e-3;
        codes.economize(&source, |_| costs(bit));
        let bits = |codes: &SpzCodes| 8 * codes.stream_bytes(19).expect("memory").iter().sum::<usize>();
        let error = |codes: &SpzCodes| -> f64 {
            let found = codes.decode();
            let square = |i: usize| {
                let squares =
                    |a: &[f32], b: &[f32]| -> f64 { a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum() };
                let opacity = |of: &Splats| sigmoid(of.opacity_logit[i].into());
                costs(bit).position * squares(&found.mean[i], &source.mean[i])
                    + squares(&found.sh[3 * i..][..3], &source.sh[3 * i..][..3])
                    + costs(bit).opacity * (opacity(&found) - opacity(&source)).powi(2)
            };
            (0..source.len()).map(square).sum()
        };
        let [before, after] = [&nearest, &codes].map(|codes| (bits(codes) as f64, error(codes)));
        assert!(after.0 < 0.9 * before.0, "{} of {} bits", after.0, before.0);
        assert!(after.1 - before.1 < bit * (before.0 - after.0), "{before:?}, {after:?}");
        assert!(difference(&source, &codes.decode()) < 0.2);
    }
}
