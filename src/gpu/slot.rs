//! Bindings and sizes of dispatches.

use super::buffer::{Buffer, RawBuffer};
use super::image::Image;
use ash::vk::Handle;
use bytemuck::Pod;
use std::sync::Arc;

/// Something bound to a dispatch: a buffer or an image.
#[derive(Clone, Copy)]
pub struct Slot<'a> {
    pub(super) kind: SlotKind<'a>,
}

#[derive(Clone, Copy)]
pub(super) enum SlotKind<'a> {
    Buffer {
        raw: &'a Arc<RawBuffer>,
        offset: u64,
        /// Bytes, never 0: an empty array is bound with the word that follows.
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

/// How many workgroups a dispatch has.
#[derive(Clone, Copy)]
pub enum Groups<'a> {
    /// So many in all; folded into a second dimension where the device's limit demands it. Kernels use
    /// `group_index()` and check bounds.
    Count(u32),
    /// A grid.
    Grid([u32; 3]),
    /// Read from element `index` of a buffer of three-word records when the dispatch runs.
    Indirect(Slot<'a>, usize),
}

impl<'a> Groups<'a> {
    /// Sizes that the device has computed: element `index` of `args`, whose elements are three words.
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
