//! Adam (Kingma and Ba 2015, algorithm 1) on one number, and the subsequent bound on a splat's aspect.

/// The optimiser's constants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adam {
    /// Decay of the first moment.
    pub beta1: f64,
    /// Decay of the second moment.
    pub beta2: f64,
    /// Keeps the quotient finite without gradients (3DGS code: 1e-15).
    pub epsilon: f64,
}

impl Default for Adam {
    fn default() -> Adam {
        Adam {
            beta1: 0.9,
            beta2: 0.999,
            epsilon: 1e-15,
        }
    }
}

/// A parameter in training.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AdamState {
    /// The parameter.
    pub value: f64,
    /// Decayed mean of the gradients.
    pub first: f64,
    /// Decayed mean of their squares.
    pub second: f64,
}

impl Adam {
    /// State after step number `step`, counted from 1.
    pub fn step(&self, state: AdamState, gradient: f64, rate: f64, step: i32) -> AdamState {
        self.steps(state, &[gradient], rate, step, 0.0)
    }

    /// State after several steps, the last number `last`, counted from 1. The parameter moves once: by the sum of the
    /// unbiased first moments over the root of the last second moment. Before and after, it lies `ahead` so many first
    /// moments.
    pub fn steps(&self, state: AdamState, gradients: &[f64], rate: f64, last: i32, ahead: f64) -> AdamState {
        let before = last - gradients.len() as i32;
        assert!(before >= 0, "steps are counted from 1");
        let over_root = |first: f64, second: f64, step: i32| {
            let unbiased = second / (1.0 - self.beta2.powi(step));
            first / (unbiased.sqrt() + self.epsilon)
        };
        let back = if ahead > 0.0 {
            ahead * over_root(state.first, state.second, before)
        } else {
            0.0
        };
        let AdamState {
            value,
            mut first,
            mut second,
        } = state;
        let mut sum = 0.0;
        for (&gradient, step) in gradients.iter().zip(before + 1..) {
            first = self.beta1 * first + (1.0 - self.beta1) * gradient;
            second = self.beta2 * second + (1.0 - self.beta2) * gradient * gradient;
            sum += first / (1.0 - self.beta1.powi(step));
        }
        AdamState {
            value: value - rate * (over_root(sum + ahead * first, second, last) - back),
            first,
            second,
        }
    }
}

/// The log-scales nearest to these (least squares) with differences of at most `most`.
///
/// At the solution some lie at the upper end of an interval of that length, some at its lower end, and the rest within:
/// every such division is tried.
pub fn bounded(log_scale: [f64; 3], most: f64) -> [f64; 3] {
    let spread = |x: [f64; 3]| x[0].max(x[1]).max(x[2]) - x[0].min(x[1]).min(x[2]);
    if spread(log_scale) <= most {
        return log_scale;
    }
    let candidate = |division: usize| {
        let places = [division % 3, division / 3 % 3, division / 9];
        let pinned = || log_scale.iter().zip(places).filter(|(_, place)| *place < 2);
        let sum: f64 = pinned().map(|(x, place)| x - most * place as f64).sum();
        let bottom = sum / pinned().count() as f64;
        log_scale.map(|x| x.clamp(bottom, bottom + most))
    };
    let moved = |x: &[f64; 3]| -> f64 {
        let pairs = x.iter().zip(&log_scale);
        pairs.map(|(x, from)| (x - from).powi(2)).sum()
    };
    // The last division pins none.
    let candidates = (0..26).map(candidate);
    candidates
        .min_by(|a, b| moved(a).total_cmp(&moved(b)))
        .unwrap_or(log_scale)
}
