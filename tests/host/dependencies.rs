//! Dependencies of the engine: a fixed list, free of the tools' crates.

use std::collections::BTreeSet;
use std::process::Command;

/// Direct dependencies of the renderer, the engine without default features.
const DIRECT: [&str; 12] = [
    "ash",
    "bytemuck",
    "flate2",
    "glam",
    "gpu-allocator",
    "half",
    "rayon",
    "serde",
    "serde_json",
    "thiserror",
    "zstd",
    "ashfall",
];

/// Further direct dependencies of the engine with data sets and training.
const OF_TRAINING: [&str; 7] = ["crc32fast", "exr", "image", "roxmltree", "tobj", "webp", "zip"];

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
    let mut trained = found;
    trained.extend(OF_TRAINING.map(str::to_owned));
    assert_eq!(tree(&["--depth", "1", "--features", "train"]), trained);
    let (all, trained) = (tree(&[]), tree(&["--features", "train"]));
    for tool in TOOLS {
        assert!(!trained.contains(tool), "{tool} is a dependency of the engine");
    }
    for image in ["exr", "image", "roxmltree", "tobj", "webp", "zip"] {
        assert!(!all.contains(image), "{image} is a dependency of the renderer");
    }
    assert!(tree(&["--features", "cli"]).contains("clap"), "the list tells nothing");
}

/// Without the feature `compile` no compiler of shaders is built.
#[test]
fn the_shaders_of_packages_need_no_compiler() {
    let all = |features: &str| tree(&["-e", "normal,build", "--features", features]);
    let (packaged, compiled) = (all("train,capi"), all("compile"));
    for name in ["shaderc", "shaderc-sys", "cmake", "rspirv"] {
        assert!(!packaged.contains(name), "{name} is built");
    }
    assert!(compiled.contains("shaderc") && compiled.contains("rspirv"));
}
