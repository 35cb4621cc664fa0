//! Stable radix sort of (key, value) pairs with a count on the device: for each digit, from the lowest, count, sum and
//! scatter.

use super::scan::{Io as ScanBuffers, Scan, What};
use super::{sort_count, sort_scatter, subgroups_help};
use crate::Result;
use crate::gpu::{Buffer, Caps, DeviceKind, Gpu, Groups, Recorder};
use crate::layout::{COUNT_SCRATCH, DispatchArgs, SORT_DIGITS_MAX};

/// The kernels of a pass.
#[derive(Debug)]
pub struct Sort {
    count: sort_count::SortCount,
    scatter: sort_scatter::SortScatter,
    /// Chunks that one workgroup of both kernels handles.
    pub chunks_per_group: u32,
    /// True if a chunk has a whole workgroup.
    by_workgroup: bool,
}

/// Buffers of a sort.
#[derive(Clone, Copy, Debug)]
pub struct Io<'a> {
    /// The device's counts; the slots are in [`Layout`].
    pub counts: &'a Buffer<u32>,
    /// Dispatch sizes that `plan` derived from the counts.
    pub args: &'a Buffer<DispatchArgs>,
    /// Two buffers of keys, at first in buffer 0; each pass reads one and writes the other.
    pub keys: &'a [Buffer<u32>],
    /// Values, likewise.
    pub values: &'a [Buffer<u32>],
    /// `[digit][chunk]`: counts.
    pub table: &'a Buffer<u32>,
    /// `[digit][chunk]`: offsets.
    pub places: &'a Buffer<u32>,
    /// Chunk sums of the scan.
    pub sums: &'a Buffer<u32>,
}

/// Division of keys into digits and chunks, with the slots and arguments that `plan` fills.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Bits of a digit.
    pub digit_bits: u32,
    /// Digits to sort by, from the lowest bit.
    pub passes: u32,
    /// Slot of the number of keys.
    pub count_slot: u32,
    /// Slot of the number of chunks.
    pub chunk_slot: u32,
    /// Slot of the number of table entries.
    pub table_slot: u32,
    /// Dispatch arguments over chunks.
    pub chunk_args: u32,
    /// Dispatch arguments of the scan over table entries.
    pub table_args: u32,
}

impl Layout {
    /// Entries of one chunk's table.
    pub fn digit_count(&self) -> u32 {
        1 << self.digit_bits
    }

    /// Most entries of the table for up to `count` keys on any device; see [`Sort::chunks`].
    pub fn table_len(&self, count: usize) -> usize {
        let digits = self.digit_count() as usize;
        let by_workgroup = (count / workgroup_keys(self.digit_count()) as usize).max(2) * digits;
        let lanes = sort_scatter::Spec::default().workgroup as usize;
        let by_invocation = (count / KEYS_PER_ENTRY as usize).max(2 * lanes * digits);
        by_workgroup.max(by_invocation)
    }
}

/// Least keys of a chunk sorted by a workgroup: a block of 256 lanes, and several keys per table entry.
fn workgroup_keys(digit_count: u32) -> u32 {
    (4 * digit_count).max(2048)
}

/// Least keys per table entry of a chunk sorted by one invocation: an entry is cleared, written, summed and read, which
/// costs a software device somewhat more than a key does.
const KEYS_PER_ENTRY: u32 = 24;

/// Workgroup size of the variants with a workgroup per chunk.
const SUBGROUP_WORKGROUP: u32 = 256;

/// True if a workgroup sorts each chunk. Both kernels of the sort use this, because both must divide the keys alike.
fn by_subgroup(caps: &Caps) -> bool {
    let scatter = sort_scatter::Variant::Subgroup.info();
    caps.max_workgroup >= SUBGROUP_WORKGROUP && subgroups_help(caps, scatter, SUBGROUP_WORKGROUP)
}

macro_rules! choices {
    ($($kernel:ident)*) => {$(
        impl $kernel::Choice {
            /// Choice for a device: a workgroup per chunk if lanes are many and cheap, else an invocation per chunk.
            pub fn prefer(caps: &Caps) -> Self {
                let mut choice = Self::default();
                if by_subgroup(caps) {
                    choice.variant = $kernel::Variant::Subgroup;
                    choice.spec.workgroup = SUBGROUP_WORKGROUP;
                }
                choice
            }
        }
    )*};
}

choices! { sort_count sort_scatter }

