//! Groups of constants: name, documentation, default and range of each in one place.

use crate::{Error, Result};
use std::fmt::Display;
use std::ops::RangeInclusive;

/// Declares a struct of constants: `name: type = default, range;` for each. The struct is read from and written to
/// JSON, where missing constants have their defaults and unknown ones are refused; `check` names the first constant out
/// of its range.
macro_rules! constants {
    ($(#[$about:meta])* $group:ident as $prefix:literal {
        $($(#[$doc:meta])* $name:ident: $kind:ty = $default:expr, $range:expr;)*
    }) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct $group {
            $($(#[$doc])* pub $name: $kind,)*
        }

        impl Default for $group {
            fn default() -> $group {
                $group { $($name: $default,)* }
            }
        }

        impl $group {
            pub(super) fn check(&self) -> $crate::Result<()> {
                use $crate::train::config::constants::RangedField;
                $(self.$name.check(concat!($prefix, ".", stringify!($name)), $range)?;)*
                Ok(())
            }
        }
    };
}
pub(super) use constants;

/// Largest `f32` below 1: a decay of 1 would never forget, an opacity of 1 has no logit.
pub(super) const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;

/// Constant with a range.
pub(super) trait RangedField {
    /// Number, or that of each element.
    type Number;
    /// Refuses numbers outside the range; NaN is in no range.
    fn check(&self, name: &str, range: RangeInclusive<Self::Number>) -> Result<()>;
}

macro_rules! bounded {
    ($($number:ident),*) => {
        $(impl RangedField for $number {
            type Number = $number;
            fn check(&self, name: &str, range: RangeInclusive<$number>) -> Result<()> {
                check(*self, $number::MAX, name, range)
            }
        })*
    };
}
bounded!(u32, f32, f64);

impl<T: RangedField, const N: usize> RangedField for [T; N]
where
    T::Number: Clone,
{
    type Number = T::Number;
    fn check(&self, name: &str, range: RangeInclusive<T::Number>) -> Result<()> {
        self.iter().try_for_each(|number| number.check(name, range.clone()))
    }
}

fn check<T: PartialOrd + Display + Copy>(value: T, unbounded: T, name: &str, range: RangeInclusive<T>) -> Result<()> {
    if range.contains(&value) {
        return Ok(());
    }
    let (least, most) = (range.start(), range.end());
    let wanted = match *most == unbounded {
        true => format!("at least {least}"),
        false => format!("from {least} to {most}"),
    };
    Err(refused(name, value, &wanted))
}

pub(super) fn refused(name: &str, value: impl Display, wanted: &str) -> Error {
    Error::Config(format!("{name} is {value}, but must be {wanted}"))
}
