//! Numbers with bounds of their rounding errors and those of their derivatives: running error analysis, to first order.
//!
//! Beside a value `v` and its derivatives `d` stand, in unit roundoffs, `e`: the error bound of the computed value, and
//! `f`: that of the computed derivatives; and `p ≥ |d|`, the magnitudes of the terms of a derivative's sum, one for
//! each path from the variable. Every operation is rounded once, constants and functions too:
//!
//! * Sums: `e = e₁ + e₂ + |v|`, `p = p₁ + p₂`, `f = f₁ + f₂ + p`. Where terms cancel, `p` and `f` stay.
//! * Products: `e = |v₁| e₂ + |v₂| e₁ + |v|`, `p = |v₁| p₂ + |v₂| p₁`, and as a derivative is `v₁ d₂ + v₂ d₁`,
//!   `f = |v₁| f₂ + e₁ p₂ + |v₂| f₁ + e₂ p₁ + 2 p`.
//! * Functions: `e = |g'| e + |g|`, `p = |g'| p`, `f = |g'| f + |g''| e p + 2 p`.
//!
//! `p` never cancels, so that `f` holds for any order of multiplication and addition: a backward pass adds the same
//! terms in another order.

use super::Real;
use std::iter::Sum;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// Value with error bounds; see the module.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Terms<const N: usize> {
    v: f64,
    e: f64,
    p: [f64; N],
    f: [f64; N],
}

impl<const N: usize> Terms<N> {
    /// Variable number `index`, exact; an exact constant if there is no such variable.
    pub fn variable(value: f64, index: Option<usize>) -> Self {
        let mut terms = Terms {
            v: value,
            e: 0.0,
            p: [0.0; N],
            f: [0.0; N],
        };
        if let Some(slot) = index.and_then(|i| terms.p.get_mut(i)) {
            *slot = 1.0;
        }
        terms
    }

    /// Error bound of the computed derivatives after `operations` more multiplications and additions, in unit
    /// roundoffs.
    pub fn off(&self, operations: f64) -> [f64; N] {
        std::array::from_fn(|i| self.f[i] + operations * self.p[i])
    }

    /// Function of this number, by its value and first two derivatives.
    fn chain(self, value: f64, slope: f64, bend: f64) -> Self {
        let (slope, bend) = (slope.abs(), bend.abs());
        let p = self.p.map(|p| slope * p);
        Terms {
            v: value,
            e: slope * self.e + value.abs(),
            p,
            f: std::array::from_fn(|i| slope * self.f[i] + bend * self.e * self.p[i] + 2.0 * p[i]),
        }
    }
}

impl<const N: usize> Add for Terms<N> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        let v = self.v + other.v;
        let p: [f64; N] = std::array::from_fn(|i| self.p[i] + other.p[i]);
        Terms {
            v,
            e: self.e + other.e + v.abs(),
            p,
            f: std::array::from_fn(|i| self.f[i] + other.f[i] + p[i]),
        }
    }
}

impl<const N: usize> Sub for Terms<N> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl<const N: usize> Mul for Terms<N> {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let (mine, theirs) = (self.v.abs(), other.v.abs());
        let v = self.v * other.v;
        let p: [f64; N] = std::array::from_fn(|i| mine * other.p[i] + theirs * self.p[i]);
        let f = |i: usize| mine * other.f[i] + self.e * other.p[i] + theirs * self.f[i] + other.e * self.p[i];
        Terms {
            v,
            e: mine * other.e + theirs * self.e + v.abs(),
            p,
            f: std::array::from_fn(|i| f(i) + 2.0 * p[i]),
        }
    }
}

impl<const N: usize> Div for Terms<N> {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let one = 1.0 / other.v;
        self * other.chain(one, one * one, 2.0 * one * one * one)
    }
}

impl<const N: usize> Neg for Terms<N> {
    type Output = Self;
    fn neg(self) -> Self {
        Terms { v: -self.v, ..self }
    }
}

impl<const N: usize> Sum for Terms<N> {
    fn sum<I: Iterator<Item = Self>>(terms: I) -> Self {
        terms.fold(Self::of(0.0), |sum, term| sum + term)
    }
}

impl<const N: usize> Real for Terms<N> {
    fn of(value: f64) -> Self {
        Terms {
            e: value.abs(),
            ..Self::variable(value, None)
        }
    }
    fn value(self) -> f64 {
        self.v
    }
    fn exp(self) -> Self {
        let e = self.v.exp();
        self.chain(e, e, e)
    }
    fn ln(self) -> Self {
        let one = 1.0 / self.v;
        self.chain(self.v.ln(), one, one * one)
    }
    fn sqrt(self) -> Self {
        let root = self.v.sqrt();
        self.chain(root, 0.5 / root, 0.25 / (root * self.v))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn terms_that_cancel_are_remembered() {
        let x = Terms::<1>::variable(3.0, Some(0));
        let nothing = x * x - x * Terms::of(3.0);
        // 9 of the square, 9 of the product and 9 of the constant in it, and nothing of the difference.
        assert_eq!((nothing.v, nothing.e, nothing.p), (0.0, 27.0, [9.0]));
        // 12 of the square; 6 of the product and 3 of its constant; 9 of the difference.
        assert_eq!(nothing.f, [30.0]);
        assert_eq!(nothing.off(2.0), [48.0]);
    }

    fn formula<R: Real>(x: R) -> R {
        let near = (x - R::of(0.75)) * R::of(100.0);
        (near.exp() - R::of(1.0)) / (x * x - R::of(0.5)) + (x + R::of(7.0)).sqrt().ln()
    }

    /// Against `f32`, beside which `f64` is exact. Values only: difference quotients would not be exact.
    #[test]
    fn what_rounding_does_keeps_to_the_terms() {
        let mut most: f64 = 0.0;
        for i in 0..1000 {
            let x = 0.7501 + 1e-5 * i as f32;
            let exact = formula(Terms::<0>::variable(f64::from(x), None));
            let off = (f64::from(formula(x)) - exact.v).abs();
            most = most.max(off / (exact.e * f64::from(f32::EPSILON) / 2.0));
        }
        assert!(most <= 1.0 && most > 0.01, "{most} of what is allowed");
    }
}
