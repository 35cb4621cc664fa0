//! Exclusive prefix sums of any length, by three kernels: reduce, scan, apply. No workgroup waits for another within a
//! dispatch, because Vulkan does not guarantee forward progress.

use super::{scan_apply, scan_chunks, scan_reduce};
use crate::Result;
use crate::gpu::{Buffer, Caps, DeviceKind, Gpu, Groups, Recorder};
use crate::layout::SCAN_CHUNK;

/// The three kernels.
#[derive(Debug)]
pub struct Scan {
    reduce: scan_reduce::ScanReduce,
    chunks: scan_chunks::ScanChunks,
    apply: scan_apply::ScanApply,
    /// Chunks that one workgroup of the first and of the last kernel handles.
    pub chunks_per_group: u32,
}

/// Buffers of a prefix sum.
#[derive(Clone, Copy)]
pub struct Io<'a> {
    /// The device's counts.
    pub counts: &'a Buffer<u32>,
    /// Input values.
    pub values: &'a Buffer<u32>,
    /// Sum of the values before each one; may not be `values`.
    pub offsets: &'a Buffer<u32>,
    /// One sum per chunk of `SCAN_CHUNK` values.
    pub sums: &'a Buffer<u32>,
}

/// Parameters of a prefix sum.
#[derive(Clone, Copy, Debug)]
pub struct What {
    /// Slot of the number of values.
    pub count_slot: u32,
    /// Slot of the total.
    pub total_slot: u32,
    /// Sum "is not 0" instead of the values.
    pub flags: bool,
}

macro_rules! choices {
    ($($kernel:ident: $workgroup:literal)*) => {$(
        impl $kernel::Choice {
            /// Choice for a device: neighbouring lanes take neighbouring values; not on processors, which run one lane
            /// after the other.
            pub fn prefer(caps: &Caps) -> Self {
                let mut choice = Self::default();
                if caps.kind != DeviceKind::Cpu {
                    choice.variant = $kernel::Variant::Workgroup;
                    choice.spec.workgroup = caps.max_workgroup.min($workgroup);
                }
                choice
            }
        }
    )*};
}

choices! { scan_reduce: 64 scan_chunks: 256 scan_apply: 64 }

/// Reason for the choice of the kernels, one sentence.
pub(super) fn why(caps: &Caps) -> &'static str {
    match caps.kind {
        DeviceKind::Cpu => {
            "an invocation a chunk: a processor runs one lane after the other, and pays for every barrier"
        }
        _ => "a workgroup a chunk: neighbouring lanes load neighbouring values",
    }
}

impl Scan {
    /// Compiles the kernels with the preferred choices.
    pub fn new(gpu: &Gpu) -> Result<Scan> {
        let reduce = scan_reduce::Choice::prefer(gpu.caps());
        let apply = scan_apply::Choice::prefer(gpu.caps());
        let chunks_per_group = match reduce.variant {
            scan_reduce::Variant::Base => reduce.spec.workgroup,
            scan_reduce::Variant::Workgroup => 1,
        };
        Ok(Scan {
            reduce: scan_reduce::ScanReduce::new(gpu, reduce)?,
            chunks: scan_chunks::ScanChunks::new(gpu, scan_chunks::Choice::prefer(gpu.caps()))?,
            apply: scan_apply::ScanApply::new(gpu, apply)?,
            chunks_per_group,
        })
    }

    /// Workgroups for `count` values.
    pub fn groups(&self, count: usize) -> Groups<'static> {
        Groups::Count((count as u32).div_ceil(SCAN_CHUNK).div_ceil(self.chunks_per_group))
    }

    /// Records a prefix sum; `groups` covers the number of values.
    pub fn record(&self, rec: &mut Recorder<'_>, io: Io<'_>, what: What, groups: Groups<'_>) {
        let (counts, values, sum_from_chunk) = (io.counts, io.values, io.sums);
        let (count_slot, total_slot, flags) = (what.count_slot, what.total_slot, what.flags.into());
        self.reduce.record(
            rec,
            scan_reduce::Bindings {
                counts,
                values,
                sum_from_chunk,
            },
            scan_reduce::Params { count_slot, flags },
            groups,
        );
        self.chunks.record(
            rec,
            scan_chunks::Bindings { counts, sum_from_chunk },
            scan_chunks::Params { count_slot, total_slot },
            Groups::Count(1),
        );
        self.apply.record(
            rec,
            scan_apply::Bindings {
                counts,
                values,
                sum_from_chunk,
                offsets: io.offsets,
            },
            scan_apply::Params { count_slot, flags },
            groups,
        );
    }
}
