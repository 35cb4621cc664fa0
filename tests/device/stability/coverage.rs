//! Coverage of the catalogue: every entry has a test of its number, or a line with the reason for none.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// Numbers of entries, of metamorphic relations and of recommended numerics of the catalogue.
const ENTRIES: u32 = 115;
const RELATIONS: u32 = 22;
const NUMERICS: u32 = 15;

/// The texts of the modules of one folder of device tests.
fn modules(name: &str) -> Vec<String> {
    texts_in(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/device").join(name))
}

fn texts_in(folder: &Path) -> Vec<String> {
    let files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    files.map(|path| fs::read_to_string(path).unwrap()).collect()
}

/// The numbers of the functions named `<letter><digits>_…` and marked as tests.
fn tested(text: &str, letter: char) -> BTreeSet<u32> {
    let mut numbers = BTreeSet::new();
    let mut before = "";
    for line in text.lines() {
        if let Some(name) = line.strip_prefix("fn ").filter(|_| before == "#[test]") {
            let digits = name.strip_prefix(letter).and_then(|n| n.split_once('_'));
            numbers.extend(digits.and_then(|(digits, _)| digits.parse::<u32>().ok()));
        }
        before = line;
    }
    numbers
}

/// The numbers with a line `//! * 22: why`.
fn excused(text: &str) -> BTreeSet<u32> {
    let reasons = text.lines().filter_map(|line| line.strip_prefix("//! * "));
    reasons
        .filter_map(|line| line.split_once(": "))
        .filter(|(_, why)| why.len() > 20)
        .filter_map(|(number, _)| number.parse().ok())
        .collect()
}

#[test]
fn the_rule_sees_what_is_a_test_and_what_an_excuse() {
    let text = "//! * 7: it does not apply to this engine\n//! * 8: no\n#[test]\nfn f009_a() {}\nfn f010_b() {}\n";
    assert_eq!(tested(text, 'f'), BTreeSet::from([9]));
    assert_eq!(excused(text), BTreeSet::from([7]));
}

#[test]
fn every_entry_has_its_test_or_its_reason() {
    // Fault-injection tests in `faults` have the same numbers; excuses stand in `stability` only.
    let (here, faults) = (modules("stability"), modules("faults"));
    let all = |letter: char| -> BTreeSet<u32> {
        let texts = here.iter().chain(&faults);
        texts.flat_map(|text| tested(text, letter)).collect()
    };
    let with_test = all('f');
    let with_reason: BTreeSet<u32> = here.iter().flat_map(|text| excused(text)).collect();
    let both: Vec<_> = with_test.intersection(&with_reason).collect();
    assert!(both.is_empty(), "tested and excused: {both:?}");
    let open: Vec<u32> = (1..=ENTRIES)
        .filter(|entry| !with_test.contains(entry) && !with_reason.contains(entry))
        .collect();
    println!("{} entries tested, {} do not apply", with_test.len(), with_reason.len());
    assert!(open.is_empty(), "neither tested nor excused: {open:?}");
    for (letter, last) in [('m', RELATIONS), ('b', NUMERICS)] {
        let found = all(letter);
        let open: Vec<u32> = (1..=last).filter(|number| !found.contains(number)).collect();
        assert!(open.is_empty(), "{letter}: no test of {open:?}");
    }
}
