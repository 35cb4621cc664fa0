//! Adam (Kingma and Ba 2015, algorithm 1) on one number.

/// The optimiser's constants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adam {
    /// Decay of the first moment.
    pub beta1: f64,
    /// Decay of the second moment.
    pub beta2: f64,
    /// Keeps the quotient finite where no gradient ever came (3DGS code: 1e-15).
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
pub struct State {
    /// The parameter.
    pub value: f64,
    /// Decayed mean of the gradients.
    pub first: f64,
    /// Decayed mean of their squares.
    pub second: f64,
}

impl Adam {
    /// The state after step number `step`, counted from 1.
    pub fn step(&self, state: State, gradient: f64, rate: f64, step: i32) -> State {
        assert!(step >= 1, "steps are counted from 1");
        let first = self.beta1 * state.first + (1.0 - self.beta1) * gradient;
        let second = self.beta2 * state.second + (1.0 - self.beta2) * gradient * gradient;
        let first_unbiased = first / (1.0 - self.beta1.powi(step));
        let second_unbiased = second / (1.0 - self.beta2.powi(step));
        State {
            value: state.value - rate * first_unbiased / (second_unbiased.sqrt() + self.epsilon),
            first,
            second,
        }
    }
}
