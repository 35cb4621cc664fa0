//! Order of splats on the device: grouped by SH degree.
//!
//! Only the parameters are reordered: their slots are in order of degree, and an index gives the splat of each slot.
//! All other arrays keep the scene's order, so that splats of equal depth are drawn in the same order as without slots.
//! Only kernels that read parameters use the index. Scenes of a single degree need none.

use crate::scene::{Splats, sh_coefficient_count};

/// Number of SH degrees: 0 to 3.
pub const DEGREES: usize = 4;

/// One value per SH degree, such as a count.
pub type ByDegree = [usize; DEGREES];

/// Counts of `splats` splats of one degree.
pub fn of_degree(splats: usize, sh_degree: u32) -> ByDegree {
    let mut counts = ByDegree::default();
    counts[sh_degree as usize] = splats;
    counts
}

/// Fewest splats of a degree that are stored separately from the next degree. A separate group takes a dispatch, at the
/// cost of the time that some hundred splats save on a CPU device, some thousand on others. All devices save memory.
const APART_MIN: usize = 512;
/// Inverse of the least share of a scene that is stored separately, so that its dispatch pays off in large scenes too.
const APART_SHARE: usize = 64;

/// Fewest splats of a degree that are stored separately in a scene of `splats` splats.
pub fn apart(splats: usize) -> usize {
    APART_MIN.max(splats.div_ceil(APART_SHARE))
}

/// Raises the degrees of small groups: fewer splats than 512, or than a 64th of the scene, join the next degree in use.
/// A function of the number of splats of each degree alone. Raised splats have zeros as additional coefficients:
/// pictures stay the same.
pub fn merge_degrees(degrees: &mut [u8]) {
    let apart = apart(degrees.len());
    let mut counts = count(degrees);
    let mut raised: [u8; DEGREES] = [0, 1, 2, 3];
    for degree in 0..DEGREES - 1 {
        let next = (degree + 1..DEGREES).find(|&next| counts[next] > 0);
        let Some(next) = next.filter(|_| (1..apart).contains(&counts[degree])) else {
            continue;
        };
        counts[next] += std::mem::take(&mut counts[degree]);
        for to in raised.iter_mut().filter(|to| **to as usize == degree) {
            *to = next as u8;
        }
    }
    let raise = |degree: &mut u8| *degree = raised[*degree as usize];
    degrees.iter_mut().for_each(raise);
}

/// SH degree of every splat: the highest with a nonzero coefficient.
pub fn degrees_used(splats: &Splats) -> Vec<u8> {
    let stride = splats.sh_stride();
    let used = |row: &[f32]| {
        let most = row.iter().rposition(|&value| value != 0.0);
        let coefficients = most.map_or(1, |last| last / 3 + 1);
        let holds = |&degree: &u32| sh_coefficient_count(degree) >= coefficients;
        (0..splats.sh_degree).find(holds).unwrap_or(splats.sh_degree) as u8
    };
    splats.sh.chunks_exact(stride).map(used).collect()
}

fn count(degrees: &[u8]) -> ByDegree {
    let mut counts = ByDegree::default();
    degrees.iter().for_each(|&d| counts[d as usize] += 1);
    counts
}

/// Order of splats in slots.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Slots {
    /// Splats of each degree.
    pub counts: ByDegree,
    /// Splat index of each slot, in order of degree, then of splats. `None`: slot = splat.
    pub splat_from_slot: Option<Vec<u32>>,
}

impl Slots {
    /// Slots of splats with these degrees, 0 to 3.
    pub fn of(degrees: &[u8]) -> Slots {
        let counts = count(degrees);
        let is_mixed = counts.iter().filter(|&&count| count > 0).count() > 1;
        let index = || {
            let of = |wanted| (0..).zip(degrees).filter(move |&(_, &d)| d == wanted);
            let slots = (0..DEGREES as u8).flat_map(of);
            slots.map(|(splat, _)| splat).collect()
        };
        Slots {
            counts,
            splat_from_slot: is_mixed.then(index),
        }
    }

    /// Slots of a scene: each splat by the degree that it uses, after [`merge_degrees`].
    pub fn of_scene(splats: &Splats) -> Slots {
        let mut degrees = degrees_used(splats);
        merge_degrees(&mut degrees);
        Slots::of(&degrees)
    }

    /// Highest degree of any splat; 0 without splats.
    pub fn sh_degree(&self) -> u32 {
        self.counts.iter().rposition(|&count| count > 0).unwrap_or(0) as u32
    }

    /// Splat indices of a range of slots.
    pub fn of_slots(&self, slots: std::ops::Range<usize>) -> Vec<u32> {
        match &self.splat_from_slot {
            Some(index) => index[slots].to_vec(),
            None => slots.map(|slot| slot as u32).collect(),
        }
    }

    /// Splat index of a slot.
    pub fn splat(&self, slot: usize) -> usize {
        let index = self.splat_from_slot.as_ref();
        index.map_or(slot, |index| index[slot] as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slots_are_in_order_of_degree_and_then_of_splats() {
        let slots = Slots::of(&[3, 0, 1, 0, 3, 1, 0]);
        assert_eq!(slots.counts, [3, 2, 0, 2]);
        assert_eq!(slots.splat_from_slot, Some(vec![1, 3, 6, 2, 5, 0, 4]));
        assert_eq!((0..3).map(|slot| slots.splat(slot)).sum::<usize>(), 10);
        for degrees in [&[][..], &[2, 2]] {
            let slots = Slots::of(degrees);
            assert_eq!(slots.splat_from_slot, None);
            assert_eq!(slots.counts[2], degrees.len());
        }
    }

    #[test]
    fn few_splats_join_the_next_degree_that_there_is() {
        let of = |counts: ByDegree| -> ByDegree {
            let each = counts.iter().zip(0..);
            let mut degrees: Vec<u8> = each
                .flat_map(|(&count, degree)| std::iter::repeat_n(degree, count))
                .collect();
            let before = degrees.clone();
            merge_degrees(&mut degrees);
            assert!(degrees.iter().zip(&before).all(|(after, before)| after >= before));
            count(&degrees)
        };
        assert_eq!(of([5, 0, 0, 0]), [5, 0, 0, 0]);
        assert_eq!(of([512, 0, 0, 1]), [512, 0, 0, 1]);
        assert_eq!(of([511, 0, 0, 1]), [0, 0, 0, 512]);
        // Two that join may be enough together.
        assert_eq!(of([500, 12, 0, 9]), [0, 512, 0, 9]);
        assert_eq!(of([500, 11, 5, 0]), [0, 0, 516, 0]);
        assert_eq!(of([1_000, 0, 0, 63_000]), [1_000, 0, 0, 63_000]);
        assert_eq!(of([1_000, 0, 0, 63_001]), [0, 0, 0, 64_001]);
        assert_eq!(of([0; 4]), [0; 4]);
    }

    #[test]
    fn a_degree_is_the_highest_with_something_in_it() {
        let mut splats = Splats {
            sh: vec![0.0; 5 * 48],
            sh_degree: 3,
            ..Splats::default()
        };
        for (splat, place) in [2, 11, 26, 47].into_iter().enumerate() {
            splats.sh[48 * splat + place] = [1e-45, f32::NAN, -1.0, f32::INFINITY][splat];
        }
        splats.sh[4 * 48 + 30] = -0.0;
        assert_eq!(degrees_used(&splats), [0, 1, 2, 3, 0]);
    }
}