/// Reason for the choice of the sort's kernels, one sentence.
pub(super) fn why(caps: &Caps) -> &'static str {
    match (by_subgroup(caps), caps.kind) {
        (true, _) => "a workgroup a chunk, keys ranked by ballots: lanes are many, and their loads are shared",
        (_, DeviceKind::Cpu) => {
            "an invocation a chunk, with a table of its own: a processor runs one lane after the other, and pays for \
             every ballot"
        }
        _ => "an invocation a chunk: subgroups cannot vote by ballot here, or workgroups of 256 do not fit",
    }
}

impl Sort {
    /// Compiles the kernels with the preferred choices.
    pub fn new(gpu: &Gpu) -> Result<Sort> {
        Sort::with(
            gpu,
            sort_count::Choice::prefer(gpu.caps()),
            sort_scatter::Choice::prefer(gpu.caps()),
        )
    }

    /// Compiles the kernels with these choices. Both must give a workgroup the same number of chunks.
    pub fn with(gpu: &Gpu, count: sort_count::Choice, scatter: sort_scatter::Choice) -> Result<Sort> {
        let chunks_per_group = match count.variant {
            sort_count::Variant::Base => count.spec.workgroup,
            sort_count::Variant::Subgroup => 1,
        };
        let scattered = match scatter.variant {
            sort_scatter::Variant::Base => scatter.spec.workgroup,
            sort_scatter::Variant::Subgroup => 1,
        };
        assert_eq!(chunks_per_group, scattered, "chunks per workgroup differ");
        Ok(Sort {
            count: sort_count::SortCount::new(gpu, count)?,
            scatter: sort_scatter::SortScatter::new(gpu, scatter)?,
            chunks_per_group,
            by_workgroup: scatter.variant == sort_scatter::Variant::Subgroup,
        })
    }

    /// Least keys of a chunk, beyond two workgroups of chunks; a parameter of `plan`. An invocation's loops over up to
    /// twice these keys and their table stay below 65,535 iterations, after which llvmpipe leaves loops.
    pub fn chunk(&self, layout: Layout) -> u32 {
        match self.by_workgroup {
            true => workgroup_keys(layout.digit_count()),
            false => KEYS_PER_ENTRY * layout.digit_count(),
        }
    }

    /// Number of chunks into which `plan` divides `count` keys.
    pub fn chunks(&self, layout: Layout, count: usize) -> usize {
        let twice = 2 * self.chunks_per_group as usize;
        match count {
            0 => 0,
            _ => twice * (count / (twice * self.chunk(layout) as usize)).max(1),
        }
    }

    /// Records the sort; returns the index of the buffers with the result.
    pub fn record(&self, rec: &mut Recorder<'_>, scan: &Scan, io: Io<'_>, layout: Layout) -> usize {
        let digits = layout.digit_count();
        assert!(digits <= SORT_DIGITS_MAX, "{digits} digits");
        for pass in 0..layout.passes {
            self.record_pass(rec, scan, io, layout, pass);
        }
        (layout.passes % 2) as usize
    }

    /// One digit: counts it per chunk, scans the counts to offsets, and moves the pairs there.
    fn record_pass(&self, rec: &mut Recorder<'_>, scan: &Scan, io: Io<'_>, layout: Layout, pass: u32) {
        let Io { counts, args, .. } = io;
        let (from, to) = ((pass % 2) as usize, (pass % 2) as usize ^ 1);
        let (count_slot, chunk_slot) = (layout.count_slot, layout.chunk_slot);
        let chunks = Groups::indirect(args, layout.chunk_args as usize);
        let (shift, digit_count) = (pass * layout.digit_bits, layout.digit_count());
        self.count.record(
            rec,
            sort_count::Bindings {
                counts,
                keys: &io.keys[from],
                table: io.table,
            },
            sort_count::Params {
                count_slot,
                chunk_slot,
                shift,
                digit_count,
            },
            chunks,
        );
        scan.record(
            rec,
            ScanBuffers {
                counts,
                values: io.table,
                offsets: io.places,
                sums: io.sums,
            },
            What {
                count_slot: layout.table_slot,
                total_slot: COUNT_SCRATCH,
                flags: false,
            },
            Groups::indirect(args, layout.table_args as usize),
        );
        self.scatter.record(
            rec,
            sort_scatter::Bindings {
                counts,
                keys: &io.keys[from],
                values: &io.values[from],
                table: io.places,
                keys_out: &io.keys[to],
                values_out: &io.values[to],
            },
            sort_scatter::Params {
                count_slot,
                chunk_slot,
                shift,
                digit_count,
            },
            chunks,
        );
    }
}
