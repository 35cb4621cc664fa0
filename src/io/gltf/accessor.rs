//! Accessors: columns of numbers in buffers, decoded row by row.

use super::super::check::Check;
use super::buffers::{Buffers, ViewBytes, part};
use super::json::{AccessorJson, Document, ShapeJson, SparseJson, entry};

/// Type of a component.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn of_code(code: u32) -> Check<Component> {
        Ok(match code {
            5120 => Component::I8,
            5121 => Component::U8,
            5122 => Component::I16,
            5123 => Component::U16,
            5125 => Component::U32,
            5126 => Component::F32,
            _ => return Err(format!("there is no component type {code}")),
        })
    }

    fn bytes(self) -> usize {
        match self {
            Component::I8 | Component::U8 => 1,
            Component::I16 | Component::U16 => 2,
            Component::U32 | Component::F32 => 4,
        }
    }

    /// Value at the start of some bytes; normalised integers are divided by their largest value.
    fn value(self, bytes: &[u8], normalized: bool) -> f32 {
        let mut four = [0; 4];
        four[..self.bytes()].copy_from_slice(&bytes[..self.bytes()]);
        let [a, b, ..] = four;
        let (value, largest) = match self {
            Component::I8 => (f32::from(a as i8), 127.0),
            Component::U8 => (f32::from(a), 255.0),
            Component::I16 => (f32::from(i16::from_le_bytes([a, b])), 32_767.0),
            Component::U16 => (f32::from(u16::from_le_bytes([a, b])), 65_535.0),
            Component::U32 => (u32::from_le_bytes(four) as f32, u32::MAX as f32),
            Component::F32 => return f32::from_le_bytes(four),
        };
        match normalized {
            true => (value / largest).max(-1.0),
            false => value,
        }
    }

    /// Whole number at a place in some bytes.
    fn index(self, bytes: &[u8], at: usize) -> u64 {
        let of_index = &bytes[at * self.bytes()..][..self.bytes()];
        of_index
            .iter()
            .rev()
            .fold(0, |value, byte| value << 8 | u64::from(*byte))
    }
}

/// Component type and normalisation that an attribute may have.
pub(super) type ComponentKind = (Component, bool);

/// Rows of an accessor.
pub(super) struct AccessorRows<'a> {
    /// From the first row on; empty for rows of zeros.
    bytes: &'a [u8],
    stride: usize,
    kind: ComponentKind,
    width: usize,
    count: u64,
    sparse: Option<Substitutes<'a>>,
}

/// Rows that replace others: increasing indices, and rows without gaps.
struct Substitutes<'a> {
    count: usize,
    component: Component,
    indices: &'a [u8],
    rows: &'a [u8],
}

