//! The radix sort: both halves of a pass, and whole sorts of random pairs.

use super::{counts, groups, read, wanted};
use crate::Result;
use crate::gpu::{Buffer, Caps, DeviceKind, Gpu, Groups, Recorder};
use crate::kernels::scan::Scan;
use crate::kernels::sort::{Io, Layout, Sort};
use crate::kernels::{sort_count, sort_scatter};
use crate::lab::bench::check::{Output, words};
use crate::lab::bench::input::random::Random;
use crate::lab::bench::{Bench, Case, Unit, Work};
use crate::layout::*;
use crate::reference;

/// Keys of the passes that are measured one by one.
const PASS_KEYS: usize = 1 << 18;
/// Keys of a chunk that passes are tried with.
const CHUNKS: [usize; 2] = [1024, 4096];

pub(super) fn run(bench: &mut Bench) -> Result<()> {
    passes(bench)?;
    let sizes: &[usize] = match bench.gpu().caps().kind {
        DeviceKind::Cpu => &[1 << 16, 1 << 20],
        _ => &[1 << 16, 1 << 20, 1 << 25],
    };
    for &count in sizes {
        whole(bench, count)?;
    }
    Ok(())
}

/// Invocations of a workgroup: few where each has a chunk of its own, many where they share one.
const WORKGROUPS: [u32; 5] = [4, 8, 16, 64, 256];

/// Whether a device can run a variant, and its workgroup makes sense: full subgroups where a workgroup shares a
/// chunk.
fn fits(caps: &Caps, variant: sort_scatter::Variant, workgroup: u32) -> bool {
    if caps.supports(variant.info()).is_err() || workgroup > caps.max_workgroup {
        return false;
    }
    match variant {
        sort_scatter::Variant::Subgroup => {
            workgroup >= 64 && workgroup.is_multiple_of(caps.subgroup_size.max(1))
        }
        sort_scatter::Variant::Base => workgroup <= 16,
    }
}

/// 32-bit keys in passes of eight bits, as depths are sorted.
const LAYOUT: Layout = Layout {
    digit_bits: 8,
    passes: 4,
    count_slot: COUNT_ISECT,
    chunk_slot: COUNT_ISECT_CHUNK,
    table_slot: COUNT_ISECT_TABLE,
    chunk_args: 0,
    table_args: 1,
};

/// Random pairs on the device, ready to be sorted again and again.
pub struct Sorting {
    gpu: Gpu,
    /// The keys.
    pub keys: Vec<u32>,
    keys_before: Buffer<u32>,
    values_before: Buffer<u32>,
    key_buffers: [Buffer<u32>; 2],
    value_buffers: [Buffer<u32>; 2],
    table: Buffer<u32>,
    places: Buffer<u32>,
    sums: Buffer<u32>,
    counts: Buffer<u32>,
    args: Buffer<DispatchArgs>,
    scan: Scan,
    sort: Sort,
}

impl Sorting {
    /// `count` random keys, each with its index as value.
    pub fn new(gpu: &Gpu, count: usize, sort: Sort) -> Result<Sorting> {
        let random = &mut Random::new(count as u64);
        let keys: Vec<u32> = (0..count).map(|_| random.bits() as u32).collect();
        let values: Vec<u32> = (0..count as u32).collect();
        let chunks = sort.chunks(LAYOUT, count);
        let entries = chunks * LAYOUT.digit_count() as usize;
        let scanned = entries.div_ceil(SCAN_CHUNK as usize);
        let slots = [
            (COUNT_ISECT, count as u32),
            (COUNT_ISECT_CHUNK, chunks as u32),
            (COUNT_ISECT_TABLE, entries as u32),
        ];
        let args = [
            groups(chunks, sort.chunks_per_group),
            groups(scanned, Scan::WORKGROUP),
        ];
        let pair = |name| -> Result<[Buffer<u32>; 2]> {
            Ok([gpu.buffer(name, count)?, gpu.buffer(name, count)?])
        };
        Ok(Sorting {
            gpu: gpu.clone(),
            keys_before: gpu.buffer_from("keys", &keys)?,
            values_before: gpu.buffer_from("values", &values)?,
            keys,
            key_buffers: pair("keys")?,
            value_buffers: pair("values")?,
            table: gpu.buffer("table", entries)?,
            places: gpu.buffer("places", entries)?,
            sums: gpu.buffer("sums", scanned)?,
            counts: counts(gpu, &slots)?,
            args: gpu.buffer_from("args", &args)?,
            scan: Scan::new(gpu)?,
            sort,
        })
    }

