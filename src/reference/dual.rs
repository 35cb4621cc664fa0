//! Dual numbers: values with derivatives by `N` variables, for exact gradients without a step size.
//!
//! Every operation follows its textbook rule and nothing else, which makes them more trustworthy than a derivation by
//! hand.

use super::Real;
use std::iter::Sum;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A value with its partial derivatives by `N` variables.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dual<const N: usize> {
    /// The value.
    pub v: f64,
    /// Partial derivatives.
    pub d: [f64; N],
}

impl<const N: usize> Dual<N> {
    /// Variable number `index`; a constant if there is no such variable.
    pub fn variable(value: f64, index: Option<usize>) -> Self {
        let mut d = [0.0; N];
        if let Some(slot) = index.and_then(|i| d.get_mut(i)) {
            *slot = 1.0;
        }
        Dual { v: value, d }
    }

    /// A function of this with the given value and derivative.
    fn chain(self, value: f64, slope: f64) -> Self {
        Dual {
            v: value,
            d: self.d.map(|d| slope * d),
        }
    }

    /// A function of two with the given value and partial derivatives.
    fn chain2(self, other: Self, value: f64, slope: f64, other_slope: f64) -> Self {
        let mut d = self.d;
        for (mine, theirs) in d.iter_mut().zip(other.d) {
            *mine = slope * *mine + other_slope * theirs;
        }
        Dual { v: value, d }
    }
}

impl<const N: usize> Add for Dual<N> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        self.chain2(other, self.v + other.v, 1.0, 1.0)
    }
}

impl<const N: usize> Sub for Dual<N> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self.chain2(other, self.v - other.v, 1.0, -1.0)
    }
}

impl<const N: usize> Mul for Dual<N> {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        self.chain2(other, self.v * other.v, other.v, self.v)
    }
}

impl<const N: usize> Div for Dual<N> {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let ratio = self.v / other.v;
        self.chain2(other, ratio, 1.0 / other.v, -ratio / other.v)
    }
}

impl<const N: usize> Neg for Dual<N> {
    type Output = Self;
    fn neg(self) -> Self {
        self.chain(-self.v, -1.0)
    }
}

impl<const N: usize> Sum for Dual<N> {
    fn sum<I: Iterator<Item = Self>>(terms: I) -> Self {
        terms.fold(Self::of(0.0), |sum, term| sum + term)
    }
}

impl<const N: usize> Real for Dual<N> {
    fn of(value: f64) -> Self {
        Dual { v: value, d: [0.0; N] }
    }
    fn value(self) -> f64 {
        self.v
    }
    fn exp(self) -> Self {
        let e = self.v.exp();
        self.chain(e, e)
    }
    fn ln(self) -> Self {
        self.chain(self.v.ln(), 1.0 / self.v)
    }
    fn sqrt(self) -> Self {
        let root = self.v.sqrt();
        self.chain(root, 0.5 / root)
    }
}
