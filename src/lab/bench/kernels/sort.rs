//! Cases of the radix sort: both halves of a pass, and whole sorts.

use super::{KernelCase, Workgroups, chunk_groups, counts, read, time};
use crate::Result;
use crate::gpu::{Buffer, DeviceKind, Gpu, Recorder};
use crate::kernels::scan::Scan;
use crate::kernels::sort::{Io, Layout, Sort};
use crate::kernels::{Kernel, sort_count, sort_scatter};
use crate::lab::bench::check::{Output, words};
use crate::lab::bench::input::random::Random;
use crate::lab::bench::{Bench, Work};
use crate::layout::*;
use crate::reference;
use crate::shader::KernelInfo;

/// Keys of the passes that are measured one by one.
const PASS_KEYS: usize = 1 << 18;

/// Workgroups: few invocations where each has a chunk of its own, many where they share one.
const WORKGROUPS: Workgroups = Workgroups::subgroups(&[8, 64, 256]);

pub(super) fn run(bench: &mut Bench) -> Result<()> {
    for chunk in [1024, 4096] {
        let name = format!("{PASS_KEYS}/chunk-{chunk}");
        let digit = Digit {
            bits: 8,
            shift: 0,
            chunks: PASS_KEYS / chunk,
        };
        time(bench, WORKGROUPS, &name, |gpu| count(gpu, &keys(PASS_KEYS), digit))?;
        time(bench, WORKGROUPS, &name, |gpu| scatter(gpu, &keys(PASS_KEYS), digit))?;
    }
    let sizes: &[usize] = match bench.gpu().caps().kind {
        DeviceKind::Cpu => &[1 << 16, 1 << 20],
        _ => &[1 << 16, 1 << 20, 1 << 25],
    };
    for &count in sizes {
        time(bench, WORKGROUPS, count, |gpu| sort(gpu, keys(count), layout(8, 4)))?;
    }
    Ok(())
}

/// Random keys.
pub fn keys(count: usize) -> Vec<u32> {
    let random = &mut Random::new(count as u64);
    (0..count).map(|_| random.bits() as u32).collect()
}

/// Digits of so many bits in so many passes, in the slots of the tiles' sort.
pub const fn layout(digit_bits: u32, passes: u32) -> Layout {
    Layout {
        digit_bits,
        passes,
        count_slot: COUNT_ISECT,
        chunk_slot: COUNT_ISECT_CHUNK,
        table_slot: COUNT_ISECT_TABLE,
        chunk_args: 0,
        table_args: 1,
    }
}

/// The digit of a pass, and the number of chunks.
#[derive(Clone, Copy, Debug)]
pub struct Digit {
    /// Bits of the digit.
    pub bits: u32,
    /// Bits below it.
    pub shift: u32,
    /// Chunks, of whole quadruples of keys; the last may be empty.
    pub chunks: usize,
}

impl Digit {
    /// `[digit][chunk]`: how often each digit occurs in each chunk.
    fn table(self, keys: &[u32]) -> Vec<u32> {
        let digits = 1 << self.bits;
        let mut table = vec![0; self.chunks * digits];
        let size = keys.len().div_ceil(self.chunks).next_multiple_of(4);
        for (i, &key) in keys.iter().enumerate() {
            let digit = (key >> self.shift) as usize & (digits - 1);
            table[digit * self.chunks + i / size] += 1;
        }
        table
    }

    fn counts(self, gpu: &Gpu, keys: usize) -> Result<Buffer<u32>> {
        let chunks = (COUNT_ISECT_CHUNK, self.chunks as u32);
        counts(gpu, &[(COUNT_ISECT, keys as u32), chunks])
    }
}

/// Digits counted by chunk.
pub fn count<'a>(gpu: &Gpu, keys: &[u32], digit: Digit) -> Result<KernelCase<'a, sort_count::SortCount>> {
    let expected = digit.table(keys);
    let counts = digit.counts(gpu, keys.len())?;
    let work = Work::of(keys.len(), "keys").moving(4 * (keys.len() + expected.len()));
    let keys = gpu.buffer_from("keys", keys)?;
    let table = gpu.buffer::<u32>("table", expected.len() + 1)?;
    let case = KernelCase::new(work).exact("table", &table, words(&expected));
    Ok(case.commands(move |rec, kernel: &sort_count::SortCount, choice| {
        let io = sort_count::Bindings {
            counts: &counts,
            keys: &keys,
            table: &table,
        };
        let params = sort_count::Params {
            count_slot: COUNT_ISECT,
            chunk_slot: COUNT_ISECT_CHUNK,
            shift: digit.shift,
            digit_count: 1 << digit.bits,
        };
        let by_workgroup = choice.variant == sort_count::Variant::Subgroup;
        let groups = chunk_groups(digit.chunks, by_workgroup, kernel.workgroup);
        kernel.record(rec, io, params, groups);
    }))
}

