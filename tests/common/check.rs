//! Judges what a kernel wrote by what the oracle says, and judges the judgement: every output is falsified
//! once, and a comparison that lets that pass fails the test.

#![allow(
    dead_code,
    unreachable_pub,
    reason = "shared by test binaries, each of which uses its own part"
)]

use ashfall::gpu::{Buffer, Gpu};
use ashfall::layout::DispatchArgs;
use bytemuck::Pod;
use std::collections::BTreeMap;

/// How near is near enough.
#[derive(Clone, Debug)]
pub enum Comparator {
    /// The same number.
    Exact,
    /// `|found − expected| ≤ tolerance · max(|expected|, scale)`.
    Relative {
        /// Of the larger of the expected value and `scale`.
        tolerance: f64,
        /// A magnitude below which errors count absolutely.
        scale: f64,
    },
    /// As `Relative`, but elements at a discontinuity may lie on its other side.
    Boundary {
        /// Away from discontinuities.
        tolerance: f64,
        /// As above.
        scale: f64,
        /// Which elements are at a discontinuity.
        near: Vec<bool>,
        /// How far those may be off.
        jump: f64,
        /// Share of all elements that may.
        share: f64,
    },
}

/// A buffer that a kernel wrote, as numbers, and what should stand there. NaN stands for "not written".
#[derive(Clone, Debug)]
pub struct Output {
    name: &'static str,
    found: Vec<f64>,
    expected: Vec<f64>,
    by: Comparator,
}

impl Output {
    /// To be met exactly.
    pub fn exact(name: &'static str, found: Vec<f64>, expected: Vec<f64>) -> Output {
        Output {
            name,
            found,
            expected,
            by: Comparator::Exact,
        }
    }

    /// To be met up to rounding.
    pub fn relative(
        name: &'static str,
        found: Vec<f64>,
        expected: Vec<f64>,
        tolerance: f64,
        scale: f64,
    ) -> Output {
        Output {
            name,
            found,
            expected,
            by: Comparator::Relative { tolerance, scale },
        }
    }

    /// Allows elements near a discontinuity to jump; no more than `share` of all.
    pub fn near(mut self, near: Vec<bool>, jump: f64, share: f64) -> Output {
        let (tolerance, scale) = match self.by {
            Comparator::Relative { tolerance, scale } => (tolerance, scale),
            _ => (0.0, 1.0),
        };
        self.by = Comparator::Boundary {
            tolerance,
            scale,
            near,
            jump,
            share,
        };
        self
    }

    /// The largest error in terms of `max(|expected|, scale)`, or what is wrong.
    fn judge(&self, found: &[f64]) -> Result<f64, String> {
        let expected = &self.expected;
        if found.len() != expected.len() {
            return Err(format!("{} elements, not {}", found.len(), expected.len()));
        }
        let (tolerance, scale) = match self.by {
            Comparator::Exact => (0.0, 1.0),
            Comparator::Relative { tolerance, scale }
            | Comparator::Boundary {
                tolerance, scale, ..
            } => (tolerance, scale),
        };
        let (mut worst, mut flips) = (0.0f64, 0usize);
        for (i, (&f, &e)) in found.iter().zip(expected).enumerate() {
            let same = f == e || (f.is_nan() && e.is_nan());
            let error = if same {
                0.0
            } else {
                (f - e).abs() / e.abs().max(scale)
            };
            let jump = match &self.by {
                Comparator::Boundary { near, jump, .. } if near[i] => *jump,
                _ => 0.0,
            };
            // Written so that NaN does not pass.
            if error <= tolerance {
                worst = worst.max(error);
            } else if (f - e).abs() <= jump {
                flips += 1;
            } else {
                return Err(format!("element {i} is {f:e}, not {e:e}: off by {error:e}"));
            }
        }
        if let Comparator::Boundary { share, .. } = self.by {
            if flips as f64 > share * found.len() as f64 {
                return Err(format!("{flips} of {} elements flipped", found.len()));
            }
        }
        Ok(worst)
    }

