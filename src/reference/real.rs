//! Number types of the reference's formulas.

use std::fmt::Debug;
use std::iter::Sum;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// Real number: a value, optionally with derivatives or error bounds.
pub trait Real:
    Copy
    + Debug
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Sum
{
    /// A constant.
    fn of(value: f64) -> Self;
    /// The value alone, on which branches are taken.
    fn value(self) -> f64;
    /// e to the power of this.
    fn exp(self) -> Self;
    /// The natural logarithm.
    fn ln(self) -> Self;
    /// The square root; its derivative at 0 is infinite.
    fn sqrt(self) -> Self;

    /// `max(self, floor)`; at or below the floor a constant. NaN stays NaN.
    fn at_least(self, floor: f64) -> Self {
        if self.value() <= floor { Self::of(floor) } else { self }
    }

    /// `min(self, cap)`; at or above the cap a constant. NaN stays NaN.
    fn at_most(self, cap: f64) -> Self {
        if self.value() >= cap { Self::of(cap) } else { self }
    }

    /// The absolute value; a constant at 0, so that an exact match has zero gradient.
    fn abs(self) -> Self {
        if self.value() > 0.0 {
            self
        } else if self.value() < 0.0 {
            -self
        } else {
            self * Self::of(0.0)
        }
    }

    /// The square.
    fn squared(self) -> Self {
        self * self
    }

    /// `1 / (1 + exp(-self))`, without overflow at either end.
    fn sigmoid(self) -> Self {
        let one = Self::of(1.0);
        if self.value() >= 0.0 {
            one / (one + (-self).exp())
        } else {
            let e = self.exp();
            e / (one + e)
        }
    }
}

macro_rules! real_float {
    ($float:ty) => {
        impl Real for $float {
            fn of(value: f64) -> Self {
                value as $float
            }
            fn value(self) -> f64 {
                f64::from(self)
            }
            fn exp(self) -> Self {
                <$float>::exp(self)
            }
            fn ln(self) -> Self {
                <$float>::ln(self)
            }
            fn sqrt(self) -> Self {
                <$float>::sqrt(self)
            }
        }
    };
}

real_float!(f32);
real_float!(f64);
