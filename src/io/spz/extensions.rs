//! Extension records: type, length and contents. Axes are read and written.

use crate::error::{Error, Result};
use crate::scene::Axes;
use std::path::Path;

/// Adobe's "coordinate system": axes of the stored splats.
const AXES: u32 = 0xadbe_0003;
/// Adobe's "safe orbit camera", of no use here.
const SAFE_ORBIT: u32 = 0xadbe_0002;

/// Axes by value, from 1.
const AXES_BY_VALUE: [&str; 16] = [
    "LDB", "RDB", "LUB", "RUB", "LDF", "RDF", "LUF", "RUF", "LFD", "RFD", "LFU", "RFU", "LBD", "RBD", "LBU", "RBU",
];

/// Axes that records give, if any. `place` is the offset of the records, and tells where that counts from.
pub(super) fn parse(path: &Path, mut left: &[u8], place: &str, warnings: &mut Vec<String>) -> Result<Option<Axes>> {
    let mut axes = None;
    let mut index = 0;
    while !left.is_empty() {
        let Some((head, rest)) = left.split_first_chunk::<8>() else {
            let what = format!("{place}: extension {index} is cut off in its type and length");
            return Err(Error::file(path, what));
        };
        let [a, b, c, d, e, f, g, h] = *head;
        let kind = u32::from_le_bytes([a, b, c, d]);
        let length = u32::from_le_bytes([e, f, g, h]);
        let Some((contents, rest)) = rest.split_at_checked(length as usize) else {
            let what = format!(
                "{place}: extension {index} of type {kind:#010x} has {length} bytes, and {} are left",
                rest.len()
            );
            return Err(Error::file(path, what));
        };
        match kind {
            AXES => axes = axes_of(path, contents, warnings).or(axes),
            SAFE_ORBIT => {}
            // One warning: records may be as short as their heads.
            _ if index == 0 || !warnings.iter().any(|w| w.ends_with(UNKNOWN)) => {
                warnings.push(format!(
                    "{}: an extension of type {kind:#010x} {UNKNOWN}",
                    path.display()
                ));
            }
            _ => {}
        }
        (left, index) = (rest, index + 1);
    }
    Ok(axes)
}

/// End of the warning about an unknown extension.
const UNKNOWN: &str = "is not known and was ignored";

fn axes_of(path: &Path, contents: &[u8], warnings: &mut Vec<String>) -> Option<Axes> {
    let value = contents
        .first_chunk::<4>()
        .map_or(0, |bytes| u32::from_le_bytes(*bytes));
    let name = value.checked_sub(1).and_then(|i| AXES_BY_VALUE.get(i as usize));
    let axes = name.and_then(|name| Axes::parse(name));
    if axes.is_none() {
        let what = format!("{}: its axes have the unknown value {value}, ignored", path.display());
        if !warnings.contains(&what) && warnings.len() < 8 {
            warnings.push(what);
        }
    }
    axes
}

/// Record of axes; `None` for those without a value.
pub(super) fn record(axes: Axes) -> Option<Vec<u8>> {
    let name = axes.to_string();
    let index = AXES_BY_VALUE.iter().position(|known| *known == name)?;
    let fields = [AXES, 4, 1 + index as u32];
    Some(fields.iter().flat_map(|field| field.to_le_bytes()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_of_all_axes_are_read_back() {
        let path = Path::new("a.spz");
        for name in AXES_BY_VALUE {
            let axes = Axes::parse(name).unwrap();
            let record = record(axes).unwrap();
            assert_eq!(record.len(), 12);
            let mut warnings = Vec::new();
            assert_eq!(parse(path, &record, "byte 32", &mut warnings).unwrap(), Some(axes));
            assert!(warnings.is_empty());
        }
        assert_eq!(record(Axes::RUB).unwrap()[8..], [4, 0, 0, 0]);
        assert_eq!(record(Axes::parse("UFR").unwrap()), None);
    }
}
