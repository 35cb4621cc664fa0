//! Dependencies of the engine: a fixed list, free of the tools' crates.

use std::collections::BTreeSet;
use std::process::Command;

/// Direct dependencies of the engine in `Cargo.toml`.
const DIRECT: [&str; 18] = [
    "ash",
    "bytemuck",
    "crc32fast",
    "exr",
    "flate2",
    "glam",
    "gpu-allocator",
    "half",
    "image",
    "rayon",
    "serde",
    "serde_json",
    "thiserror",
    "tobj",
    "webp",
    "zip",
    "zstd",
    "ashfall",
];

/// Crates of the command line and the laboratory, which are not even indirect dependencies of the engine.
const TOOLS: [&str; 8] = [
    "clap",
    "csv",
    "ctrlc",
    "indicatif",
    "meshopt",
    "plotters",
    "radsort",
    "signal-hook",
];

fn tree(more: &[&str]) -> BTreeSet<String> {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--offline", "--no-default-features", "-e", "normal"])
        .args(["--prefix", "none", "--format", "{p}"])
        .args(more)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    let name = |line: &str| line.split(' ').next().unwrap_or_default().to_owned();
    text.lines().filter(|line| !line.is_empty()).map(name).collect()
}

#[test]
fn the_engine_depends_on_these_crates() {
    let found = tree(&["--depth", "1"]);
    assert_eq!(found, DIRECT.map(str::to_owned).into_iter().collect());
    let all = tree(&[]);
    for tool in TOOLS {
        assert!(!all.contains(tool), "{tool} is a dependency of the engine");
    }
    assert!(tree(&["--features", "cli"]).contains("clap"), "the list tells nothing");
}
