//! Radix sort: each half of a pass, and all passes together, beyond any loop limit of a driver.

use crate::common::check::*;
use crate::common::device;
use crate::common::scenes::Random;
use ashfall::gpu::Gpu;
use ashfall::kernels::sort::Sort;
use ashfall::lab::bench::kernels::Workgroups;
use ashfall::lab::bench::kernels::sort::{Digit, Sorting, count, layout, scatter, sort};

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

/// Digits and chunks to try, of which the last may be empty.
const DIGITS: [Digit; 5] = [
    digit(8, 0, 64),
    digit(8, 24, 301),
    digit(9, 3, 16),
    digit(11, 5, 17),
    digit(1, 31, 1000),
];

const fn digit(bits: u32, shift: u32, chunks: usize) -> Digit {
    Digit { bits, shift, chunks }
}

/// Workgroups; variants with subgroup operations take the multiples of a subgroup.
const WORKGROUPS: Workgroups = Workgroups::subgroups(&[1, 8, 64, 256]);

#[test]
fn digits_are_counted_by_chunk() {
    let gpu = device::gpu();
    let mut check = Check::new("sort_count");
    for digit in DIGITS {
        let case = |(name, keys): (&str, Vec<u32>)| (format!("{name}, {digit:?}"), count(&gpu, &keys, digit).unwrap());
        let cases: Vec<_> = inputs(70_000).into_iter().map(case).collect();
        check.cases(&gpu, WORKGROUPS, &cases);
    }
    check.finish();
}

#[test]
fn one_pass_sorts_by_one_digit_and_is_stable() {
    let gpu = device::gpu();
    let mut check = Check::new("sort_scatter");
    for digit in DIGITS {
        let case =
            |(name, keys): (&str, Vec<u32>)| (format!("{name}, {digit:?}"), scatter(&gpu, &keys, digit).unwrap());
        let cases: Vec<_> = inputs(70_000).into_iter().map(case).collect();
        check.cases(&gpu, WORKGROUPS, &cases);
    }
    check.finish();
}

/// Sorts a permutation of `0..n`: what comes out is `0..n`, and every value still goes with its key.
fn sort_permutation(gpu: &Gpu, whole: &Sort, n: usize) {
    let random = &mut Random::new(n as u64);
    let mut keys: Vec<u32> = (0..n as u32).collect();
    for i in (1..n).rev() {
        keys.swap(i, random.below(i + 1));
    }
    let sorting = Sorting::new(gpu, keys, layout(8, 4)).unwrap();
    gpu.run(|rec| {
        sorting.prepare(rec, whole);
        sorting.record(rec, whole);
    })
    .unwrap();
    let ([sorted, from], keys) = (sorting.sorted(gpu).unwrap(), &sorting.keys);
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
    let limit = (gpu.caps().reach() / 4) as usize;
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
    for layout in [layout(8, 4), layout(11, 1), layout(9, 2)] {
        let case = |(name, keys)| (name, sort(&gpu, keys, layout).unwrap());
        let cases: Vec<_> = inputs(300_007).into_iter().map(case).collect();
        check.cases(&gpu, Workgroups::subgroups(&[8, 64]), &cases);
    }
    check.finish();
}
