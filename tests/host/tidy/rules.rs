//! The rules and their exceptions. Each takes files and lists its faults, one line each.

use crate::tidy::source::{File, code, functions};
use ashfall::kernels::BASELINES;
use ashfall::shader::Requirement;
use std::collections::BTreeSet;

/// Most lines of a file.
const FILE_LINES_MAX: usize = 500;
/// Most columns of a line of comment; rustfmt wraps code at as many.
const COLUMNS_MAX: usize = 120;
/// Most lines of a function.
const FUNCTION_LINES_MAX: usize = 70;

/// Prefixes of kernels that are steps of one operation. Only the operation has a testable result, so one reference and
/// one file of test cases cover all its steps; the host dispatches them together, so it may have a file of the
/// operation's name beside those of the steps.
const OPERATIONS: [(&str, &str); 4] = [
    ("scan_", "scan"),
    ("sort_", "sort"),
    ("loss_", "loss"),
    ("selftest_", "selftest"),
];

/// Restricted words of code: their allowed places, and the reason.
const PLACES: &[(&str, &[&str], &str)] = &[
    (
        "unsafe",
        &[
            "src/gpu/",
            "src/capi/",
            "tests/device/embed",
            "examples/embed.rs",
            "examples/view/",
        ],
        "memory by pointers is kept to Vulkan and C",
    ),
    (
        "ash",
        &[
            "src/gpu/",
            "src/capi/",
            "tests/device/embed",
            "examples/embed.rs",
            "examples/view/",
        ],
        "only gpu speaks Vulkan",
    ),
    (
        "vk",
        &[
            "src/gpu/",
            "src/capi/",
            "tests/device/embed",
            "examples/embed.rs",
            "examples/view/",
        ],
        "only gpu speaks Vulkan",
    ),
    (
        "gpu_allocator",
        &["src/gpu/", "tests/device/embed", "examples/embed.rs", "examples/view/"],
        "only gpu speaks Vulkan",
    ),
    (
        "var",
        &["src/main.rs", "src/cli/", "tests/", "benches/", "examples/"],
        "options are typed and passed",
    ),
    (
        "var_os",
        &["src/main.rs", "src/cli/", "tests/", "benches/", "build.rs"],
        "options are typed and passed",
    ),
];

fn stem(path: &str) -> &str {
    let name = path.rsplit('/').next().unwrap_or(path);
    name.split('.').next().unwrap_or(name)
}

pub(crate) fn words(code: &str) -> impl Iterator<Item = &str> {
    code.split(|c: char| !c.is_alphanumeric() && c != '_')
        .filter(|word| !word.is_empty())
}

/// Pairs of names: shader, host, reference and test cases have the same name. A kernel has no host file if the host
/// decides nothing.
pub(crate) fn names_pair_up(files: &[File], unpaired: &[(&str, &str)]) -> Vec<String> {
    let operation = |kernel: &str| {
        let part = OPERATIONS.iter().find(|(prefix, _)| kernel.starts_with(prefix));
        part.map_or(kernel.to_owned(), |(_, whole)| (*whole).to_owned())
    };
    let is_shader = |path: &str| path.starts_with("glsl/") && path.ends_with(".comp");
    let shaders = files.iter().filter(|(path, _)| is_shader(path));
    let kernels: BTreeSet<String> = shaders.map(|(path, _)| stem(path).to_owned()).collect();
    let operations: BTreeSet<String> = kernels.iter().map(|kernel| operation(kernel)).collect();
    let names: BTreeSet<&String> = kernels.union(&operations).collect();
    let present: BTreeSet<&str> = files.iter().map(|(path, _)| path.as_str()).collect();
    let excused = |path: &str| unpaired.iter().any(|(exception, _)| *exception == path);
    let mut faults = Vec::new();
    let none = BTreeSet::new();
    let folders = [
        ("src/kernels/", &none),
        ("src/reference/", &operations),
        ("tests/device/kernels/", &operations),
    ];
    for (folder, wanted) in folders {
        for name in wanted {
            let path = format!("{folder}{name}.rs");
            if !present.contains(path.as_str()) && !excused(&path) {
                faults.push(format!("{path}: absent, though the kernel {name} exists"));
            }
        }
        for path in present.iter().filter(|path| path.starts_with(folder)) {
            let known = names.iter().any(|name| *name == stem(path)) || ["mod", "main"].contains(&stem(path));
            if !known && !excused(path) {
                faults.push(format!("{path}: no kernel of this name"));
            }
        }
    }
    // An exception without effect is outdated.
    for (path, _) in unpaired {
        let named = names.iter().any(|name| *name == stem(path));
        let absent_partner = named && !present.contains(path);
        let extra = !named && present.contains(path);
        if !absent_partner && !extra {
            faults.push(format!("{path}: needs no exception"));
        }
    }
    faults
}

