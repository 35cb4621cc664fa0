//! Compiles the shaders and derives the host's side of them; see `build/mod.rs`.

use std::path::Path;

#[path = "build/mod.rs"]
mod generator;

fn main() {
    println!("cargo::rerun-if-changed=glsl");
    let out = std::env::var_os("OUT_DIR").unwrap_or_default();
    if let Err(faults) = generator::generate(Path::new("glsl"), Path::new(&out)) {
        for line in faults.iter().flat_map(|fault| fault.lines()) {
            println!("cargo::error={line}");
        }
    }
}
