//! Compiles the shaders and derives the host's side of them; see `build/mod.rs`.

use std::path::Path;

#[path = "build/mod.rs"]
mod generator;

fn main() {
    println!("cargo::rerun-if-changed=glsl");
    let out = std::env::var_os("OUT_DIR").ok_or_else(|| vec!["OUT_DIR is not set".to_owned()]);
    let generated = out.and_then(|out| generator::generate(Path::new("glsl"), Path::new(&out)));
    for fault in generated.err().into_iter().flatten() {
        for line in fault.lines() {
            println!("cargo::error={line}");
        }
    }
}
