//! Values of options.

use crate::scene::Axes;
use crate::train::Background;

/// Value of an option, or the form that is expected.
type Reading<T> = Result<T, String>;

/// `black`, `white`, `random` or `R,G,B` with numbers from 0 to 1.
pub(super) fn background(text: &str) -> Reading<Background> {
    match text {
        "random" => Ok(Background::Random),
        _ => color(text).map(Background::Fixed),
    }
}

/// `black`, `white` or `R,G,B` with numbers from 0 to 1.
pub(super) fn color(text: &str) -> Reading<[f32; 3]> {
    match text {
        "black" => return Ok([0.0; 3]),
        "white" => return Ok([1.0; 3]),
        _ => {}
    }
    let channel = |part: &str| {
        let value = part.trim().parse::<f32>().ok();
        value.filter(|value| (0.0..=1.0).contains(value))
    };
    let channels: Option<Vec<f32>> = text.split(',').map(channel).collect();
    match channels.as_deref() {
        Some(&[r, g, b]) => Ok([r, g, b]),
        _ => Err("a colour is black, white or R,G,B with numbers from 0 to 1".into()),
    }
}

/// A number of bytes, with K, M, G or T for powers of 1024.
pub(super) fn size(text: &str) -> Reading<u64> {
    let wanted = || "a size is a number of bytes, or one followed by K, M, G or T".to_string();
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let shift = match text[digits.len()..].to_ascii_uppercase().as_str() {
        "" | "B" => 0,
        "K" | "KB" | "KIB" => 10,
        "M" | "MB" | "MIB" => 20,
        "G" | "GB" | "GIB" => 30,
        "T" | "TB" | "TIB" => 40,
        _ => return Err(wanted()),
    };
    let number: f64 = digits.trim().parse().map_err(|_| wanted())?;
    let bytes = number * f64::from(1_u32 << (shift / 2)) * f64::from(1_u32 << (shift - shift / 2));
    // Casts saturate; the rounding of sizes above 2^53 does not matter to a limit.
    if bytes.is_finite() && bytes >= 1.0 {
        Ok(bytes as u64)
    } else {
        Err(wanted())
    }
}

/// Longest side of an image size.
const SIDE_MAX: u32 = 1 << 15;

/// `1920x1080`.
pub(super) fn image_size(text: &str) -> Reading<[u32; 2]> {
    let side = |text: &str| {
        let side = text.trim().parse().ok();
        side.filter(|side| (1..=SIDE_MAX).contains(side))
    };
    let sides = text.split_once(['x', 'X', '×']);
    let sides = sides.and_then(|(width, height)| Some([side(width)?, side(height)?]));
    sides.ok_or_else(|| format!("a size is WIDTHxHEIGHT in pixels, 1 to {SIDE_MAX} each"))
}

/// `200000`, `200_000` or `2e5`.
pub(super) fn count(text: &str) -> Reading<usize> {
    let digits = text.trim().replace('_', "");
    let whole = |number: f64| {
        let fits = number.fract() == 0.0 && (1.0..=1e9).contains(&number);
        fits.then_some(number as usize)
    };
    let count = digits.parse::<f64>().ok().and_then(whole);
    count.ok_or_else(|| "a number of splats is whole, 1 to 1e9".into())
}

/// A finite number above 0, such as a length.
pub(super) fn positive(text: &str) -> Reading<f64> {
    let value = text
        .parse()
        .ok()
        .filter(|value: &f64| *value > 0.0 && value.is_finite());
    value.ok_or_else(|| "a number above 0 is expected".to_owned())
}

/// A standard deviation in pixels, 0 to 8.
pub(super) fn deviation(text: &str) -> Reading<f64> {
    let deviation = text.parse().ok().filter(|value| (0.0..=8.0).contains(value));
    deviation.ok_or_else(|| "a number of pixels is expected, 0 to 8".to_owned())
}

/// A number of frames a second.
pub(super) fn rate(text: &str) -> Reading<f64> {
    let rate = positive(text).ok().filter(|rate| (0.01..=1000.0).contains(rate));
    rate.ok_or_else(|| "a number of frames a second is expected, 0.01 to 1000".to_owned())
}

/// Axes such as `RUB`.
pub(super) fn axes(text: &str) -> Reading<Axes> {
    let axes = Axes::parse(&text.to_ascii_uppercase());
    axes.ok_or_else(|| "three letters are expected, one of each pair L R, U D, F B, such as RUB".to_owned())
}

