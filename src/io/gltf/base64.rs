//! Base 64 of RFC 4648, as in `data:` URIs.

use super::super::check::Check;

/// Bytes of a text, with or without its padding.
pub(super) fn decode(text: &str) -> Check<Vec<u8>> {
    let digits = text.trim_end_matches('=').as_bytes();
    let padding = text.len() - digits.len();
    if digits.len() % 4 == 1 || padding > 2 || padding > 0 && !text.len().is_multiple_of(4) {
        return Err(format!("{} characters are no base 64", text.len()));
    }
    let mut bytes = Vec::with_capacity(digits.len() / 4 * 3 + 2);
    for (index, four) in digits.chunks(4).enumerate() {
        let mut bits = 0;
        for (i, &digit) in four.iter().enumerate() {
            let value = value(digit).ok_or_else(|| format!("character {} is no base 64", 4 * index + i))?;
            bits |= u32::from(value) << (18 - 6 * i);
        }
        let [_, three @ ..] = bits.to_be_bytes();
        bytes.extend(&three[..four.len() - 1]);
    }
    Ok(bytes)
}

fn value(digit: u8) -> Option<u8> {
    Some(match digit {
        b'A'..=b'Z' => digit - b'A',
        b'a'..=b'z' => digit - b'a' + 26,
        b'0'..=b'9' => digit - b'0' + 52,
        b'+' => 62,
        b'/' => 63,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_of_the_standard_decode() {
        for (text, bytes) in [
            ("", ""),
            ("Zg==", "f"),
            ("Zm8=", "fo"),
            ("Zm9v", "foo"),
            ("Zm9vYg", "foob"),
        ] {
            assert_eq!(decode(text).as_deref(), Ok(bytes.as_bytes()));
        }
        assert_eq!(decode("+/+/").unwrap(), [0xfb, 0xff, 0xbf]);
        for wrong in ["Z", "Zg=", "Z===", "Zm 9", "Zm9v====", "Z=g="] {
            assert!(decode(wrong).is_err(), "{wrong}");
        }
    }
}