    /// Puts the unsorted pairs back.
    pub fn prepare(&self, rec: &mut Recorder<'_>) {
        let all = 0..self.keys.len();
        rec.copy(&self.keys_before, all.clone(), &self.key_buffers[0], 0);
        rec.copy(&self.values_before, all, &self.value_buffers[0], 0);
    }

    /// Sorts them.
    pub fn record(&self, rec: &mut Recorder<'_>) {
        let io = Io {
            counts: &self.counts,
            args: &self.args,
            keys: &self.key_buffers,
            values: &self.value_buffers,
            table: &self.table,
            places: &self.places,
            sums: &self.sums,
        };
        self.sort.record(rec, &self.scan, io, LAYOUT);
    }

    /// What one sort does: each pass reads keys to count them, and reads and writes pairs.
    pub fn work(&self) -> Work {
        let count = self.keys.len();
        Work::of(count, Unit::Keys).moving(20 * LAYOUT.passes as usize * count)
    }

    /// What it left, and a stable sort of the same.
    pub fn outputs(&self) -> Result<Vec<Output>> {
        let values: Vec<u32> = (0..self.keys.len() as u32).collect();
        let (sorted, moved) = reference::sort::sort(&self.keys, &values, u32::MAX);
        let at = (LAYOUT.passes % 2) as usize;
        let keys = words(&read(&self.gpu, &self.key_buffers[at])?);
        let found = words(&read(&self.gpu, &self.value_buffers[at])?);
        Ok(vec![
            Output::exact("keys", keys, words(&sorted)),
            Output::exact("values", found, words(&moved)),
        ])
    }
}

fn whole(bench: &mut Bench, count: usize) -> Result<()> {
    let gpu = bench.gpu().clone();
    for &variant in sort_scatter::Variant::ALL {
        for workgroup in WORKGROUPS {
            let case = Case::of("sort", count, variant.name(), workgroup);
            if !fits(gpu.caps(), variant, workgroup) || !bench.wants(&case) {
                continue;
            }
            let Some(sort) = sort_with(&gpu, variant, workgroup)? else {
                continue;
            };
            let sorting = Sorting::new(&gpu, count, sort)?;
            bench.trial(
                &case.doing(sorting.work()),
                |rec| sorting.prepare(rec),
                |rec| sorting.record(rec),
                || sorting.outputs(),
            )?;
        }
    }
    Ok(())
}

/// Both halves in the variant of this name, if there is such a half of each.
fn sort_with(gpu: &Gpu, variant: sort_scatter::Variant, workgroup: u32) -> Result<Option<Sort>> {
    let Some(half) = counterpart(variant.name()) else {
        return Ok(None);
    };
    let count = sort_count::Choice {
        variant: half,
        spec: sort_count::Spec { workgroup },
    };
    let scatter = sort_scatter::Choice {
        variant,
        spec: sort_scatter::Spec { workgroup },
    };
    Sort::with(gpu, count, scatter).map(Some)
}

/// The counting variant that goes with a scattering one: that of the same name.
fn counterpart(name: &str) -> Option<sort_count::Variant> {
    let mut variants = sort_count::Variant::ALL.iter().copied();
    variants.find(|variant| variant.name() == name)
}

fn passes(bench: &mut Bench) -> Result<()> {
    let gpu = bench.gpu().clone();
    let random = &mut Random::new(5);
    let keys: Vec<u32> = (0..PASS_KEYS).map(|_| random.bits() as u32).collect();
    for chunk in CHUNKS {
        count_pass(bench, &gpu, &keys, chunk)?;
        scatter_pass(bench, &gpu, &keys, chunk)?;
    }
    Ok(())
}

/// `[digit][chunk]` of the lowest eight bits: how often each digit occurs in each chunk.
fn table(keys: &[u32], chunk: usize) -> Vec<u32> {
    let chunks = keys.len().div_ceil(chunk);
    let mut table = vec![0; chunks * 256];
    for (i, &key) in keys.iter().enumerate() {
        table[(key & 255) as usize * chunks + i / chunk] += 1;
    }
    table
}