impl<'a> AccessorRows<'a> {
    /// Opens an accessor; checks its shape and kind, and that all its rows are in its buffer.
    pub(super) fn open(
        document: &Document,
        buffers: &'a Buffers,
        index: u32,
        shapes: &[ShapeJson],
        kinds: &[ComponentKind],
    ) -> Check<AccessorRows<'a>> {
        let accessor = entry(&document.accessors, index, "accessor")?;
        AccessorRows::of(accessor, buffers, shapes, kinds).map_err(|what| format!("accessor {index}: {what}"))
    }

    fn of(
        accessor: &AccessorJson,
        buffers: &'a Buffers,
        shapes: &[ShapeJson],
        kinds: &[ComponentKind],
    ) -> Check<AccessorRows<'a>> {
        if !shapes.contains(&accessor.shape) {
            return Err(format!("has the type {:?}, but {shapes:?} is wanted", accessor.shape));
        }
        let component = Component::of_code(accessor.component_type)?;
        // A float has no other form.
        let kind = (component, accessor.normalized && component != Component::F32);
        if !kinds.contains(&kind) {
            let form = |(component, normalized): &ComponentKind| {
                format!("{component:?}{}", [" plain", " normalised"][usize::from(*normalized)])
            };
            let known: Vec<String> = kinds.iter().map(form).collect();
            return Err(format!(
                "has components {}, but {} are possible",
                form(&kind),
                known.join(", ")
            ));
        }
        let width = match accessor.shape {
            ShapeJson::Scalar => 1,
            ShapeJson::Vec2 => 2,
            ShapeJson::Vec3 => 3,
            _ => 4,
        };
        let mut column = AccessorRows {
            bytes: &[],
            stride: 0,
            kind,
            width,
            count: accessor.count,
            sparse: None,
        };
        if let Some(view) = accessor.buffer_view {
            column.place(buffers.view(view)?, accessor.byte_offset)?;
        }
        if let Some(sparse) = &accessor.sparse {
            column.sparse = Some(Substitutes::of(sparse, buffers, column.count, column.row_bytes())?);
        }
        Ok(column)
    }

    fn row_bytes(&self) -> usize {
        self.width * self.kind.0.bytes()
    }

    /// Points at the rows in a buffer view.
    fn place(&mut self, view: ViewBytes<'a>, offset: u64) -> Check<()> {
        let row = self.row_bytes() as u64;
        let stride = view.stride.unwrap_or(row);
        if stride < row || stride > 252 {
            return Err(format!(
                "rows of {row} bytes have a stride of {stride} ({row} to 252 is possible)"
            ));
        }
        let Some(last) = self.count.checked_sub(1) else {
            return Ok(());
        };
        let length = last.checked_mul(stride).and_then(|bytes| bytes.checked_add(row));
        self.bytes = length
            .and_then(|length| part(view.bytes, offset, length))
            .ok_or_else(|| {
                let (count, all) = (self.count, view.bytes.len());
                format!("{count} rows of {stride} bytes from byte {offset} are not in a buffer view of {all}")
            })?;
        self.stride = stride as usize;
        Ok(())
    }

    /// Number of rows.
    pub(super) fn count(&self) -> u64 {
        self.count
    }

    /// Whether there are bytes behind the rows.
    pub(super) fn has_data(&self) -> bool {
        !self.bytes.is_empty() || self.sparse.is_some()
    }

    /// A row; numbers beyond its width are 1.
    pub(super) fn row(&self, index: usize) -> [f32; 4] {
        let mut values = [1.0; 4];
        let (component, normalized) = self.kind;
        let bytes = match self
            .sparse
            .as_ref()
            .and_then(|sparse| sparse.row(index, self.row_bytes()))
        {
            Some(bytes) => bytes,
            None if self.bytes.is_empty() => &[0; 16],
            None => &self.bytes[index * self.stride..],
        };
        for (value, bytes) in values[..self.width].iter_mut().zip(bytes.chunks(component.bytes())) {
            *value = component.value(bytes, normalized);
        }
        values
    }

    /// The first three numbers of a row.
    pub(super) fn three(&self, index: usize) -> [f32; 3] {
        let [x, y, z, _] = self.row(index);
        [x, y, z]
    }
}

impl<'a> Substitutes<'a> {
    fn of(sparse: &SparseJson, buffers: &'a Buffers, count: u64, row_bytes: usize) -> Check<Substitutes<'a>> {
        let component = Component::of_code(sparse.indices.component_type.unwrap_or(0))?;
        if ![Component::U8, Component::U16, Component::U32].contains(&component) {
            return Err(format!("sparse indices have components {component:?}"));
        }
        let rows = |part_json: &super::json::SparsePartJson, each: usize, name: &str| {
            let view = buffers.view(part_json.buffer_view)?;
            let length = sparse.count.checked_mul(each as u64);
            length
                .and_then(|length| part(view.bytes, part_json.byte_offset, length))
                .ok_or_else(|| {
                    let all = view.bytes.len();
                    format!(
                        "{} sparse {name} of {each} bytes are not in a buffer view of {all}",
                        sparse.count
                    )
                })
        };
        let indices = rows(&sparse.indices, component.bytes(), "indices")?;
        let substitutes = Substitutes {
            // In bounds: so many indices are in memory.
            count: sparse.count as usize,
            component,
            indices,
            rows: rows(&sparse.values, row_bytes, "values")?,
        };
        let mut last = None;
        for i in 0..substitutes.count {
            let index = component.index(indices, i);
            if index >= count || last.is_some_and(|last| last >= index) {
                return Err(format!(
                    "sparse index {i}, {index}, is not above that before it and below {count}"
                ));
            }
            last = Some(index);
        }
        Ok(substitutes)
    }

    /// Bytes of the row that replaces another.
    fn row(&self, index: usize, row_bytes: usize) -> Option<&'a [u8]> {
        let (mut low, mut high) = (0, self.count);
        while low < high {
            let middle = (low + high) / 2;
            match self.component.index(self.indices, middle).cmp(&(index as u64)) {
                std::cmp::Ordering::Less => low = middle + 1,
                std::cmp::Ordering::Greater => high = middle,
                std::cmp::Ordering::Equal => return Some(&self.rows[middle * row_bytes..][..row_bytes]),
            }
        }
        None
    }
}
