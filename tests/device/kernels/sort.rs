//! The radix sort: each half of a pass, and all passes together, beyond any loop limit of a driver.

use crate::common::check::*;
use crate::common::device;
use crate::common::scenes::Random;
use crate::kernels::supported;
use ashfall::gpu::{Gpu, Groups};
use ashfall::kernels::scan::Scan;
use ashfall::kernels::sort::{Io, Layout, Sort};
use ashfall::kernels::{sort_count, sort_scatter};
use ashfall::layout::*;
use ashfall::reference::{scan, sort};

/// Keys under a name.
fn inputs(most: usize) -> Vec<(&'static str, Vec<u32>)> {
    let random = &mut Random::new(5);
    let mut drawn = |len: usize| (0..len).map(|_| random.bits() as u32).collect::<Vec<u32>>();
    let ascending: Vec<u32> = (0..2000).map(|i| i * 2_000_003).collect();
    vec![
        ("nothing to sort", vec![]),
        ("one", vec![77]),
        ("2^8 - 1", drawn(255)),
        ("2^8", drawn(256)),
        ("2^8 + 1", drawn(257)),
        ("a chunk and one", drawn(4097)),
        ("equal keys", vec![0x0102_0304; 3000]),
        ("all 0", vec![0; 3000]),
        ("all 0xFFFFFFFF", vec![u32::MAX; 3000]),
        ("two values, alternating", [5, 3].repeat(2500)),
        ("sorted already", ascending.clone()),
        ("descending", ascending.into_iter().rev().collect()),
        ("many", drawn(most)),
    ]
}

