//! Rows of a PLY file: values of chosen properties in any encoding.

use super::super::reader::{Reader, excerpt, parse_number};
use super::header::{Encoding, PlyElement, PlyHeader, Property, Scalar};
use crate::error::Result;

/// Bytes read at a time.
const CHUNK_BYTES: usize = 1 << 20;

/// Longest line of an ASCII row accepted, in bytes.
const LINE_BYTES_MAX: u64 = 1 << 24;

/// Skips all rows of the elements before position `index`.
pub(super) fn skip_to(reader: &mut Reader, header: &PlyHeader, index: usize) -> Result<()> {
    header.elements[..index]
        .iter()
        .try_for_each(|element| skip(reader, header.encoding, element))
}

/// Skips all rows of an element.
pub(super) fn skip(reader: &mut Reader, encoding: Encoding, element: &PlyElement) -> Result<()> {
    let what = format!("element {}", excerpt(&element.name));
    if encoding == Encoding::Ascii {
        let mut line = String::new();
        // A count beyond the file ends with an error at the end of the file.
        for _ in 0..element.count {
            next_row(reader, &mut line, &what)?;
        }
        return Ok(());
    }
    reader.check_count(element.count, element.row_bytes_min(), &what)?;
    if !element.has_list() {
        return reader.skip(element.count * element.row_bytes_min(), &what);
    }
    for _ in 0..element.count {
        skip_row(reader, encoding, element, &what)?;
    }
    Ok(())
}

fn skip_row(reader: &mut Reader, encoding: Encoding, element: &PlyElement, what: &str) -> Result<()> {
    for property in &element.properties {
        let Some(length) = property.list else {
            reader.skip(property.scalar.bytes() as u64, what)?;
            continue;
        };
        let mut bytes = [0; 8];
        let bytes = &mut bytes[..length.bytes()];
        reader.fill(bytes, what)?;
        let items = decode(bytes, length, encoding);
        // Negative and NaN lengths fail the comparison, too.
        if !(items >= 0.0 && items <= reader.remaining() as f64) {
            return Err(reader.fault(format!("a list in {what} has the length {items}")));
        }
        reader.skip(items as u64 * property.scalar.bytes() as u64, what)?;
    }
    Ok(())
}

/// Compares the count of `element`, whose rows come next, with the size of the file.
pub(super) fn check_count(reader: &Reader, encoding: Encoding, element: &PlyElement) -> Result<usize> {
    let bytes_each = match encoding {
        // A digit and a separator per value.
        Encoding::Ascii => 2 * element.properties.len() as u64 - 1,
        _ => element.row_bytes_min(),
    };
    let what = format!("rows of element {}", excerpt(&element.name));
    reader.check_count(element.count, bytes_each, &what)
}

/// Reads the rows of `element` and passes the values of `columns` (indices of its properties, in that order) to `each`.
/// The element has no lists and its count has been checked.
///
/// Every stored `float` is exact: widening to `f64` and back loses nothing.
pub(super) fn read(
    reader: &mut Reader,
    encoding: Encoding,
    element: &PlyElement,
    columns: &[usize],
    mut each: impl FnMut(&[f64]),
) -> Result<()> {
    assert!(!element.has_list(), "lists have no columns");
    let mut values = vec![0.0; columns.len()];
    if encoding == Encoding::Ascii {
        let mut line = String::new();
        for _ in 0..element.count {
            next_row(reader, &mut line, "the vertices")?;
            parse_row(reader, &line, &element.properties, columns, &mut values)?;
            each(&values);
        }
        return Ok(());
    }
    let mut offsets = Vec::with_capacity(element.properties.len());
    let mut stride = 0;
    for property in &element.properties {
        offsets.push(stride);
        stride += property.scalar.bytes();
    }
    let rows_max = (CHUNK_BYTES / stride.max(1)).max(1);
    let mut bytes = Vec::new();
    let mut left = element.count;
    while left > 0 {
        let rows = left.min(rows_max as u64);
        bytes.resize(rows as usize * stride, 0);
        reader.fill(&mut bytes, "the vertices")?;
        for row in bytes.chunks_exact(stride) {
            for (value, &column) in values.iter_mut().zip(columns) {
                let scalar = element.properties[column].scalar;
                let start = offsets[column];
                *value = decode(&row[start..start + scalar.bytes()], scalar, encoding);
            }
            each(&values);
        }
        left -= rows;
    }
    Ok(())
}

