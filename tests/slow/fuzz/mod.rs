//! Hostile files: for any bytes a reader returns a scene or an error of one line that names the file; it does not
//! panic, does not hang and takes no more memory than the file can justify.
//!
//! Here inputs are mutated a fixed number of times from a fixed seed; `make fuzz` runs the same targets under
//! libFuzzer, guided by coverage (`fuzz/`). Inputs that showed a fault are kept with the corpora.

#[rustfmt::skip] // tables of words and one-line rules
mod targets;
mod execute;
mod mutate;
mod repair;
mod seeds;

use execute::execute;
use mutate::{Random, mutate};
use std::collections::HashSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, Once, PoisonError};
use std::time::{Duration, Instant};
use targets::{TARGETS, Target};

/// The folder of the photograph and the point cloud to which inputs may refer.
const BESIDE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/slow/fuzz/beside");

/// Executions per target in a test run; the environment variable `FUZZ_EXECUTIONS` overrides it.
const EXECUTIONS: usize = 50_000;
/// Largest length of an input, bytes.
const LONGEST: usize = 4096;
/// Time limit of one input, longer than any reader needs on any machine.
const PATIENCE: Duration = Duration::from_secs(60);

fn corpus_folder(target: &Target) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    root.join("tests/slow/fuzz/corpus").join(target.name)
}

fn corpus(target: &Target) -> Vec<Vec<u8>> {
    let folder = corpus_folder(target);
    let entries = std::fs::read_dir(&folder).unwrap();
    let mut paths: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    let inputs: Vec<_> = paths.iter().map(|path| std::fs::read(path).unwrap()).collect();
    assert!(!inputs.is_empty(), "{} holds no inputs", folder.display());
    inputs
}

/// Memory is counted for the whole process, so one target runs at a time.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Target, bytes and start of the input being read.
static RUNNING: Mutex<Option<(&str, Vec<u8>, Instant)>> = Mutex::new(None);

fn running() -> MutexGuard<'static, Option<(&'static str, Vec<u8>, Instant)>> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Ends the process if an input is read for longer than [`PATIENCE`].
fn watch() {
    static WATCH: Once = Once::new();
    WATCH.call_once(|| {
        std::thread::spawn(|| {
            loop {
                std::thread::sleep(Duration::from_secs(1));
                if let Some((name, bytes, since)) = &*running()
                    && since.elapsed() > PATIENCE
                {
                    eprintln!("{name} hangs on {}", keep(name, bytes).display());
                    std::process::abort();
                }
            }
        });
    });
}

/// Writes an input to a file for inspection; returns its path.
fn keep(name: &str, bytes: &[u8]) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("fuzz-{name}-{:08x}", crc32fast::hash(bytes)));
    std::fs::write(&path, bytes).unwrap();
    path
}

/// Runs one input; returns the reader's message, or the fault with the file of the input.
fn fault(target: &Target, bytes: &[u8]) -> Result<String, String> {
    *running() = Some((target.name, bytes.to_vec(), Instant::now()));
    let outcome = catch_unwind(AssertUnwindSafe(|| execute(target, bytes)));
    *running() = None;
    outcome.map_err(|panic| {
        let text = panic.downcast_ref::<String>().cloned();
        let text = text.or_else(|| panic.downcast_ref().map(|s: &&str| (*s).to_owned()));
        let path = keep(target.name, bytes);
        format!("{}: {}", path.display(), text.unwrap_or_default())
    })
}

/// A message without its numbers and quotations.
fn kind(said: &str) -> String {
    let (before, quoted) = said.split_once('"').unwrap_or((said, ""));
    let after = quoted.rsplit_once('"').map_or("", |(_, after)| after);
    let is_word = |word: &&str| word.len() > 1 && word.bytes().all(|b| b.is_ascii_lowercase());
    let words = before.split(' ').chain(after.split(' ')).filter(is_word);
    words.filter(|word| *word != "inf").collect()
}

/// Mutates a target's corpus and executes it `executions` times. Inputs with a new kind of message are mutated further:
/// messages stand in for code coverage. Returns the number of kinds.
fn fuzz(target: &Target, executions: usize, seed: u64) -> Result<usize, String> {
    let mut pool = corpus(target);
    let mut kinds = HashSet::new();
    for bytes in &pool {
        kinds.insert(kind(&fault(target, bytes)?));
    }
    let mut random = Random(seed);
    for _ in 0..executions {
        let mut bytes = pool[random.below(pool.len())].clone();
        let other = &pool[random.below(pool.len())];
        mutate(&mut random, &mut bytes, other, target.words, LONGEST);
        if random.below(4) > 0 {
            (target.repair)(&mut bytes);
        }
        let said = fault(target, &bytes)?;
        if kinds.insert(kind(&said)) && pool.len() < 1000 {
            pool.push(bytes);
        }
    }
    Ok(kinds.len())
}

#[track_caller]
fn bounded(name: &str) {
    let _alone = alone();
    watch();
    let target = TARGETS.iter().find(|target| target.name == name).unwrap();
    let wanted = std::env::var("FUZZ_EXECUTIONS").ok();
    let executions = wanted.map_or(EXECUTIONS, |number| number.parse().unwrap());
    let kinds = fuzz(target, executions, 1).unwrap_or_else(|fault| panic!("{fault}"));
    println!("{name}: {executions} executions, {kinds} different outcomes");
    // A reader with fewer outcomes accepts everything, or rejects everything for one reason.
    assert!(kinds >= 3, "only {kinds} different outcomes");
}

macro_rules! targets {
    ($($name:ident),*) => {
        $(#[test] fn $name() { bounded(stringify!($name)) })*

        #[test]
        fn every_target_is_run() {
            let run = [$(stringify!($name)),*];
            assert_eq!(TARGETS.iter().map(|target| target.name).collect::<Vec<_>>(), run);
        }
    };
}

targets!(
    ply,
    cloud,
    mesh,
    splat,
    spz,
    ksplat,
    colmap_bin,
    colmap_txt,
    colmap_rigs,
    transforms,
    checkpoint,
    obj,
    gltf,
    png,
    jpeg,
    sog,
    camera_path,
    realitycapture,
    metashape
);

#[test]
fn faults_are_noticed() {
    let _alone = alone();
    let target = |run: fn(&[u8]) -> String| Target {
        name: "splat",
        run,
        repair: |_| {},
        words: &[],
        memory: |b| b.len(),
    };
    let greedy = target(|bytes| {
        assert!(bytes.len() < 40, "an index out of range");
        let numbers = vec![0u8; (2 << 20) * usize::from(bytes.len() < 20)];
        numbers.len().to_string()
    });
    let found = |length| fault(&greedy, &vec![0; length]).err().unwrap_or_default();
    assert!(found(10).contains("bytes of memory for a file of 10"), "{}", found(10));
    assert_eq!(found(30), "");
    assert!(found(50).contains("an index out of range"));
    // The mutations reach it as well, from inputs of 32 bytes and more.
    assert!(fuzz(&greedy, 1000, 1).is_err());
}

#[test]
#[ignore = "writes the inputs that the corpora begin with: run when a format or a target is new"]
fn write_the_seeds() {
    for (target, name, bytes) in seeds::all() {
        let known = TARGETS.iter().find(|t| t.name == target).unwrap();
        let folder = corpus_folder(known);
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join(name), bytes).unwrap();
    }
    for (name, bytes) in seeds::beside() {
        std::fs::create_dir_all(BESIDE).unwrap();
        std::fs::write(Path::new(BESIDE).join(name), bytes).unwrap();
    }
}