/// Pairs moved to the places of their digits; the values are the keys' indices.
pub fn scatter<'a>(gpu: &Gpu, keys: &[u32], digit: Digit) -> Result<KernelCase<'a, sort_scatter::SortScatter>> {
    let len = keys.len();
    let (places, _) = reference::scan::scan(&digit.table(keys));
    let values: Vec<u32> = (0..len as u32).collect();
    let mask = ((1u32 << digit.bits) - 1) << digit.shift;
    let (sorted, moved) = reference::sort::sort(keys, &values, mask);
    let counts = digit.counts(gpu, len)?;
    let work = Work::of(len, "keys").moving(16 * len + 4 * places.len());
    let keys = gpu.buffer_from("keys", keys)?;
    let values = gpu.buffer_from("values", &values)?;
    let [keys_out, values_out] = ["keys", "values"].map(|name| gpu.buffer::<u32>(name, len + 1));
    let (keys_out, values_out) = (keys_out?, values_out?);
    let before = gpu.buffer_from("places", &places)?;
    let table = gpu.buffer::<u32>("table", places.len())?;
    let case = KernelCase::new(work)
        .copy(&before, &table)
        .exact("keys", &keys_out, words(&sorted))
        .exact("values", &values_out, words(&moved));
    Ok(case.commands(move |rec, kernel: &sort_scatter::SortScatter, choice| {
        let io = sort_scatter::Bindings {
            counts: &counts,
            keys: &keys,
            values: &values,
            table: &table,
            keys_out: &keys_out,
            values_out: &values_out,
        };
        let params = sort_scatter::Params {
            count_slot: COUNT_ISECT,
            chunk_slot: COUNT_ISECT_CHUNK,
            shift: digit.shift,
            digit_count: 1 << digit.bits,
        };
        let by_workgroup = choice.variant == sort_scatter::Variant::Subgroup;
        let groups = chunk_groups(digit.chunks, by_workgroup, kernel.workgroup);
        kernel.record(rec, io, params, groups);
    }))
}

/// A whole sort of keys with their indices.
pub fn sort<'a>(gpu: &Gpu, keys: Vec<u32>, layout: Layout) -> Result<KernelCase<'a, Sort>> {
    let sorting = std::rc::Rc::new(Sorting::new(gpu, keys, layout)?);
    let [before, recorded, after] = [(); 3].map(|()| sorting.clone());
    let case = KernelCase::new(sorting.work())
        .before(move |rec, sort| before.prepare(rec, sort))
        .judge(move |gpu| after.outputs(gpu));
    Ok(case.commands(move |rec, sort: &Sort, _| recorded.record(rec, sort)))
}

/// Pairs on the device, ready to be sorted again and again.
pub struct Sorting {
    /// The keys.
    pub keys: Vec<u32>,
    layout: Layout,
    keys_before: Buffer<u32>,
    values_before: Buffer<u32>,
    pair_keys: [Buffer<u32>; 2],
    pair_values: [Buffer<u32>; 2],
    table: Buffer<u32>,
    places: Buffer<u32>,
    sums: Buffer<u32>,
    counts: Buffer<u32>,
    args: Buffer<DispatchArgs>,
    scan: Scan,
}

