//! Comparison of a kernel's outputs with the oracle's, for tests and before every timing.

use bytemuck::Pod;

/// A buffer written by a kernel, as numbers, with the expected values. NaN stands for "not written".
///
/// Elements agree if `|found − expected| ≤ tolerance · max(|expected|, scale)`.
#[derive(Clone, Debug)]
pub struct Output {
    /// Name of the output.
    pub name: &'static str,
    found: Vec<f64>,
    expected: Vec<f64>,
    /// Relative to the larger of the expected value and `scale`; 0: equal numbers.
    tolerance: f64,
    /// Magnitude below which errors count absolutely.
    scale: f64,
    /// Flags of the elements at a discontinuity, which may lie on its other side; empty: none.
    near: Vec<bool>,
    /// Largest absolute error of those.
    jump: f64,
    /// Largest share of all elements beyond the tolerance.
    share: f64,
}

impl Output {
    /// Output to be equal.
    pub fn exact(name: &'static str, found: Vec<f64>, expected: Vec<f64>) -> Output {
        Output::relative(name, found, expected, 0.0, 1.0)
    }

    /// Output to be equal up to rounding.
    pub fn relative(name: &'static str, found: Vec<f64>, expected: Vec<f64>, tolerance: f64, scale: f64) -> Output {
        Output {
            name,
            found,
            expected,
            tolerance,
            scale,
            near: Vec::new(),
            jump: 0.0,
            share: 0.0,
        }
    }

    /// Allows elements near a discontinuity to jump; no more than `share` of all.
    pub fn near(self, near: Vec<bool>, jump: f64, share: f64) -> Output {
        Output {
            near,
            jump,
            share,
            ..self
        }
    }

    /// The largest error in units of `max(|expected|, scale)`, or a message about the first fault.
    pub fn judge(&self) -> Result<f64, String> {
        self.accepts(&self.found)
    }

    /// [`Output::judge`] for `found` as the kernel's output.
    pub fn accepts(&self, found: &[f64]) -> Result<f64, String> {
        let expected = &self.expected;
        if found.len() != expected.len() {
            return Err(format!("{} elements, not {}", found.len(), expected.len()));
        }
        let (mut worst, mut flips) = (0.0f64, 0usize);
        for (i, (&f, &e)) in found.iter().zip(expected).enumerate() {
            let same = f == e || (f.is_nan() && e.is_nan());
            let error = if same {
                0.0
            } else {
                (f - e).abs() / e.abs().max(self.scale)
            };
            let jump = if self.is_near(i) { self.jump } else { 0.0 };
            // Written so that NaN fails.
            if error <= self.tolerance {
                worst = worst.max(error);
            } else if (f - e).abs() <= jump {
                flips += 1;
            } else {
                return Err(format!("element {i} is {f:e}, not {e:e}: off by {error:e}"));
            }
        }
        if flips as f64 > self.share * found.len() as f64 {
            return Err(format!("{flips} of {} elements flipped", found.len()));
        }
        Ok(worst)
    }

    fn is_near(&self, i: usize) -> bool {
        !self.near.is_empty() && self.near[i]
    }

    /// Wrong outputs that must be detected: the largest element off by one percent (by one for exact comparison), the
    /// last one not written, the list truncated.
    pub fn falsified(&self) -> Vec<Vec<f64>> {
        let sound = (0..self.found.len()).filter(|&i| !self.is_near(i) && self.expected[i].is_finite());
        let magnitude = |i: usize| self.expected[i].abs();
        let Some(largest) = sound.max_by(|&a, &b| magnitude(a).total_cmp(&magnitude(b))) else {
            return Vec::new();
        };
        let step = match self.tolerance == 0.0 && self.near.is_empty() {
            true => 1.0,
            false => 0.01 * magnitude(largest).max(self.scale),
        };
        let (mut off, mut gone, mut short) = (self.found.clone(), self.found.clone(), self.found.clone());
        off[largest] += step;
        gone[largest] = f64::NAN;
        short.pop();
        vec![off, gone, short]
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

/// Fill of fresh buffers with validation on: a NaN as a float.
pub const UNWRITTEN: u32 = 0x7FC0_DEAD;

/// Root mean square of the finite values.
pub fn rms(values: &[f64]) -> f64 {
    let finite = || values.iter().filter(|x| x.is_finite());
    (finite().map(|x| x * x).sum::<f64>() / finite().count().max(1) as f64).sqrt()
}
