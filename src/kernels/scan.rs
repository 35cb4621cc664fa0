//! Exclusive prefix sums of any length, by three kernels: reduce, scan, apply. No workgroup waits for another within a
//! dispatch, because Vulkan does not guarantee forward progress.

use super::{scan_apply, scan_chunks, scan_reduce};
use crate::Result;
use crate::gpu::{Buffer, Gpu, Groups, Recorder};
use crate::layout::SCAN_CHUNK;

/// The three kernels.
#[derive(Debug)]
pub struct Scan {
    reduce: scan_reduce::ScanReduce,
    chunks: scan_chunks::ScanChunks,
    apply: scan_apply::ScanApply,
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

impl Scan {
    /// Invocations of a workgroup, one per chunk.
    pub const WORKGROUP: u32 = 64;

    /// Compiles the kernels.
    pub fn new(gpu: &Gpu) -> Result<Scan> {
        Ok(Scan {
            reduce: scan_reduce::ScanReduce::new(gpu, scan_reduce::Choice::default())?,
            chunks: scan_chunks::ScanChunks::new(gpu, scan_chunks::Choice::default())?,
            apply: scan_apply::ScanApply::new(gpu, scan_apply::Choice::default())?,
        })
    }

    /// Workgroups for `count` values.
    pub fn groups(count: usize) -> Groups<'static> {
        Groups::Count((count as u32).div_ceil(SCAN_CHUNK).div_ceil(Scan::WORKGROUP))
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