/// Finds `unsafe`, Vulkan and the environment outside their places.
pub(crate) fn words_keep_their_place(files: &[File]) -> Vec<String> {
    let mut faults = Vec::new();
    for (path, text) in files.iter().filter(|(path, _)| path.ends_with(".rs")) {
        let code = code(text);
        for (number, line) in code.lines().enumerate() {
            for (word, places, why) in PLACES {
                let variable = word.starts_with("var") && !line.contains("env::var");
                let placed = places.iter().any(|place| path.starts_with(place));
                if !variable && !placed && words(line).any(|found| found == *word) {
                    faults.push(format!("{path}:{}: `{word}`: {why}", number + 1));
                }
            }
        }
    }
    faults
}

fn is_source(path: &str) -> bool {
    [".rs", ".comp", ".glsl"].iter().any(|end| path.ends_with(end))
}

/// Finds files, functions and lines beyond their maximum length.
pub(crate) fn lengths_are_bounded(files: &[File]) -> Vec<String> {
    let mut faults = Vec::new();
    for (path, text) in files.iter().filter(|(path, _)| is_source(path)) {
        let lines = text.lines().count();
        if lines > FILE_LINES_MAX {
            faults.push(format!("{path}: {lines} lines, more than {FILE_LINES_MAX}"));
        }
        let is_comment = |line: &str| line.trim_start().starts_with("//");
        for (number, line) in text.lines().enumerate() {
            if is_comment(line) && line.chars().count() > COLUMNS_MAX {
                let place = number + 1;
                faults.push(format!("{path}:{place}: more than {COLUMNS_MAX} columns"));
            }
        }
        for (name, line, lines) in functions(&code(text), path.ends_with(".rs")) {
            if lines > FUNCTION_LINES_MAX && !path.starts_with("tests/") {
                faults.push(format!(
                    "{path}:{line}: `{name}` has {lines} lines, more than {FUNCTION_LINES_MAX}"
                ));
            }
        }
    }
    faults
}

/// Every source begins with its purpose: Rust with `//!`, a shader with a comment after its includes.
pub(crate) fn sources_open_with_a_comment(files: &[File]) -> Vec<String> {
    let mut faults = Vec::new();
    for (path, text) in files.iter().filter(|(path, _)| is_source(path)) {
        let rust = path.ends_with(".rs");
        let directive = |line: &&str| !rust && (line.trim().is_empty() || line.starts_with('#'));
        let first = text.lines().find(|line| !directive(line)).unwrap_or_default();
        if !first.starts_with(if rust { "//!" } else { "//" }) {
            faults.push(format!("{path}: does not open with what it is for"));
        }
    }
    faults
}

/// Whether a requirement is optional, and so forbidden in a base variant, which runs on every Vulkan 1.3 device. Only
/// basic subgroup operations are guaranteed there. Baselines run only in measurements.
pub(crate) fn is_optional(kernel: &str, requirement: Requirement) -> bool {
    match requirement {
        Requirement::SubgroupBasic => false,
        _ if BASELINES.contains(&kernel) => false,
        _ => true,
    }
}

/// Finds paths of one machine, and documents that are not in the repository.
pub(crate) fn nothing_points_outside(files: &[File]) -> Vec<String> {
    let present: BTreeSet<&str> = files.iter().map(|(path, _)| stem(path)).collect();
    // Composed here, so that this file passes.
    let folders = ["/wo!rk/", "/ho!me/", "/ro!ot/", ".li!brary/"].map(|folder| folder.replace('!', ""));
    let mut faults = Vec::new();
    for (path, text) in files {
        for (number, line) in text.lines().enumerate() {
            let place = format!("{path}:{}", number + 1);
            if let Some(folder) = folders.iter().find(|folder| line.contains(folder.as_str())) {
                faults.push(format!("{place}: a folder of one machine: {folder}"));
            }
            for (at, _) in line.match_indices(".md") {
                let name = words(&line[..at]).last().unwrap_or_default();
                if line[..at].ends_with(name)
                    && name.len() > 3
                    && name == name.to_uppercase()
                    && !present.contains(name)
                {
                    faults.push(format!("{place}: there is no {name}.md here"));
                }
            }
        }
    }
    faults
}
