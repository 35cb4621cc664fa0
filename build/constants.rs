//! `glsl/shared/constants.glsl`, read line by line: `const uint TILE_WIDTH = 8;`.

use super::model::Scalar;
use super::source::File;
use std::fmt::Write;

/// The Rust text of every constant; lines that are not constants are added to `faults`.
pub(crate) fn emit(file: &File, faults: &mut Vec<String>) -> String {
    let mut text = String::new();
    for (line, code) in file.code_lines() {
        let code = code.trim();
        if code.is_empty() || code.starts_with('#') {
            continue;
        }
        match constant(code) {
            Some((scalar, name, value)) => {
                let comment = file.comment_at(line);
                let comment = comment.unwrap_or_else(|| format!("`{name}` of the shaders."));
                let _ = writeln!(text, "/// {comment}\npub const {name}: {} = {value};", scalar.rust());
            }
            None => faults.push(file.fault(
                line,
                "expected `const <uint|int|float> NAME = <literal>;`, alone on its line",
            )),
        }
    }
    text
}

/// Type, name and Rust literal.
fn constant(code: &str) -> Option<(Scalar, &str, String)> {
    let (declared, value) = code.strip_suffix(';')?.split_once('=')?;
    let mut words = declared.split_whitespace();
    let (Some("const"), Some(ty), Some(name), None) = (words.next(), words.next(), words.next(), words.next()) else {
        return None;
    };
    let capital = |c: char| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_';
    if !name.starts_with(|c: char| c.is_ascii_uppercase()) || !name.chars().all(capital) {
        return None;
    }
    let value = value.trim();
    match ty {
        "uint" => integer(value.trim_end_matches(['u', 'U']))
            .and_then(|value| u32::try_from(value).ok())
            .map(|value| (Scalar::U32, name, value.to_string())),
        "int" => integer(value)
            .and_then(|value| i32::try_from(value).ok())
            .map(|value| (Scalar::I32, name, value.to_string())),
        "float" => value
            .trim_end_matches(['f', 'F'])
            .parse::<f32>()
            .ok()
            .filter(|value| value.is_finite())
            .map(|value| (Scalar::F32, name, format!("{value:?}"))),
        _ => None,
    }
}

fn integer(text: &str) -> Option<i64> {
    match text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")) {
        Some(digits) => i64::from_str_radix(digits, 16).ok(),
        None => text.parse().ok(),
    }
}
