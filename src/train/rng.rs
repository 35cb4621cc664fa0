//! Random numbers as a pure function of (seed, step, index, stream), without state.
//!
//! A draw depends on its key alone, so that a resumed run, another thread count and another order of evaluation give
//! the same numbers. The mixing function is pcg4d (Jarzynski and Olano, "Hash Functions for GPU Rendering", 2020): four
//! 32-bit multiply-add rounds, the same in GLSL.

/// Purpose of a draw: draws of different streams are independent for equal (seed, step, index).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Stream {
    /// Order of the training views; the step is the epoch.
    ViewOrder = 1,
    /// Background colour of a step.
    Background = 2,
    /// Target of a relocated dead splat; the index is the dead one's ordinal.
    Relocate = 4,
    /// Source of an added splat; the index is the new one's ordinal.
    Grow = 5,
    /// Positions of splats made without points.
    RandomInit = 6,
    /// Subset of the points, if they exceed the splat limit.
    Subsample = 7,
    /// Positional noise of MCMC, drawn on the device; the index is the splat.
    Noise = 8,
    /// Splats dropped in a step, chosen on the device.
    Dropout = 9,
    /// First offset of the lattice of SSIM's windows; the index is the view.
    Window = 10,
}

/// Four independent 32-bit words for a key.
pub fn bits(seed: u64, step: u32, index: u32, stream: Stream) -> [u32; 4] {
    let [low, high] = [seed as u32, (seed >> 32) as u32];
    pcg4d([low, step, index, (stream as u32) ^ high.wrapping_mul(0x9E37_79B9)])
}

/// The mixing function, public for comparison with shaders.
pub fn pcg4d(key: [u32; 4]) -> [u32; 4] {
    let mut v = key.map(|k| k.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    cross_mix(&mut v);
    v = v.map(|x| x ^ (x >> 16));
    cross_mix(&mut v);
    v
}

fn cross_mix(v: &mut [u32; 4]) {
    v[0] = v[0].wrapping_add(v[1].wrapping_mul(v[3]));
    v[1] = v[1].wrapping_add(v[2].wrapping_mul(v[0]));
    v[2] = v[2].wrapping_add(v[0].wrapping_mul(v[1]));
    v[3] = v[3].wrapping_add(v[1].wrapping_mul(v[2]));
}

/// A word as a number in (0, 1]: 24 bits and never 0, so that its logarithm is finite.
pub fn unit(word: u32) -> f32 {
    ((word >> 8) + 1) as f32 * (1.0 / 16_777_216.0)
}

/// Four numbers in (0, 1] for a key.
pub fn uniform(seed: u64, step: u32, index: u32, stream: Stream) -> [f32; 4] {
    bits(seed, step, index, stream).map(unit)
}

/// Four independent standard normal numbers for a key (Box–Muller in `f64`: at most 5.8 in magnitude).
pub fn normal(seed: u64, step: u32, index: u32, stream: Stream) -> [f32; 4] {
    let u = uniform(seed, step, index, stream).map(f64::from);
    let pair = |a: f64, b: f64| {
        let radius = (-2.0 * a.ln()).sqrt();
        let (sin, cos) = (std::f64::consts::TAU * b).sin_cos();
        [(radius * cos) as f32, (radius * sin) as f32]
    };
    let [a, b] = pair(u[0], u[1]);
    let [c, d] = pair(u[2], u[3]);
    [a, b, c, d]
}

/// An integer in `0..bound`, with a bias below `bound` / 2⁶⁴; 0 if `bound` is 0.
pub fn below(words: [u32; 4], bound: u64) -> u64 {
    let wide = (u64::from(words[0]) << 32) | u64::from(words[1]);
    ((u128::from(wide) * u128::from(bound)) >> 64) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_gives_the_same_numbers_and_every_part_of_it_counts() {
        let a = bits(7, 100, 3, Stream::Grow);
        assert_eq!(a, bits(7, 100, 3, Stream::Grow));
        assert_ne!(a, bits(8, 100, 3, Stream::Grow));
        assert_ne!(a, bits(7 | 1 << 40, 100, 3, Stream::Grow));
        assert_ne!(a, bits(7, 101, 3, Stream::Grow));
        assert_ne!(a, bits(7, 100, 4, Stream::Grow));
        assert_ne!(a, bits(7, 100, 3, Stream::Relocate));
    }

    #[test]
    fn unit_numbers_reach_one_and_never_zero() {
        assert_eq!(unit(u32::MAX), 1.0);
        assert!(unit(0) > 0.0);
    }

    #[test]
    fn normals_have_the_moments_of_a_normal_distribution() {
        let n = 200_000_u32;
        let mut sums = [0.0_f64; 4];
        for i in 0..n {
            for x in normal(1, 2, i, Stream::Noise).map(f64::from) {
                assert!(x.is_finite());
                for (sum, power) in sums.iter_mut().zip(1..) {
                    *sum += x.powi(power);
                }
            }
        }
        let count = f64::from(n) * 4.0;
        let [mean, second, third, fourth] = sums.map(|s| s / count);
        // Four standard errors of each sample moment: variances 1, 2, 15, 96.
        assert!(mean.abs() < 4.0 * (1.0 / count).sqrt());
        assert!((second - 1.0).abs() < 4.0 * (2.0 / count).sqrt());
        assert!(third.abs() < 4.0 * (15.0 / count).sqrt());
        assert!((fourth - 3.0).abs() < 4.0 * (96.0 / count).sqrt());
    }

    #[test]
    fn integers_cover_their_range_evenly() {
        let mut histogram = [0_u32; 10];
        for i in 0..100_000 {
            histogram[below(bits(5, 0, i, Stream::Grow), 10) as usize] += 1;
        }
        assert_eq!(below([u32::MAX; 4], 0), 0);
        // Binomial: standard deviation 95.
        assert!(histogram.iter().all(|&n| n.abs_diff(10_000) < 475));
    }
}