/// The slots and arguments that a sort reads, filled as `plan` would.
fn layout(digit_bits: u32, passes: u32) -> Layout {
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

fn digit(key: u32, shift: u32, digit_count: u32) -> u32 {
    (key >> shift) & (digit_count - 1)
}

/// `[digit][chunk]`: how often each digit occurs in each of so many chunks, of whole quadruples of keys.
fn table(keys: &[u32], chunks: usize, shift: u32, digit_count: u32) -> Vec<u32> {
    let mut table = vec![0; chunks * digit_count as usize];
    let size = keys.len().div_ceil(chunks).next_multiple_of(4);
    for (i, &key) in keys.iter().enumerate() {
        table[digit(key, shift, digit_count) as usize * chunks + i / size] += 1;
    }
    table
}

/// The slots that both halves of a pass read.
fn slots(count: usize, chunks: usize) -> [(u32, u32); 2] {
    [
        (COUNT_ISECT, count as u32),
        (COUNT_ISECT_CHUNK, chunks as u32),
    ]
}

/// Workgroups of a variant that the device has: where a chunk has a whole one, it must consist of full subgroups.
fn workgroups(subgroup: bool, gpu: &Gpu) -> Vec<u32> {
    let size = gpu.caps().subgroup_size;
    let mut all = match subgroup {
        true => vec![size, 2 * size, 256.max(size)],
        false => vec![1, 8, 64],
    };
    all.retain(|&workgroup| workgroup <= gpu.caps().max_workgroup);
    all
}

/// Digits and chunks to try: bits, shift, chunks, of which the last may be empty.
const CUTS: [(u32, u32, usize); 5] = [
    (8, 0, 64),
    (8, 24, 301),
    (9, 3, 16),
    (11, 5, 17),
    (1, 31, 1000),
];

#[test]
fn digits_are_counted_by_chunk() {
    let gpu = device::gpu();
    let mut check = Check::new("sort_count");
    for variant in supported!(sort_count, gpu) {
        let subgroup = variant == sort_count::Variant::Subgroup;
        for workgroup in workgroups(subgroup, &gpu) {
            let spec = sort_count::Spec { workgroup };
            let choice = sort_count::Choice { variant, spec };
            let kernel = sort_count::SortCount::new(&gpu, choice).unwrap();
            for ((name, keys), cut) in inputs(70_000)
                .iter()
                .flat_map(|input| CUTS.map(|cut| (input, cut)))
            {
                let (bits, shift, chunks) = cut;
                let expected = table(keys, chunks, shift, 1 << bits);
                let counted = unwritten::<u32>(&gpu, expected.len() + 1);
                let io = sort_count::Bindings {
                    counts: &counts(&gpu, &slots(keys.len(), chunks)),
                    keys: &buffer(&gpu, keys),
                    table: &counted,
                };
                let params = sort_count::Params {
                    count_slot: COUNT_ISECT,
                    chunk_slot: COUNT_ISECT_CHUNK,
                    shift,
                    digit_count: 1 << bits,
                };
                let args = args(&gpu, chunks, if subgroup { 1 } else { workgroup });
                gpu.run(|rec| kernel.record(rec, io, params, Groups::indirect(&args, 0)))
                    .unwrap();
                let case = format!("{name}, {cut:?}, {variant:?} {workgroup}");
                let expected = [words(&expected), vec![f64::NAN]].concat();
                let found = words(&read(&gpu, &counted));
                check.outputs(&case, vec![Output::exact("table", found, expected)]);
            }
        }
    }
    check.finish();
}

#[test]
fn one_pass_sorts_by_one_digit_and_is_stable() {
    let gpu = device::gpu();
    let mut check = Check::new("sort_scatter");
    for variant in supported!(sort_scatter, gpu) {
        let subgroup = variant == sort_scatter::Variant::Subgroup;
        for workgroup in workgroups(subgroup, &gpu) {
            let spec = sort_scatter::Spec { workgroup };
            let choice = sort_scatter::Choice { variant, spec };
            let kernel = sort_scatter::SortScatter::new(&gpu, choice).unwrap();
            for ((name, keys), cut) in inputs(70_000)
                .iter()
                .flat_map(|input| CUTS.map(|cut| (input, cut)))
            {
                let (bits, shift, chunks) = cut;
                let (places, _) = scan::scan(&table(keys, chunks, shift, 1 << bits));
                // The identity: where a value ends up says where its key came from.
                let values: Vec<u32> = (0..keys.len() as u32).collect();
                let keys_out = unwritten::<u32>(&gpu, keys.len() + 1);
                let values_out = unwritten::<u32>(&gpu, keys.len() + 1);
                let io = sort_scatter::Bindings {
                    counts: &counts(&gpu, &slots(keys.len(), chunks)),
                    keys: &buffer(&gpu, keys),
                    values: &buffer(&gpu, &values),
                    table: &buffer(&gpu, &places),
                    keys_out: &keys_out,
                    values_out: &values_out,
                };
                let params = sort_scatter::Params {
                    count_slot: COUNT_ISECT,
                    chunk_slot: COUNT_ISECT_CHUNK,
                    shift,
                    digit_count: 1 << bits,
                };
                let args = args(&gpu, chunks, if subgroup { 1 } else { workgroup });
                gpu.run(|rec| kernel.record(rec, io, params, Groups::indirect(&args, 0)))
                    .unwrap();
                let mask = ((1u32 << bits) - 1) << shift;
                let (sorted, moved) = sort::sort(keys, &values, mask);
                let case = format!("{name}, {cut:?}, {variant:?} {workgroup}");
                let padded = |list: &[u32]| [words(list), vec![f64::NAN]].concat();
                check.outputs(
                    &case,
                    vec![
                        Output::exact("keys", words(&read(&gpu, &keys_out)), padded(&sorted)),
                        Output::exact("values", words(&read(&gpu, &values_out)), padded(&moved)),
                    ],
                );
            }
        }
    }
    check.finish();
}

fn sort_on(gpu: &Gpu, whole: &Sort, layout: Layout, keys: &[u32]) -> [Vec<u32>; 2] {
    let len = keys.len();
    let values: Vec<u32> = (0..len as u32).collect();
    let chunks = whole.chunks(layout, len);
    let entries = chunks * layout.digit_count() as usize;
    let slots = [
        slots(len, chunks).as_slice(),
        &[(COUNT_ISECT_TABLE, entries as u32)],
    ]
    .concat();
    let groups = |count: usize, workgroup: u32| {
        let x = (count as u32).div_ceil(workgroup);
        let y = u32::from(x > 0);
        DispatchArgs { x, y, z: 1 }
    };
    let scanned = entries.div_ceil(SCAN_CHUNK as usize);
    let args = buffer(
        gpu,
        &[
            groups(chunks, whole.chunks_per_group),
            groups(scanned, Scan::WORKGROUP),
        ],
    );
    let keys = [buffer(gpu, keys), unwritten(gpu, len)];
    let values = [buffer(gpu, &values), unwritten(gpu, len)];
    let scan = Scan::new(gpu).unwrap();
    let counts = counts(gpu, &slots);
    let io = Io {
        counts: &counts,
        args: &args,
        keys: &keys,
        values: &values,
        table: &unwritten(gpu, entries),
        places: &unwritten(gpu, entries),
        sums: &unwritten(gpu, scanned),
    };
    let mut sorted = 0;
    gpu.run(|rec| sorted = whole.record(rec, &scan, io, layout))
        .unwrap();
    [&keys[sorted], &values[sorted]].map(|buffer| read(gpu, buffer))
}

/// Sorts a permutation of `0..n`: what comes out is `0..n`, and every value still goes with its key.
fn sort_permutation(gpu: &Gpu, whole: &Sort, n: usize) {
    let random = &mut Random::new(n as u64);
    let mut keys: Vec<u32> = (0..n as u32).collect();
    for i in (1..n).rev() {
        keys.swap(i, random.below(i + 1));
    }
    let [sorted, from] = sort_on(gpu, whole, layout(8, 4), &keys);
    for (i, (&key, &value)) in sorted.iter().zip(&from).take(n).enumerate() {
        assert!(key as usize == i, "{n} keys: {key} at {i}");
        assert!(keys[value as usize] == key, "{n} keys: {value} at {i}");
    }
}

/// `2^k - 1`, `2^k` and `2^k + 1`.
fn about_powers(k: std::ops::RangeInclusive<u32>) -> impl Iterator<Item = usize> {
    k.flat_map(|k| [(1 << k) - 1, 1 << k, (1 << k) + 1])
}

#[test]
fn permutations_are_sorted() {
    let gpu = device::gpu();
    let whole = Sort::new(&gpu).unwrap();
    for n in about_powers(1..=16) {
        sort_permutation(&gpu, &whole, n);
    }
}

/// As far as one binding goes; what is larger has no buffer, and says so.
#[test]
#[ignore = "minutes of sorting; `make soak` runs it"]
fn large_permutations_are_sorted() {
    let gpu = device::gpu();
    let whole = Sort::new(&gpu).unwrap();
    let limit = (gpu.caps().max_storage_range.min(gpu.caps().max_allocation) / 4) as usize;
    for n in about_powers(17..=26) {
        if n <= limit {
            sort_permutation(&gpu, &whole, n);
        } else {
            let refusal = gpu.buffer::<u32>("keys", n).map(|_| ()).unwrap_err();
            let said = refusal.to_string();
            assert!(said.contains("keys"), "{n} keys: {said}");
        }
    }
}

#[test]
fn a_whole_sort_is_stable() {
    let gpu = device::gpu();
    let mut check = Check::new("sort");
    let size = gpu.caps().subgroup_size;
    let mut sorts = vec![Sort::new(&gpu).unwrap()];
    for variant in supported!(sort_scatter, gpu).skip(1) {
        let spec = sort_scatter::Spec {
            workgroup: 4 * size,
        };
        let scatter = sort_scatter::Choice { variant, spec };
        let count = sort_count::Choice {
            variant: sort_count::Variant::Subgroup,
            spec: sort_count::Spec { workgroup: size },
        };
        sorts.push(Sort::with(&gpu, count, scatter).unwrap());
    }
    for whole in &sorts {
        for (name, keys) in inputs(300_007) {
            for layout in [layout(8, 4), layout(11, 1), layout(9, 2)] {
                let [keys_found, values_found] = sort_on(&gpu, whole, layout, &keys);
                let bits = layout.digit_bits * layout.passes;
                let mask = u32::MAX >> (32 - bits);
                let values: Vec<u32> = (0..keys.len() as u32).collect();
                let (sorted, moved) = sort::sort(&keys, &values, mask);
                let found = |list: &[u32]| words(&list[..keys.len()]);
                check.outputs(
                    &format!("{name}, {bits} bits, {} a group", whole.chunks_per_group),
                    vec![
                        Output::exact("keys", found(&keys_found), words(&sorted)),
                        Output::exact("values", found(&values_found), words(&moved)),
                    ],
                );
            }
        }
    }
    check.finish();
}
