//! A stable radix sort of (key, value) pairs whose number only the device knows: for each digit, from the
//! lowest, count, sum and scatter.

use super::scan::{Io as ScanBuffers, Scan, What};
use super::{sort_count, sort_scatter};
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
    /// Whether a chunk has a whole workgroup.
    by_workgroup: bool,
}

/// Two of each, and which one holds the data.
#[derive(Clone, Debug)]
pub struct Pairs {
    /// Keys; each pass goes from one to the other.
    pub keys: [Buffer<u32>; 2],
    /// Values likewise.
    pub values: [Buffer<u32>; 2],
}

/// A digit table per chunk, and its prefix sum.
#[derive(Clone, Debug)]
pub struct Tables {
    /// `[digit][chunk]`, counts.
    pub counted: Buffer<u32>,
    /// `[digit][chunk]`, places.
    pub places: Buffer<u32>,
    /// Chunk sums of the scan.
    pub sums: Buffer<u32>,
}

/// What a sort reads and writes.
#[derive(Clone, Copy, Debug)]
pub struct Io<'a> {
    /// The device's counts; the layout says which slots.
    pub counts: &'a Buffer<u32>,
    /// The dispatch sizes that `plan` derived from them.
    pub args: &'a Buffer<DispatchArgs>,
    /// What is sorted: the first of the two, at first.
    pub pairs: &'a Pairs,
    /// Scratch.
    pub tables: &'a Tables,
}

/// How keys are split into digits and chunks, and the slots and arguments that `plan` filled for them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Bits of a digit.
    pub digit_bits: u32,
    /// Digits to sort by, from the lowest bit.
    pub passes: u32,
    /// The slot of the number of keys.
    pub count_slot: u32,
    /// The slot of the number of chunks.
    pub chunk_slot: u32,
    /// The slot of the number of table entries.
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

    /// Most entries of the table for up to `count` keys, on any device: as [`Sort::chunks`] has them.
    pub fn table_len(&self, count: usize) -> usize {
        let digits = self.digit_count() as usize;
        let by_workgroup = (count / WORKGROUP_KEYS as usize).max(2) * digits;
        let lanes = sort_scatter::Spec::default().workgroup as usize;
        let by_invocation = (count / KEYS_PER_ENTRY as usize).max(2 * lanes * digits);
        by_workgroup.max(by_invocation)
    }
}

/// Least keys of a chunk that a whole workgroup sorts, of many: a few turns of the workgroup.
const WORKGROUP_KEYS: u32 = 4096;

/// Least keys of a chunk that one invocation sorts, for each entry of its table: an entry is cleared, written, summed
/// and read, which costs a software device somewhat more than a key does.
const KEYS_PER_ENTRY: u32 = 24;

/// Invocations of a workgroup of the variants that give a chunk to a whole workgroup.
const SUBGROUP_WORKGROUP: u32 = 256;

/// Whether a chunk is best sorted by a whole workgroup: not where a processor runs one lane after the other.
/// Both kernels of the sort go by this, since both must cut the keys alike.
fn by_subgroup(caps: &Caps) -> bool {
    caps.kind != DeviceKind::Cpu
        && caps
            .supports(sort_scatter::Variant::Subgroup.info())
            .is_ok()
        && caps.max_workgroup >= SUBGROUP_WORKGROUP
        && SUBGROUP_WORKGROUP.is_multiple_of(caps.subgroup_size.max(1))
}

macro_rules! choices {
    ($($kernel:ident)*) => {$(
        impl $kernel::Choice {
            /// Choice for a device: a workgroup per chunk where lanes are many and cheap, else an invocation per chunk.
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

/// Why the sort's kernels are as they are, in a sentence.
pub(super) fn why(caps: &Caps) -> &'static str {
    match (by_subgroup(caps), caps.kind) {
        (true, _) => {
            "a workgroup a chunk, keys ranked by ballots: lanes are many, and their loads are shared (by design; not \
             measured on this class of devices)"
        }
        (_, DeviceKind::Cpu) => {
            "an invocation a chunk, with a table of its own: a processor runs one lane after the other, and pays for \
             every ballot"
        }
        _ => {
            "an invocation a chunk: subgroups cannot vote by ballot here, or workgroups of 256 do not fit"
        }
    }
}

impl Sort {
    /// Compiles the kernels as the device prefers.
    pub fn new(gpu: &Gpu) -> Result<Sort> {
        Sort::with(
            gpu,
            sort_count::Choice::prefer(gpu.caps()),
            sort_scatter::Choice::prefer(gpu.caps()),
        )
    }

    /// Compiles the kernels as chosen. Both must give a workgroup the same number of chunks.
    pub fn with(
        gpu: &Gpu,
        count: sort_count::Choice,
        scatter: sort_scatter::Choice,
    ) -> Result<Sort> {
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

    /// Least keys of a chunk where there are more than two workgroups of chunks: what `plan` is told. An invocation's
    /// loops over as many as two chunks of these and their table take no more turns than the 65,535 after which
    /// llvmpipe leaves them.
    pub fn chunk(&self, layout: Layout) -> u32 {
        match self.by_workgroup {
            true => WORKGROUP_KEYS,
            false => KEYS_PER_ENTRY * layout.digit_count(),
        }
    }

    /// Chunks that `plan` thresholds `count` keys into.
    pub fn chunks(&self, layout: Layout, count: usize) -> usize {
        let twice = 2 * self.chunks_per_group as usize;
        match count {
            0 => 0,
            _ => twice * (count / (twice * self.chunk(layout) as usize)).max(1),
        }
    }

    /// Records the sort; returns which of the pairs holds the result.
    pub fn record(&self, rec: &mut Recorder<'_>, scan: &Scan, io: Io<'_>, layout: Layout) -> usize {
        let digits = layout.digit_count();
        assert!(digits <= SORT_DIGITS_MAX, "{digits} digits");
        for pass in 0..layout.passes {
            self.record_pass(rec, scan, io, layout, pass);
        }
        (layout.passes % 2) as usize
    }

    /// One digit: counts it per chunk, turns the counts into places, and moves the pairs there.
    fn record_pass(
        &self,
        rec: &mut Recorder<'_>,
        scan: &Scan,
        io: Io<'_>,
        layout: Layout,
        pass: u32,
    ) {
        let Io {
            counts,
            args,
            pairs,
            tables,
        } = io;
        let (from, to) = ((pass % 2) as usize, (pass % 2) as usize ^ 1);
        let (count_slot, chunk_slot) = (layout.count_slot, layout.chunk_slot);
        let chunks = Groups::indirect(args, layout.chunk_args as usize);
        let (shift, digit_count) = (pass * layout.digit_bits, layout.digit_count());
        self.count.record(
            rec,
            sort_count::Bindings {
                counts,
                keys: &pairs.keys[from],
                table: &tables.counted,
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
                values: &tables.counted,
                offsets: &tables.places,
                sums: &tables.sums,
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
                keys: &pairs.keys[from],
                values: &pairs.values[from],
                table: &tables.places,
                keys_out: &pairs.keys[to],
                values_out: &pairs.values[to],
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
