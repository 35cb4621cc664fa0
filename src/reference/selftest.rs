//! Expected results of the device self-tests.

/// Slots of the self-test of atomics before the marks.
pub const ATOMIC_MARKS_BEGIN: usize = 24;

/// Next number of a sequence, in every self-test: a linear congruence (Numerical Recipes).
fn next(number: u32) -> u32 {
    number.wrapping_mul(1_664_525).wrapping_add(1_013_904_223)
}

/// Counts after `invocations` invocations: see the shader for the slots.
pub fn atomics(invocations: u32) -> Vec<u32> {
    let mut counts = vec![0; ATOMIC_MARKS_BEGIN];
    counts[0] = invocations;
    for index in 0..invocations {
        let congruence = next(index);
        let hash = congruence ^ (congruence >> 16);
        counts[1] = counts[1].max(hash);
        counts[2] = counts[2].max(!hash);
        counts[3] |= 1 << (hash % 32);
        counts[4] ^= hash;
        counts[8 + (hash % 16) as usize] += 1;
    }
    counts.resize(ATOMIC_MARKS_BEGIN + invocations as usize, 1);
    // Mark of a ticket that no invocation draws.
    counts.push(0);
    counts
}

/// The eight results of each of `lanes` lanes after `rounds` rounds, `[lane][result]`.
pub fn lanes(lanes: u32, rounds: u32) -> Vec<u32> {
    let seed = |lane: u32| lane.wrapping_mul(2_654_435_761).wrapping_add(12_345);
    let mut numbers: Vec<u32> = (0..lanes).map(seed).collect();
    let mut folded = vec![[0u32; 8]; lanes as usize];
    for round in 0..rounds {
        numbers.iter_mut().for_each(|number| *number = next(*number));
        let values: Vec<u32> = numbers.iter().map(|number| number >> 12).collect();
        let odd = |values: &[u32]| values.iter().filter(|&value| value % 2 == 1).count() as u32;
        for (lane, folded) in folded.iter_mut().enumerate() {
            let asked = (lane as u32 * 5 + round) % lanes;
            let results = [
                values.iter().fold(0u32, |sum, &value| sum.wrapping_add(value)),
                values.iter().copied().max().unwrap_or(0),
                values.iter().map(|value| value % 1024).sum(),
                values[asked as usize],
                values[lane ^ 1],
                odd(&values),
                odd(&values[..lane]),
                u32::from(values.iter().any(|value| value % 61 == 0)) + 2 * u32::from(lane == 0),
            ];
            for (to, result) in folded.iter_mut().zip(results) {
                *to = to.wrapping_mul(31).wrapping_add(result);
            }
        }
    }
    folded.into_flattened()
}

/// Element `turns` of the chain of numbers that begins at `start`.
pub fn chain(start: u32, turns: u32) -> u32 {
    (0..turns).fold(start, |number, _| next(number))
}

/// Result of every workgroup of `lanes` lanes after `rounds` rounds.
pub fn progress(groups: u32, lanes: u32, rounds: u32) -> Vec<u32> {
    let of_group = |group: u32| {
        let mut numbers: Vec<u32> = (0..lanes).map(|lane| group * lanes + lane).collect();
        for _ in 0..rounds {
            for number in &mut numbers {
                *number = chain(*number, (*number >> 7) % 23);
            }
            let given = numbers.clone();
            for (lane, number) in numbers.iter_mut().enumerate() {
                *number ^= given[(lane + 1) % given.len()] >> 1;
            }
        }
        numbers.iter().fold(0u32, |sum, &number| sum.wrapping_add(number))
    };
    (0..groups).map(of_group).collect()
}

/// Functions of the self-test of arithmetic, in its order.
pub const FUNCTIONS: [Function; 6] = [
    Function::Exp,
    Function::Exp2,
    Function::Log2,
    Function::Sqrt,
    Function::InverseSqrt,
    Function::Reciprocal,
];

/// A function used by projection and compositing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Function {
    /// eˣ
    Exp,
    /// 2ˣ
    Exp2,
    /// log₂ x
    Log2,
    /// √x
    Sqrt,
    /// 1 / √x
    InverseSqrt,
    /// 1 / x
    Reciprocal,
}

impl Function {
    /// Exact value.
    pub fn exact(self, x: f64) -> f64 {
        match self {
            Function::Exp => x.exp(),
            Function::Exp2 => x.exp2(),
            Function::Log2 => x.log2(),
            Function::Sqrt => x.sqrt(),
            Function::InverseSqrt => x.sqrt().recip(),
            Function::Reciprocal => x.recip(),
        }
    }

    /// Error bound of a device: the Vulkan specification ("Precision and Operation of SPIR-V Instructions"), in units
    /// in the last place; outside the range of normal numbers, in those of the smallest normal number.
    ///
    /// Near 1 the specification allows a logarithm 2⁻²¹ (half of a millionth). Known devices exceed it twofold, so that
    /// all derived tolerances here assume three millionths, and the self-test requires that.
    pub fn allowance(self, x: f64) -> f64 {
        let value = self.exact(x).abs();
        let ulp = value.max(f64::from(f32::MIN_POSITIVE)).log2().floor().exp2() * EPSILON;
        let allowed = match self {
            Function::Exp | Function::Exp2 => (3.0 + 2.0 * x.abs()) * ulp,
            Function::Log2 => (3.0 * ulp).max(3e-6),
            // √x may be computed as the reciprocal of 1 / √x.
            Function::Sqrt => (2.0 + 2.5) * ulp,
            Function::InverseSqrt => 2.0 * ulp,
            Function::Reciprocal => 2.5 * ulp,
        };
        // Subnormal results and arguments may be flushed to zero.
        allowed.max(f64::from(f32::MIN_POSITIVE))
    }
}

/// Distance of 1 from the next number in single precision.
const EPSILON: f64 = f32::EPSILON as f64;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_know_of_each_other() {
        // Two lanes, one round: each result follows by hand.
        let values = [12_345u32, 2_654_435_761u32.wrapping_add(12_345)].map(|seed| next(seed) >> 12);
        let found = lanes(2, 1);
        assert_eq!(found[0], values[0] + values[1]);
        assert_eq!((found[4], found[12]), (values[1], values[0]));
        assert_eq!(found[3], values[0]);
        assert_eq!(found[8 + 3], values[1]);
        assert_eq!((found[7] & 2, found[15] & 2), (2, 0));
    }

    #[test]
    fn counts_are_of_all_invocations() {
        let counts = atomics(1000);
        assert_eq!(counts[8..24].iter().sum::<u32>(), 1000);
        assert_eq!(counts[ATOMIC_MARKS_BEGIN..].iter().sum::<u32>(), 1000);
    }

    #[test]
    fn allowances_follow_the_specification() {
        let ulps = |f: Function, x: f64| f.allowance(x) / (EPSILON * f.exact(x).log2().floor().exp2());
        assert!((ulps(Function::Exp, 2.5) - 8.0).abs() < 1e-9);
        assert!((ulps(Function::Exp2, -5.0) - 13.0).abs() < 1e-9);
        assert_eq!(Function::Exp.allowance(-200.0), f64::from(f32::MIN_POSITIVE));
        assert_eq!(Function::Log2.allowance(1.0), 3e-6);
    }
}
