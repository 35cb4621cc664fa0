//! Format-aware mutations of inputs: numbers in text and in binary, lines, blocks, truncation, splices of two files.
//! All follow from one seed.

/// SplitMix64 (Steele, Lea and Flood 2014).
pub(crate) struct Random(pub u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A random number below `end`; 0 for `end` 0.
    pub(crate) fn below(&mut self, end: usize) -> usize {
        (self.next() % end.max(1) as u64) as usize
    }

    fn pick<'a, T: ?Sized>(&mut self, from: &[&'a T]) -> &'a T {
        from[self.below(from.len())]
    }
}

/// Integers at the limits of types and of readers' arithmetic.
const INTEGERS: &[u64] = &[
    0,
    1,
    2,
    3,
    0x7f,
    0x80,
    0xff,
    0x100,
    0x7fff,
    0xffff,
    0x1_0000,
    0xff_ffff,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_fffe,
    0xffff_ffff,
    0x1_0000_0000,
    0x0fff_ffff_ffff_ffff,
    0x7fff_ffff_ffff_ffff,
    0xffff_ffff_ffff_ffff,
];

/// Special values of floats.
const FLOATS: &[f64] = &[
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::MAX,
    f64::MIN_POSITIVE,
    5e-324,
    f32::MAX as f64,
    3.5e38,
    f32::MIN_POSITIVE as f64,
    1e-45,
    1e20,
    1e10,
    16_777_217.0,
    65_536.0,
    -104.0,
    88.73,
];

/// The same in text, and values that only text can express.
const NUMBERS: &[&str] = &[
    "0",
    "-0",
    "1",
    "-1",
    "2",
    "3",
    "7",
    "255",
    "256",
    "65535",
    "65536",
    "2147483648",
    "4294967295",
    "4294967296",
    "9223372036854775808",
    "18446744073709551615",
    "18446744073709551616",
    "1e400",
    "-1e400",
    "1e-400",
    "1e38",
    "3.5e38",
    "nan",
    "-nan(ind)",
    "inf",
    "1.#INF",
    "0x10",
    "1,5",
    "1.",
    ".5",
    "+3",
    "--1",
    "1e",
    "null",
    "\"\"",
    "[]",
    "{}",
];

/// Changes `data` one or a few times, to at most `longest` bytes. `other` is a second input of the same format and
/// `words` its vocabulary.
pub(crate) fn mutate(random: &mut Random, data: &mut Vec<u8>, other: &[u8], words: &[&str], longest: usize) {
    loop {
        change(random, data, other, words);
        data.truncate(longest);
        if random.below(3) == 0 {
            return;
        }
    }
}

fn change(random: &mut Random, data: &mut Vec<u8>, other: &[u8], words: &[&str]) {
    let at = random.below(data.len());
    match random.below(16) {
        0 | 1 => flip(random, data, at),
        2 => data.truncate(random.below(data.len() + 1)),
        3 => remove(random, data, at),
        4 => repeat(random, data, at),
        5 => splice(random, data, other),
        6..=8 => overwrite(random, data, at),
        9..=11 => retype(random, data, at),
        12 => shuffle_lines(random, data, at),
        13 | 14 if !words.is_empty() => {
            let word = random.pick(words);
            let end = at + random.below(2) * word.len().min(data.len() - at);
            data.splice(at..end, word.bytes());
        }
        _ => {
            let bytes = random.next().to_le_bytes();
            data.splice(at..at, bytes[..1 + random.below(8)].iter().copied());
        }
    }
}

fn flip(random: &mut Random, data: &mut [u8], at: usize) {
    if let Some(byte) = data.get_mut(at) {
        *byte ^= match random.below(4) {
            0 => random.next() as u8,
            _ => 1 << random.below(8),
        };
    }
}

fn remove(random: &mut Random, data: &mut Vec<u8>, at: usize) {
    let end = (at + 1 + random.below(32)).min(data.len());
    data.drain(at.min(end)..end);
}

fn repeat(random: &mut Random, data: &mut Vec<u8>, at: usize) {
    let end = (at + 1 + random.below(64)).min(data.len());
    let block = data[at.min(end)..end].repeat(1 + random.below(8));
    let to = random.below(data.len() + 1);
    data.splice(to..to, block);
}

/// The beginning of `data` and the end of `other`.
fn splice(random: &mut Random, data: &mut Vec<u8>, other: &[u8]) {
    let from = random.below(other.len() + 1);
    // Mostly at the same place, so that headers precede their data.
    let to = match random.below(3) {
        0 => random.below(data.len() + 1),
        _ => from.min(data.len()),
    };
    data.truncate(to);
    data.extend_from_slice(&other[from..]);
}

/// Overwrites a binary number by another of some width and byte order.
fn overwrite(random: &mut Random, data: &mut [u8], at: usize) {
    let float = FLOATS[random.below(FLOATS.len())];
    let integer = INTEGERS[random.below(INTEGERS.len())];
    let mut bytes = match random.below(6) {
        0 => float.to_le_bytes().to_vec(),
        1 => (float as f32).to_le_bytes().to_vec(),
        2 => integer.to_le_bytes().to_vec(),
        3 => (integer as u32).to_le_bytes().to_vec(),
        4 => (integer as u16).to_le_bytes().to_vec(),
        _ => vec![integer as u8],
    };
    if random.below(4) == 0 {
        bytes.reverse();
    }
    let end = (at + bytes.len()).min(data.len());
    let count = end - at.min(end);
    data[at.min(end)..end].copy_from_slice(&bytes[..count]);
}

/// Replaces the number in the text that begins at or after `at`.
fn retype(random: &mut Random, data: &mut Vec<u8>, at: usize) {
    let is_part = |byte: &u8| byte.is_ascii_digit() || matches!(byte, b'.' | b'-' | b'e');
    let rest = &data[at.min(data.len())..];
    let Some(start) = rest.iter().position(u8::is_ascii_digit) else {
        return;
    };
    let length = rest[start..].iter().take_while(|b| is_part(b)).count();
    let start = at + start;
    let number = match random.below(4) {
        0 => random.below(64).to_string(),
        1 => format!("{}", f32::from_bits(random.next() as u32)),
        _ => random.pick(NUMBERS).to_owned(),
    };
    data.splice(start..start + length, number.bytes());
}

/// Copies, removes or empties the line around `at`.
fn shuffle_lines(random: &mut Random, data: &mut Vec<u8>, at: usize) {
    let is_end = |byte: &u8| *byte == b'\n';
    let start = data[..at].iter().rposition(is_end).map_or(0, |i| i + 1);
    let end = data[at..].iter().position(is_end);
    let end = end.map_or(data.len(), |i| at + i + 1);
    let line = data[start..end].to_vec();
    match random.below(3) {
        0 => _ = data.drain(start..end),
        1 => _ = data.splice(start..end, [b'\n']),
        _ => {
            let to = random.below(data.len() + 1);
            _ = data.splice(to..to, line);
        }
    }
}