/// Reads the rows of an element and passes the values of its list `list`, at most `most` of them, to `each`. The count
/// has been checked.
pub(super) fn read_lists<'a>(
    reader: &mut Reader<'a>,
    encoding: Encoding,
    element: &PlyElement,
    list: usize,
    most: usize,
    mut each: impl FnMut(&Reader<'a>, &[f64]) -> Result<()>,
) -> Result<()> {
    let what = format!("element {}", excerpt(&element.name));
    let (mut line, mut values) = (String::new(), Vec::new());
    for _ in 0..element.count {
        if encoding == Encoding::Ascii {
            next_row(reader, &mut line, &what)?;
        }
        let mut tokens = line.split_whitespace();
        let mut number = |reader: &mut Reader<'a>, scalar: Scalar| -> Result<f64> {
            if encoding == Encoding::Ascii {
                let token = tokens.next().and_then(parse_number);
                return token.ok_or_else(|| reader.fault_in_line(format!("{what} lacks a number")));
            }
            let mut bytes = [0; 8];
            let bytes = &mut bytes[..scalar.bytes()];
            reader.fill(bytes, &what)?;
            Ok(decode(bytes, scalar, encoding))
        };
        for (i, property) in element.properties.iter().enumerate() {
            let length = match property.list {
                Some(length) => number(reader, length)?,
                None => 1.0,
            };
            // Negative and NaN lengths fail the comparison, too.
            if !(length >= 0.0 && length <= most as f64) {
                return Err(reader.fault(format!("a list in {what} has the length {length}")));
            }
            values.clear();
            for _ in 0..length as usize {
                values.push(number(reader, property.scalar)?);
            }
            if i == list {
                each(reader, &values)?;
            }
        }
    }
    Ok(())
}

/// The next line that is not blank.
fn next_row(reader: &mut Reader, line: &mut String, what: &str) -> Result<()> {
    loop {
        if !reader.line(line, LINE_BYTES_MAX)? {
            return Err(reader.fault_in_line(format!("the file ends inside {what}")));
        }
        if !line.trim().is_empty() {
            return Ok(());
        }
    }
}

fn parse_row(
    reader: &Reader,
    line: &str,
    properties: &[Property],
    columns: &[usize],
    values: &mut [f64],
) -> Result<()> {
    let tokens: Vec<&str> = line.split_whitespace().collect();
    if tokens.len() != properties.len() {
        return Err(reader.fault_in_line(format!(
            "{} numbers, but a vertex has {}",
            tokens.len(),
            properties.len()
        )));
    }
    for (value, &column) in values.iter_mut().zip(columns) {
        let token = tokens[column];
        // A float is rounded once, from its decimal form, not through a double.
        let number = match properties[column].scalar {
            Scalar::F32 => token.parse::<f32>().ok().map(f64::from),
            _ => None,
        };
        *value = number.or_else(|| parse_number(token)).ok_or_else(|| {
            let name = excerpt(&properties[column].name);
            reader.fault_in_line(format!("{name} is {}, not a number", excerpt(token)))
        })?;
    }
    Ok(())
}

/// Decodes a binary number of `scalar.bytes()` bytes.
fn decode(bytes: &[u8], scalar: Scalar, encoding: Encoding) -> f64 {
    let mut raw = [0; 8];
    raw[..bytes.len()].copy_from_slice(bytes);
    if encoding == Encoding::BigEndian {
        raw[..bytes.len()].reverse();
    }
    let [a, b, c, d, ..] = raw;
    match scalar {
        Scalar::I8 => f64::from(a as i8),
        Scalar::U8 => f64::from(a),
        Scalar::I16 => f64::from(i16::from_le_bytes([a, b])),
        Scalar::U16 => f64::from(u16::from_le_bytes([a, b])),
        Scalar::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
        Scalar::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
        Scalar::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
        Scalar::F64 => f64::from_le_bytes(raw),
    }
}
