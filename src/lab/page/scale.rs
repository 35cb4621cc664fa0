//! Scales of axes: place of a value, ticks and their labels.
//!
//! A logarithmic scale is a linear one of logarithms with its own labels.

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use std::ops::Range;

/// Linear or logarithmic scale.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Scale {
    is_log: bool,
    /// First and last place.
    pub(crate) span: [f64; 2],
    /// Places of the ticks.
    pub(crate) ticks: Vec<f64>,
    /// Distance between linear ticks, for the number of digits.
    step: f64,
}

/// Approximate number of ticks of a linear scale.
const TICKS: f64 = 6.0;

impl Scale {
    /// Scale over all finite values, with a margin. A logarithmic one ignores values that are not positive.
    pub(crate) fn of(values: impl IntoIterator<Item = f64>, is_log: bool) -> Scale {
        let places = values.into_iter().map(|v| place(v, is_log));
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for place in places.filter(|p| p.is_finite()) {
            (low, high) = (low.min(place), high.max(place));
        }
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        // A single value is centred.
        let width = (high - low).max(if is_log { 0.2 } else { high.abs().max(1e-6) * 0.02 });
        let middle = 0.5 * (low + high);
        let span = [middle - 0.56 * width, middle + 0.56 * width];
        let step = nice((span[1] - span[0]) / TICKS);
        let ticks = match is_log {
            true => decades(span),
            false => multiples(span, step),
        };
        Scale {
            is_log,
            span,
            ticks,
            step,
        }
    }

    /// Place of a value between the ends of `span`.
    pub(crate) fn place(&self, value: f64) -> f64 {
        place(value, self.is_log).clamp(self.span[0], self.span[1])
    }

    /// Label of a tick.
    pub(crate) fn label(&self, place: f64) -> String {
        if !self.is_log {
            let digits = (-self.step.log10().floor()).clamp(0.0, 9.0) as usize;
            return match self.step >= 1000.0 {
                true => format!("{} k", trimmed(place / 1000.0)),
                false => format!("{place:.digits$}"),
            };
        }
        let decade = (place + 1e-9).floor();
        let mantissa = 10_f64.powf(place - decade).round() as u32;
        if (-2.0..5.0).contains(&decade) {
            return trimmed(f64::from(mantissa) * 10_f64.powi(decade as i32));
        }
        let power = format!("10{}", superscript(decade as i32));
        match mantissa {
            1 => power,
            _ => format!("{mantissa}·{power}"),
        }
    }
}

impl Ranged for Scale {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, place: &f64, (first, last): (i32, i32)) -> i32 {
        let share = (place - self.span[0]) / (self.span[1] - self.span[0]);
        first + (share * f64::from(last - first)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        match hint.weight().allow_light_points() {
            true => Vec::new(),
            false => self.ticks.clone(),
        }
    }

    fn range(&self) -> Range<f64> {
        self.span[0]..self.span[1]
    }
}

impl ValueFormatter<f64> for Scale {
    fn format_ext(&self, place: &f64) -> String {
        self.label(*place)
    }
}

fn place(value: f64, is_log: bool) -> f64 {
    match is_log {
        true => value.log10(),
        false => value,
    }
}

/// Up to three digits, without zeros at the end.
fn trimmed(value: f64) -> String {
    let text = format!("{value:.3}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// 1, 2 or 5 times a power of ten, at least `least`.
fn nice(least: f64) -> f64 {
    let power = 10_f64.powf(least.log10().floor());
    let steps = [1.0, 2.0, 5.0, 10.0].map(|factor| factor * power);
    steps.into_iter().find(|&step| step >= least).unwrap_or(least)
}

fn multiples([low, high]: [f64; 2], step: f64) -> Vec<f64> {
    let first = (low / step).ceil() as i64;
    let last = (high / step).floor() as i64;
    (first..=last).map(|i| i as f64 * step).collect()
}

/// Powers of ten, with 2 and 5 times them if those are few.
fn decades([low, high]: [f64; 2]) -> Vec<f64> {
    let powers = low.floor() as i64..=high.ceil() as i64;
    let factors: &[f64] = match high - low {
        width if width > 2.2 => &[1.0],
        width if width > 0.6 => &[1.0, 2.0, 5.0],
        _ => &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0],
    };
    // Every n-th power if there are many.
    let every = (((high - low) / 9.0).ceil() as i64).max(1);
    let powers = powers.filter(|power| power % every == 0);
    let all = powers.flat_map(|power| factors.iter().map(move |f| power as f64 + f.log10()));
    all.filter(|place| (low..=high).contains(place)).collect()
}

fn superscript(number: i32) -> String {
    let digit = |c: char| match c {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        digit => char::from_u32(0x2070 + digit.to_digit(10).unwrap_or(0)).unwrap_or('⁰'),
    };
    number.to_string().chars().map(digit).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(scale: &Scale) -> Vec<String> {
        scale.ticks.iter().map(|&t| scale.label(t)).collect()
    }

    #[test]
    fn linear_axes_mark_round_numbers() {
        let scale = Scale::of([3.2, 9.7, f64::NAN], false);
        assert_eq!(labels(&scale), ["4", "6", "8", "10"]);
        assert!(scale.span[0] < 3.2 && scale.span[1] > 9.7);
        assert_eq!(labels(&Scale::of([20_000.0, 50_000.0], false))[0], "20 k");
        assert_eq!(
            labels(&Scale::of([0.81, 0.85], false)),
            ["0.81", "0.82", "0.83", "0.84", "0.85"]
        );
    }

    #[test]
    fn logarithmic_axes_mark_powers() {
        let wide = Scale::of([3e-6, 0.5, 0.0, -1.0], true);
        assert_eq!(labels(&wide), ["10⁻⁵", "10⁻⁴", "10⁻³", "0.01", "0.1", "1"]);
        let narrow = Scale::of([2.0, 30.0], true);
        assert_eq!(labels(&narrow), ["2", "5", "10", "20"]);
        let single = Scale::of([7.0], true);
        assert!(single.ticks.len() > 1 && single.place(7.0) > single.span[0]);
    }

    #[test]
    fn nothing_has_an_axis_too() {
        assert_eq!(Scale::of([], false).span[0] + Scale::of([], false).span[1], 1.0);
    }

    #[test]
    fn values_beyond_the_axis_stay_on_its_border() {
        let scale = Scale::of([1.0, 2.0], true);
        assert_eq!(scale.place(0.0), scale.span[0]);
        assert_eq!(scale.place(f64::INFINITY), scale.span[1]);
    }
}