impl Sorting {
    /// Each key with its index as value.
    pub fn new(gpu: &Gpu, keys: Vec<u32>, layout: Layout) -> Result<Sorting> {
        let count = keys.len();
        let values: Vec<u32> = (0..count as u32).collect();
        // Of the largest workgroup, too.
        let entries = layout.table_len(count).max(512 * layout.digit_count() as usize);
        let pair = |name| -> Result<[Buffer<u32>; 2]> { Ok([gpu.buffer(name, count)?, gpu.buffer(name, count)?]) };
        Ok(Sorting {
            keys_before: gpu.buffer_from("keys", &keys)?,
            values_before: gpu.buffer_from("values", &values)?,
            keys,
            layout,
            pair_keys: pair("keys")?,
            pair_values: pair("values")?,
            table: gpu.buffer("table", entries)?,
            places: gpu.buffer("places", entries)?,
            sums: gpu.buffer("sums", entries.div_ceil(SCAN_CHUNK as usize))?,
            counts: counts(gpu, &[])?,
            args: gpu.buffer("args", 2)?,
            scan: Scan::new(gpu)?,
        })
    }

    /// Puts the unsorted pairs back, with counts and dispatch sizes as `plan` gives them.
    pub fn prepare(&self, rec: &mut Recorder<'_>, sort: &Sort) {
        let count = self.keys.len();
        rec.copy(&self.keys_before, 0..count, &self.pair_keys[0], 0);
        rec.copy(&self.values_before, 0..count, &self.pair_values[0], 0);
        let chunks = sort.chunks(self.layout, count);
        let entries = chunks * self.layout.digit_count() as usize;
        for (slot, value) in [
            (COUNT_ISECT, count),
            (COUNT_ISECT_CHUNK, chunks),
            (COUNT_ISECT_TABLE, entries),
        ] {
            rec.update(&self.counts, slot as usize, &[value as u32]);
        }
        let groups = |count: usize, workgroup: u32| {
            let x = (count as u32).div_ceil(workgroup);
            let y = u32::from(x > 0);
            DispatchArgs { x, y, z: 1 }
        };
        let scanned = entries.div_ceil(SCAN_CHUNK as usize);
        let args = [
            groups(chunks, sort.chunks_per_group),
            groups(scanned, self.scan.chunks_per_group),
        ];
        rec.update(&self.args, 0, &args);
    }

    /// Sorts them.
    pub fn record(&self, rec: &mut Recorder<'_>, sort: &Sort) {
        let io = Io {
            counts: &self.counts,
            args: &self.args,
            keys: &self.pair_keys,
            values: &self.pair_values,
            table: &self.table,
            places: &self.places,
            sums: &self.sums,
        };
        sort.record(rec, &self.scan, io, self.layout);
    }

    /// Work of one sort: each pass reads keys to count them, and reads and writes pairs.
    pub fn work(&self) -> Work {
        let count = self.keys.len();
        Work::of(count, "keys").moving(20 * self.layout.passes as usize * count)
    }

    /// The sorted keys and values.
    ///
    /// # Errors
    /// Those of transfers.
    pub fn sorted(&self, gpu: &Gpu) -> Result<[Vec<u32>; 2]> {
        let at = (self.layout.passes % 2) as usize;
        Ok([read(gpu, &self.pair_keys[at])?, read(gpu, &self.pair_values[at])?])
    }

    /// The sorted pairs beside a stable sort of the same.
    ///
    /// # Errors
    /// Those of transfers.
    pub fn outputs(&self, gpu: &Gpu) -> Result<Vec<Output>> {
        let values: Vec<u32> = (0..self.keys.len() as u32).collect();
        let mask = u32::MAX >> (32 - self.layout.digit_bits * self.layout.passes);
        let (sorted, moved) = reference::sort::sort(&self.keys, &values, mask);
        let [keys, found] = self.sorted(gpu)?;
        Ok(vec![
            Output::exact("keys", words(&keys), words(&sorted)),
            Output::exact("values", words(&found), words(&moved)),
        ])
    }
}

impl Kernel for Sort {
    type Choice = sort_scatter::Choice;
    const NAME: &'static str = "sort";

    fn choices(workgroup: u32) -> Vec<sort_scatter::Choice> {
        sort_scatter::SortScatter::choices(workgroup)
    }

    fn info(choice: &sort_scatter::Choice) -> &'static KernelInfo {
        choice.variant.info()
    }

    /// With the counting kernel of the same variant.
    fn compile(gpu: &Gpu, choice: sort_scatter::Choice) -> Result<Sort> {
        let count = sort_count::SortCount::choices(choice.spec.workgroup)
            .into_iter()
            .find(|count| count.variant.name() == choice.variant.name());
        Sort::with(gpu, count.unwrap_or_default(), choice)
    }
}