fn count_pass(bench: &mut Bench, gpu: &Gpu, keys: &[u32], chunk: usize) -> Result<()> {
    let input = format!("{}/chunk-{chunk}", keys.len());
    let expected = table(keys, chunk);
    let work = Work::of(keys.len(), Unit::Keys).moving(4 * (keys.len() + expected.len()));
    let chunks = keys.len().div_ceil(chunk);
    let slots = [
        (COUNT_ISECT, keys.len() as u32),
        (COUNT_ISECT_CHUNK, chunks as u32),
    ];
    let counts = counts(gpu, &slots)?;
    let buffer = gpu.buffer_from("keys", keys)?;
    let counted = gpu.buffer("table", expected.len())?;
    for (variant, workgroup, case) in wanted!(bench, sort_count, input, WORKGROUPS, work) {
        let by_workgroup = variant == sort_count::Variant::Subgroup;
        let twin = sort_scatter::Variant::ALL
            .iter()
            .find(|twin| twin.name() == variant.name());
        if !twin.is_some_and(|&twin| fits(gpu.caps(), twin, workgroup)) {
            continue;
        }
        let spec = sort_count::Spec { workgroup };
        let kernel = sort_count::SortCount::new(gpu, sort_count::Choice { variant, spec })?;
        let io = sort_count::Bindings {
            counts: &counts,
            keys: &buffer,
            table: &counted,
        };
        let params = sort_count::Params {
            count_slot: COUNT_ISECT,
            chunk_slot: COUNT_ISECT_CHUNK,
            shift: 0,
            digit_count: 256,
        };
        let args = super::args(gpu, chunks, if by_workgroup { 1 } else { workgroup })?;
        bench.trial(
            &case,
            |rec| rec.fill(&counted, u32::MAX),
            |rec| kernel.record(rec, io, params, Groups::indirect(&args, 0)),
            || {
                let found = words(&read(gpu, &counted)?);
                Ok(vec![Output::exact("table", found, words(&expected))])
            },
        )?;
    }
    Ok(())
}

fn scatter_pass(bench: &mut Bench, gpu: &Gpu, keys: &[u32], chunk: usize) -> Result<()> {
    let input = format!("{}/chunk-{chunk}", keys.len());
    let (places, _) = reference::scan::scan(&table(keys, chunk));
    let values: Vec<u32> = (0..keys.len() as u32).collect();
    let (sorted, moved) = reference::sort::sort(keys, &values, 255);
    let work = Work::of(keys.len(), Unit::Keys).moving(16 * keys.len() + 4 * places.len());
    let chunks = keys.len().div_ceil(chunk);
    let slots = [
        (COUNT_ISECT, keys.len() as u32),
        (COUNT_ISECT_CHUNK, chunks as u32),
    ];
    let counts = counts(gpu, &slots)?;
    let [keys_in, values_in] = [
        gpu.buffer_from("keys", keys)?,
        gpu.buffer_from("values", &values)?,
    ];
    let [keys_out, values_out] = [
        gpu.buffer("keys", keys.len())?,
        gpu.buffer("values", keys.len())?,
    ];
    let before = gpu.buffer_from("places", &places)?;
    let table = gpu.buffer("table", places.len())?;
    for (variant, workgroup, case) in wanted!(bench, sort_scatter, input, WORKGROUPS, work) {
        let by_workgroup = variant == sort_scatter::Variant::Subgroup;
        if !fits(gpu.caps(), variant, workgroup) {
            continue;
        }
        let spec = sort_scatter::Spec { workgroup };
        let kernel = sort_scatter::SortScatter::new(gpu, sort_scatter::Choice { variant, spec })?;
        let io = sort_scatter::Bindings {
            counts: &counts,
            keys: &keys_in,
            values: &values_in,
            table: &table,
            keys_out: &keys_out,
            values_out: &values_out,
        };
        let params = sort_scatter::Params {
            count_slot: COUNT_ISECT,
            chunk_slot: COUNT_ISECT_CHUNK,
            shift: 0,
            digit_count: 256,
        };
        let args = super::args(gpu, chunks, if by_workgroup { 1 } else { workgroup })?;
        bench.trial(
            &case,
            |rec| rec.copy(&before, 0..before.len(), &table, 0),
            |rec| kernel.record(rec, io, params, Groups::indirect(&args, 0)),
            || {
                Ok(vec![
                    Output::exact("keys", words(&read(gpu, &keys_out)?), words(&sorted)),
                    Output::exact("values", words(&read(gpu, &values_out)?), words(&moved)),
                ])
            },
        )?;
    }
    Ok(())
}
