//! Bindings and sizes of dispatches.

use super::buffer::{Buffer, RawBuffer};
use super::image::Image;
use ash::vk::Handle;
use bytemuck::Pod;
use std::sync::Arc;

/// Buffer or image bound to a dispatch.
#[derive(Clone, Copy)]
pub struct Slot<'a> {
    pub(super) kind: SlotKind<'a>,
}

#[derive(Clone, Copy)]
pub(super) enum SlotKind<'a> {
    Buffer {
        raw: &'a Arc<RawBuffer>,
        offset: u64,
        /// Bytes, at least 4: an empty array is bound as one word.
        bytes: u64,
    },
    Image(&'a Image),
}

impl<'a, T: Pod> From<&'a Buffer<T>> for Slot<'a> {
    fn from(buffer: &'a Buffer<T>) -> Slot<'a> {
        Slot {
            kind: SlotKind::Buffer {
                raw: &buffer.raw,
                offset: buffer.offset,
                bytes: buffer.reach(),
            },
        }
    }
}

impl<'a> From<&'a Image> for Slot<'a> {
    fn from(image: &'a Image) -> Slot<'a> {
        Slot {
            kind: SlotKind::Image(image),
        }
    }
}

impl Slot<'_> {
    pub(super) fn id(&self) -> u64 {
        match self.kind {
            SlotKind::Buffer { raw, .. } => raw.handle.as_raw(),
            SlotKind::Image(image) => image.image.as_raw(),
        }
    }
}

/// Number of workgroups of a dispatch.
#[derive(Clone, Copy)]
pub enum Groups<'a> {
    /// Total count; folded into a second dimension beyond the device's limit. Kernels use `group_index()` and check
    /// bounds.
    Count(u32),
    /// Workgroups in x, y and z.
    Grid([u32; 3]),
    /// Element `index` of a buffer of three-word records, read when the dispatch runs.
    Indirect(Slot<'a>, usize),
}

impl<'a> Groups<'a> {
    /// Size computed on the device: element `index` of `args`, an array of three-word elements.
    pub fn indirect<T: Pod>(args: &'a Buffer<T>, index: usize) -> Groups<'a> {
        assert_eq!(
            size_of::<T>(),
            12,
            "{}: dispatch arguments are three words",
            args.name()
        );
        assert!(index < args.len(), "{}: no element {index}", args.name());
        Groups::Indirect(args.into(), index)
    }
}
