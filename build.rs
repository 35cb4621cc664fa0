//! Derives the host's side of the shaders from them, or takes those of a package; see `build/mod.rs`.

use std::path::Path;

#[cfg(feature = "compile")]
#[path = "build/mod.rs"]
mod generator;
#[path = "build/packaged.rs"]
mod packaged;

fn main() {
    println!("cargo::rerun-if-changed=glsl");
    if !cfg!(feature = "compile") {
        println!("cargo::rerun-if-changed=spirv");
    }
    let out = std::env::var_os("OUT_DIR").ok_or_else(|| vec!["OUT_DIR is not set".to_owned()]);
    let generated = out.and_then(|out| generate(Path::new("glsl"), Path::new(&out)));
    for fault in generated.err().into_iter().flatten() {
        for line in fault.lines() {
            println!("cargo::error={line}");
        }
    }
}

/// Compiles the shaders, and notes what they were compiled from, for packages.
#[cfg(feature = "compile")]
fn generate(glsl: &Path, out: &Path) -> Result<(), Vec<String>> {
    generator::generate(glsl, out)?;
    packaged::sign(glsl, out)
}

/// Takes the shaders of a package.
#[cfg(not(feature = "compile"))]
fn generate(glsl: &Path, out: &Path) -> Result<(), Vec<String>> {
    packaged::take(glsl, Path::new("spirv"), out)
}
