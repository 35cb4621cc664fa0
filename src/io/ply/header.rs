//! Header of a PLY file.

use super::super::reader::{Reader, excerpt};
use crate::error::Result;

/// Longest header accepted in bytes; the longest in use have some kilobytes.
const HEADER_BYTES_MAX: u64 = 1 << 20;

/// Most elements, and most properties of one; each is compared with all before it. Splats of degree 3 have 62
/// properties; some programs add hundreds of features.
const NAMES_MAX: usize = 4096;

/// Encoding of numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// Number type; both the old names (`float`, `uchar`) and the sized ones (`float32`, `uint8`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn parse(name: &str) -> Option<Scalar> {
        Some(match name {
            "char" | "int8" => Scalar::I8,
            "uchar" | "uint8" => Scalar::U8,
            "short" | "int16" => Scalar::I16,
            "ushort" | "uint16" => Scalar::U16,
            "int" | "int32" => Scalar::I32,
            "uint" | "uint32" => Scalar::U32,
            "float" | "float32" => Scalar::F32,
            "double" | "float64" => Scalar::F64,
            _ => return None,
        })
    }

    /// Name in headers.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Scalar::I8 => "char",
            Scalar::U8 => "uchar",
            Scalar::I16 => "short",
            Scalar::U16 => "ushort",
            Scalar::I32 => "int",
            Scalar::U32 => "uint",
            Scalar::F32 => "float",
            Scalar::F64 => "double",
        }
    }

    /// Bytes of one value.
    pub(super) const fn bytes(self) -> usize {
        match self {
            Scalar::I8 | Scalar::U8 => 1,
            Scalar::I16 | Scalar::U16 => 2,
            Scalar::I32 | Scalar::U32 | Scalar::F32 => 4,
            Scalar::F64 => 8,
        }
    }
}

/// One property of an element.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) scalar: Scalar,
    /// Type of a list's length field.
    pub(super) list: Option<Scalar>,
}

/// Kind of row and its count.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct PlyElement {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
}

impl PlyElement {
    /// Index of a property.
    pub(super) fn find(&self, name: &str) -> Option<usize> {
        self.properties.iter().position(|p| p.name == name)
    }

    /// Bytes of a binary row; its minimum if there are lists.
    pub(super) fn row_bytes_min(&self) -> u64 {
        let bytes = |p: &Property| p.list.unwrap_or(p.scalar).bytes() as u64;
        self.properties.iter().map(bytes).sum()
    }

    /// True if rows differ in length.
    pub(super) fn has_list(&self) -> bool {
        self.properties.iter().any(|p| p.list.is_some())
    }
}

/// Contents up to `end_header`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct PlyHeader {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<PlyElement>,
    pub(super) comments: Vec<String>,
}

impl PlyHeader {
    /// Element of that name and its index.
    pub(super) fn element(&self, name: &str) -> Option<(usize, &PlyElement)> {
        let mut all = self.elements.iter().enumerate();
        all.find(|(_, e)| e.name == name)
    }

    /// Reads up to and including `end_header`.
    pub(super) fn read(reader: &mut Reader) -> Result<PlyHeader> {
        if reader.size() == 0 {
            return Err(reader.fault("the file is empty"));
        }
        // The magic is compared as bytes: other formats need not be text.
        let mut magic = [0; 3];
        if reader.size() < 4 || reader.fill(&mut magic, "the magic").is_err() || &magic != b"ply" {
            return Err(reader.fault("not a PLY file: it does not begin with the line \"ply\""));
        }
        let mut line = String::new();
        reader.line(&mut line, HEADER_BYTES_MAX)?;
        if !line.trim().is_empty() {
            return Err(reader.fault_in_line("not a PLY file: \"ply\" must stand alone"));
        }
        let mut encoding = None;
        let mut header = PlyHeader {
            encoding: Encoding::Ascii,
            elements: Vec::new(),
            comments: Vec::new(),
        };
        loop {
            let room = HEADER_BYTES_MAX.saturating_sub(reader.offset());
            if room == 0 || !reader.line(&mut line, room)? {
                return Err(reader.fault("the header has no end_header line"));
            }
            let text = line.trim();
            let (keyword, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
            match keyword {
                "end_header" => break,
                "format" => encoding = Some(parse_format(reader, rest)?),
                "comment" => header.comments.push(rest.trim().to_owned()),
                "obj_info" | "" => {}
                "element" => header.elements.push(parse_element(reader, rest, &header)?),
                "property" => {
                    let Some(element) = header.elements.last_mut() else {
                        return Err(reader.fault_in_line("a property before the first element"));
                    };
                    let property = parse_property(reader, rest)?;
                    if element.find(&property.name).is_some() {
                        return Err(reader.fault_in_line(format!(
                            "the property {} of element {} is declared twice",
                            excerpt(&property.name),
                            excerpt(&element.name)
                        )));
                    }
                    if element.properties.len() == NAMES_MAX {
                        let what = format!("more than {NAMES_MAX} properties");
                        return Err(reader.fault_in_line(what));
                    }
                    element.properties.push(property);
                }
                other => {
                    let word = excerpt(other);
                    return Err(reader.fault_in_line(format!("unknown header keyword {word}")));
                }
            }
        }
        match encoding {
            Some(encoding) => header.encoding = encoding,
            None => return Err(reader.fault("the header has no format line")),
        }
        Ok(header)
    }
}

fn parse_format(reader: &Reader, rest: &str) -> Result<Encoding> {
    match rest.split_whitespace().next() {
        Some("ascii") => Ok(Encoding::Ascii),
        Some("binary_little_endian") => Ok(Encoding::LittleEndian),
        Some("binary_big_endian") => Ok(Encoding::BigEndian),
        _ => Err(reader.fault_in_line(format!("unknown format {}", excerpt(rest)))),
    }
}

fn parse_element(reader: &Reader, rest: &str, header: &PlyHeader) -> Result<PlyElement> {
    let mut words = rest.split_whitespace();
    let (Some(name), Some(count)) = (words.next(), words.next()) else {
        return Err(reader.fault_in_line("an element needs a name and a count"));
    };
    if header.element(name).is_some() {
        return Err(reader.fault_in_line(format!("element {} occurs twice", excerpt(name))));
    }
    if header.elements.len() == NAMES_MAX {
        return Err(reader.fault_in_line(format!("more than {NAMES_MAX} elements")));
    }
    let count = count.parse().map_err(|_| {
        reader.fault_in_line(format!(
            "{} is no possible count of element {}",
            excerpt(count),
            excerpt(name)
        ))
    })?;
    Ok(PlyElement {
        name: name.to_owned(),
        count,
        properties: Vec::new(),
    })
}

fn parse_property(reader: &Reader, rest: &str) -> Result<Property> {
    let scalar = |word: &str| {
        Scalar::parse(word).ok_or_else(|| reader.fault_in_line(format!("unknown property type {}", excerpt(word))))
    };
    let words: Vec<&str> = rest.split_whitespace().collect();
    match words[..] {
        ["list", length, item, name] => Ok(Property {
            name: name.to_owned(),
            scalar: scalar(item)?,
            list: Some(scalar(length)?),
        }),
        [kind, name] => Ok(Property {
            name: name.to_owned(),
            scalar: scalar(kind)?,
            list: None,
        }),
        _ => Err(reader.fault_in_line(format!("malformed property {}", excerpt(rest)))),
    }
}