/// A number of decibels above 0.
pub(super) fn loss(text: &str) -> Reading<f64> {
    let loss = text.parse::<f64>().ok();
    loss.filter(|loss| *loss > 0.0 && loss.is_finite())
        .ok_or_else(|| "a number of decibels above 0 is expected, such as 0.02".into())
}

/// A number from 0 to 1, or a fraction of two numbers.
pub(super) fn error(text: &str) -> Reading<f64> {
    let number = |text: &str| text.trim().parse::<f64>().ok();
    let value = match text.split_once('/') {
        Some((above, below)) => number(above).zip(number(below)).map(|(a, b)| a / b),
        None => number(text),
    };
    value
        .filter(|value| *value > 0.0 && *value <= 1.0)
        .ok_or_else(|| "a number above 0 and at most 1 is expected, such as 1/512".into())
}

/// A share of the splats: as an error, but below 1.
pub(super) fn share(text: &str) -> Reading<f64> {
    let share = error(text).ok().filter(|share| *share < 1.0);
    share.ok_or_else(|| "a number above 0 and below 1 is expected, such as 0.5".into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::TrainConfig;

    fn refuses<T>(parse: fn(&str) -> Reading<T>, texts: &[&str]) {
        for text in texts {
            assert!(parse(text).is_err(), "{text}");
        }
    }

    #[test]
    fn sizes_have_units() {
        assert_eq!(size("4096"), Ok(4096));
        assert_eq!(size("512M"), Ok(512 << 20));
        assert_eq!(size("1.5GiB"), Ok(3 << 29));
        refuses(size, &["", "G", "-1G", "1X", "nan", "0", "1e999"]);
    }

    #[test]
    fn colours_are_words_or_three_numbers() {
        assert_eq!(color("white"), Ok([1.0; 3]));
        assert_eq!(color("0, 0.5,1"), Ok([0.0, 0.5, 1.0]));
        assert_eq!(background("random"), Ok(Background::Random));
        refuses(color, &["", "red", "0,0", "0,0,2", "0,0,nan", "0,0,0,0"]);
    }

    #[test]
    fn image_sizes_are_two_numbers() {
        assert_eq!(image_size("1920x1080"), Ok([1920, 1080]));
        assert_eq!(image_size("1 × 2"), Ok([1, 2]));
        refuses(image_size, &["", "x", "12", "0x5", "5x", "1x2x3", "-1x5", "99999x1"]);
    }

    #[test]
    fn rates_and_axes_are_checked() {
        assert_eq!((rate("29.97"), rate("0.5")), (Ok(29.97), Ok(0.5)));
        refuses(rate, &["", "0", "-1", "nan", "inf", "1e9"]);
        assert_eq!(axes("rub"), Ok(Axes::RUB));
        refuses(axes, &["", "ru", "rrf", "ply", "rubx"]);
    }

    #[test]
    fn counts_may_be_powers_of_ten() {
        let counts = ["200000", "200_000", "2e5", " 2E5 "].map(count);
        assert!(counts.iter().all(|count| *count == Ok(200_000)), "{counts:?}");
        refuses(count, &["", "0", "-1", "1.5", "1e10", "nan", "many"]);
    }

    #[test]
    fn losses_are_decibels_above_0() {
        // Default of the option without a value.
        assert_eq!(loss("0.1"), Ok(TrainConfig::default().auto.loss_db));
        assert_eq!(loss("1"), Ok(1.0));
        refuses(loss, &["", "0", "-0.1", "nan", "inf", "photos/"]);
    }

    #[test]
    fn deviations_are_a_few_pixels() {
        assert_eq!(["0", "1.5", "8"].map(deviation), [Ok(0.0), Ok(1.5), Ok(8.0)]);
        refuses(deviation, &["", "-1", "8.1", "inf", "nan", "2px"]);
    }

    #[test]
    fn errors_are_fractions_or_numbers() {
        assert_eq!(["1/512", "0.25", "1"].map(error), [Ok(1.0 / 512.0), Ok(0.25), Ok(1.0)]);
        refuses(error, &["", "0", "-1", "2", "1/0", "0/3", "nan", "1/2/3", "a/b"]);
    }
}
