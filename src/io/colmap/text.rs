//! COLMAP's text form: one record per line, `#` for comments, two lines per image.

use super::super::reader::{Reader, excerpt, parse_number};
use super::super::source::Source;
use super::camera::{Intrinsics, parameters_of};
use super::{ImageRecord, PointWithId};
use crate::error::Result;
use crate::scene::Point;
use std::collections::BTreeMap;
use std::str::FromStr;

/// Longest line accepted, in bytes; the 2D points of an image are one line.
const LINE_BYTES_MAX: u64 = 1 << 28;

/// Tokenizer of a text file.
struct Lines<'a> {
    reader: Reader<'a>,
    line: String,
    /// Bytes of `line` already read.
    taken: usize,
}

impl<'a> Lines<'a> {
    fn open(source: Source<'a>) -> Result<Lines<'a>> {
        Ok(Lines {
            reader: Reader::open(source)?,
            line: String::new(),
            taken: 0,
        })
    }

    /// Advances to the next line that is not a comment; false at the end.
    fn advance(&mut self) -> Result<bool> {
        self.taken = 0;
        while self.reader.line(&mut self.line, LINE_BYTES_MAX)? {
            if !self.line.trim_start().starts_with('#') {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Advances to the next line that is neither comment nor blank; false at the end.
    fn advance_to_record(&mut self) -> Result<bool> {
        while self.advance()? {
            if !self.line.trim().is_empty() {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// The next word of the line.
    fn word(&mut self, what: &str) -> Result<&str> {
        let rest = &self.line[self.taken..];
        let start = self.taken + (rest.len() - rest.trim_start().len());
        let rest = &self.line[start..];
        let end = start + rest.find(char::is_whitespace).unwrap_or(rest.len());
        if start == end {
            let what = format!("the line ends before {what}");
            return Err(self.reader.fault_in_line(what));
        }
        self.taken = end;
        Ok(&self.line[start..end])
    }

    /// The rest of the line, which may hold spaces.
    fn rest(&self) -> &str {
        self.line[self.taken..].trim()
    }

    fn fault(&self, what: impl AsRef<str>) -> crate::Error {
        self.reader.fault_in_line(what)
    }

    fn integer<T: FromStr>(&mut self, what: &str) -> Result<T> {
        let word = self.word(what)?;
        let shown = excerpt(word);
        let value = word.parse().ok();
        value.ok_or_else(|| self.fault(format!("{what} is {shown}, not a whole number")))
    }

    fn number(&mut self, what: &str) -> Result<f64> {
        let word = self.word(what)?;
        let shown = excerpt(word);
        let value = parse_number(word);
        value.ok_or_else(|| self.fault(format!("{what} is {shown}, not a number")))
    }

    fn numbers<const N: usize>(&mut self, what: &str) -> Result<[f64; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.number(what)?;
        }
        Ok(values)
    }
}

pub(super) fn cameras(source: Source<'_>) -> Result<BTreeMap<u32, Intrinsics>> {
    let mut lines = Lines::open(source)?;
    let mut lenses = BTreeMap::new();
    while lines.advance_to_record()? {
        let id: u32 = lines.integer("the camera id")?;
        let model = lines.word("the camera model")?.to_owned();
        let count = parameters_of(&model).map_err(|what| lines.fault(what))?;
        let width = lines.integer("the width")?;
        let height = lines.integer("the height")?;
        let mut parameters = Vec::with_capacity(count);
        for i in 1..=count {
            let what = format!("parameter {i} of the {count} of {model}");
            parameters.push(lines.number(&what)?);
        }
        if !lines.rest().is_empty() {
            let what = format!("{model} has {count} parameters, the line has more");
            return Err(lines.fault(what));
        }
        let lens = Intrinsics::new(&model, width, height, &parameters)
            .map_err(|what| lines.fault(format!("camera {id}: {what}")))?;
        if lenses.insert(id, lens).is_some() {
            return Err(lines.fault(format!("camera {id} occurs twice")));
        }
    }
    Ok(lenses)
}

pub(super) fn images(source: Source<'_>) -> Result<Vec<ImageRecord>> {
    let mut lines = Lines::open(source)?;
    let mut images = Vec::new();
    while lines.advance_to_record()? {
        let id = lines.integer("the image id")?;
        let quaternion = lines.numbers("the rotation")?;
        let translation = lines.numbers("the translation")?;
        let camera = lines.integer("the camera id")?;
        let name = lines.rest().to_owned();
        if name.is_empty() {
            return Err(lines.fault("the line ends before the image's name"));
        }
        // The line of 2D points exists even if empty, and must be consumed: x, y and a point's id or -1. Words that are
        // no ids are passed over, as references to points that are missing.
        let has_line = lines.advance()?;
        let ids = lines.line.split_whitespace().skip(2).step_by(3).filter(|_| has_line);
        images.push(ImageRecord {
            id,
            name,
            quaternion,
            translation,
            camera,
            seen: ids.filter_map(|id| id.parse().ok()).collect(),
        });
    }
    Ok(images)
}

pub(super) fn points(source: Source<'_>) -> Result<Vec<PointWithId>> {
    let mut lines = Lines::open(source)?;
    let mut points = Vec::new();
    while lines.advance_to_record()? {
        let id = lines.integer("the point id")?;
        let position: [f64; 3] = lines.numbers("the position")?;
        let mut color = [0.0; 3];
        for channel in &mut color {
            *channel = f32::from(lines.integer::<u8>("the colour")?) / 255.0;
        }
        let point = Point { position, color };
        points.push((id, point));
    }
    Ok(points)
}