    /// Falsehoods that must be noticed: the largest element off by one percent (by one, where exactness is
    /// asked for), the last one not written, the list cut short.
    fn falsified(&self) -> Vec<Vec<f64>> {
        let near = |i: usize| matches!(&self.by, Comparator::Boundary { near, .. } if near[i]);
        let sound = (0..self.found.len()).filter(|&i| !near(i) && self.expected[i].is_finite());
        let magnitude = |i: usize| self.expected[i].abs();
        let Some(largest) = sound.max_by(|&a, &b| magnitude(a).total_cmp(&magnitude(b))) else {
            return Vec::new();
        };
        let step = match self.by {
            Comparator::Exact => 1.0,
            Comparator::Relative { scale, .. } | Comparator::Boundary { scale, .. } => {
                0.01 * magnitude(largest).max(scale)
            }
        };
        let (mut off, mut gone, mut short) =
            (self.found.clone(), self.found.clone(), self.found.clone());
        off[largest] += step;
        gone[largest] = f64::NAN;
        short.pop();
        vec![off, gone, short]
    }
}

/// The checks of one kernel.
pub struct Check {
    kernel: &'static str,
    /// By output: the largest error, and whether it has been falsified.
    seen: BTreeMap<&'static str, (f64, bool)>,
}

impl Check {
    /// Nothing checked yet.
    pub fn new(kernel: &'static str) -> Check {
        Check {
            kernel,
            seen: BTreeMap::new(),
        }
    }

    /// Compares the outputs of one run and then falsifies them.
    #[track_caller]
    pub fn outputs(&mut self, case: &str, outputs: Vec<Output>) {
        for output in outputs {
            let (kernel, name) = (self.kernel, output.name);
            let worst = output
                .judge(&output.found)
                .unwrap_or_else(|fault| panic!("{kernel}, {case}: {name}: {fault}"));
            let falsified = output.falsified();
            let entry = self.seen.entry(name).or_default();
            entry.0 = entry.0.max(worst);
            entry.1 |= !falsified.is_empty();
            for lie in falsified {
                assert!(
                    output.judge(&lie).is_err(),
                    "{kernel}, {case}: {name}: the check does not notice a falsehood"
                );
            }
        }
    }

    /// Says how large errors were; every output must have been falsified in some case.
    #[track_caller]
    pub fn finish(self) {
        assert!(!self.seen.is_empty(), "{}: nothing checked", self.kernel);
        for (name, (worst, falsified)) in self.seen {
            println!("{:20} {name:24} largest error {worst:.1e}", self.kernel);
            assert!(falsified, "{}: {name} was empty in every case", self.kernel);
        }
    }
}

/// The words of an array as numbers. Fresh buffers hold [`UNWRITTEN`], which becomes NaN.
pub fn words<T: Pod>(data: &[T]) -> Vec<f64> {
    let number = |&word: &u32| match word {
        UNWRITTEN => f64::NAN,
        _ => f64::from(word),
    };
    bytemuck::cast_slice(data).iter().map(number).collect()
}

/// The floats of an array as numbers.
pub fn floats<T: Pod>(data: &[T]) -> Vec<f64> {
    let floats: &[f32] = bytemuck::cast_slice(data);
    floats.iter().map(|&x| f64::from(x)).collect()
}

/// What fresh buffers are filled with when validation is on: a NaN as a float.
pub const UNWRITTEN: u32 = 0x7FC0_DEAD;

/// The root of the mean of the squares of what is finite.
pub fn rms(values: &[f64]) -> f64 {
    let finite = || values.iter().filter(|x| x.is_finite());
    (finite().map(|x| x * x).sum::<f64>() / finite().count().max(1) as f64).sqrt()
}

/// A buffer that holds `data`.
pub fn buffer<T: Pod>(gpu: &Gpu, data: &[T]) -> Buffer<T> {
    gpu.buffer_from("input", data).expect("no room for a test")
}

/// A buffer for `len` elements that nobody has written.
pub fn unwritten<T: Pod>(gpu: &Gpu, len: usize) -> Buffer<T> {
    gpu.buffer("output", len).expect("no room for a test")
}

/// All of a buffer.
pub fn read<T: Pod>(gpu: &Gpu, buffer: &Buffer<T>) -> Vec<T> {
    gpu.download(buffer, 0..buffer.len())
        .expect("cannot read back")
}

/// The slots of `counts`, with some of them set.
pub fn counts(gpu: &Gpu, slots: &[(u32, u32)]) -> Buffer<u32> {
    let mut counts = [0; ashfall::layout::COUNT_SLOTS as usize];
    for &(slot, value) in slots {
        counts[slot as usize] = value;
    }
    buffer(gpu, &counts)
}

/// Arguments of one indirect dispatch: one invocation for each of `count` elements.
pub fn args(gpu: &Gpu, count: usize, workgroup: u32) -> Buffer<DispatchArgs> {
    let x = (count as u32).div_ceil(workgroup);
    let y = u32::from(x > 0);
    buffer(gpu, &[DispatchArgs { x, y, z: 1 }])
}
